"""The robot's sensor models: the printed numbers, and the slow formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.wire.messages import Odometry, Sighting
from robot_agent.config import OdometrySection, VisionSection
from robot_agent.sensing import (
    TickMotion,
    bearing_variance,
    motion,
    motion_since,
    position_likelihood,
    position_sigma,
    range_variance,
    uncertain_likelihood,
)
from sim_world.sensors import vision_sigma


@pytest.mark.parametrize(
    ("distance", "printed"),
    [
        (1.0, math.inf), (1.001, 20 * math.log(6.499)), (2.9, 20 * math.log(4.6)), (3.0, 36.0), (5.0, 20.0), (7.5, 0.0), (10.0, 20.0),
        (11.0, 28.0), (11.1, 20 * math.log(3.6)), (12.99, 20 * math.log(5.49)), (13.0, math.inf),
    ],
)  # fmt: skip
def test_the_printed_sigma_by_distance(distance: float, printed: float) -> None:
    """(VI-.1): 8 |d - 7.5| from 3 to 11, 20 ln |d - 7.5| beyond, nothing seen up to 1 and from 13 on."""
    vision = VisionSection(gain=0.05, floor=0.5)
    assert position_sigma(np.array([distance]), vision)[0] == pytest.approx(max(0.5, 0.05 * printed))


@given(distance=st.floats(0.0, 20.0), gain=st.sampled_from([1.0, 0.05]))
def test_a_right_model_is_the_worlds_physics(distance: float, gain: float) -> None:
    """Written twice on purpose; here they must agree."""
    truth = vision_sigma(distance, gain, 0.5)
    sigma = position_sigma(np.array([distance]), VisionSection(gain=gain, floor=0.5))[0]
    assert sigma == pytest.approx(math.inf if truth is None else truth)


def test_the_likelihood_of_a_seen_position_is_a_density() -> None:
    x, y = np.meshgrid(np.arange(-10, 20, 0.05), np.arange(-15, 15, 0.05), indexing="ij")
    density = [
        float(position_likelihood(np.array([6.0]), np.array([2.0]), (a, b), VisionSection())[0])
        for a, b in ((6.0, 2.0), (6.5, 2.0), (6.0, 3.0))
    ]
    sigma = float(position_sigma(np.array([math.hypot(6, 2)]), VisionSection())[0])
    expected = [math.exp(-0.5 * d**2 / sigma**2) / (2 * math.pi * sigma**2) for d in (0.0, 0.5, 1.0)]
    assert density == pytest.approx(expected)
    total = np.exp(-0.5 * ((x - 6) ** 2 + (y - 2) ** 2) / sigma**2).sum() * 0.05**2 / (2 * math.pi * sigma**2)
    assert total == pytest.approx(1.0, rel=1e-3)
    assert position_likelihood(np.array([0.5, 14.0]), np.zeros(2), (0.5, 0.0), VisionSection()).tolist() == [0.0, 0.0]


SLANTED = np.array([[0.5, -0.3], [-0.3, 0.4]])


def test_where_sigma_is_constant_an_uncertain_mate_counts_as_the_sum_of_both_covariances() -> None:
    vision = VisionSection(gain=1e-9, floor=0.4)
    whole = SLANTED + 0.4**2 * np.eye(2)
    inverse, sight = np.linalg.inv(whole), np.array([4.5, 1.0])
    for place in ((5.0, 1.2), (4.0, 2.0), (6.0, -0.5)):
        away = np.array(place) - sight
        exact = math.exp(-0.5 * away @ inverse @ away) / (2 * math.pi * math.sqrt(np.linalg.det(whole)))
        dx, dy = np.array([[place[0]]]), np.array([[place[1]]])
        assert uncertain_likelihood(dx, dy, (4.5, 1.0), SLANTED, vision)[0, 0] == pytest.approx(exact, rel=1e-9)


def test_where_sigma_rises_an_uncertain_mate_counts_as_the_mean_over_its_distances() -> None:
    """The distance's own variance decides which sigmas count, so a slant towards the robot or across matters."""
    vision = VisionSection(gain=0.05, floor=0.1)
    rng = np.random.default_rng(3)
    for covariance in (0.3 * SLANTED, 0.3 * SLANTED * [[1, -1], [-1, 1]]):
        shifts = rng.multivariate_normal((0, 0), covariance, 200_000)
        dx, dy = 3.6, 3.2
        x, y = dx + shifts[:, 0], dy + shifts[:, 1]
        sigma = position_sigma(np.hypot(x, y), vision)
        away = (x - dx) ** 2 + (y - dy) ** 2
        exact = (np.exp(-0.5 * away / sigma**2) / (2 * math.pi * sigma**2)).mean()
        likelihood = uncertain_likelihood(np.array([[dx]]), np.array([[dy]]), (dx, dy), covariance, vision)[0, 0]
        assert likelihood == pytest.approx(exact, rel=0.05)


def test_an_uncertain_mate_counts_by_the_formula_at_any_distance() -> None:
    """Place by place: the sum over 7 nodes x_k of w_k N(seen; (dx, dy), sigma(d + x_k s)^2 I + C)."""
    vision = VisionSection(gain=0.05, floor=0.3)
    nodes, weights = np.polynomial.hermite_e.hermegauss(7)
    for dx, dy in ((0.2, 0.1), (0.7, -0.4), (-0.9, 0.3), (1.2, 0.5), (-3.0, 4.0), (-7.0, 8.0), (9.0, 8.0)):
        along = np.array([dx, dy]) / math.hypot(dx, dy)
        s, expected = math.sqrt(along @ SLANTED @ along), 0.0
        for node, weight in zip(nodes, weights / weights.sum(), strict=True):
            sigma = position_sigma(np.array([math.hypot(dx, dy) + node * s]), vision)[0]
            if math.isfinite(sigma):
                whole = SLANTED + sigma**2 * np.eye(2)
                away = np.array([dx - 0.8, dy - 0.6])
                density = math.exp(-0.5 * away @ np.linalg.inv(whole) @ away)
                expected += weight * density / (2 * math.pi * math.sqrt(np.linalg.det(whole)))
        likelihood = uncertain_likelihood(np.array([[dx]]), np.array([[dy]]), (0.8, 0.6), SLANTED, vision)[0, 0]
        assert likelihood == pytest.approx(expected, rel=1e-9)
        assert likelihood > 0


MODEL = OdometrySection(distance_scale=0.9, turn_scale=1.1, along=0.2, across=0.05, turn=0.02, standing=0.3)


@pytest.mark.parametrize(
    ("distance", "turn", "share"),
    [(0.5, 0.1, 1.0), (0.5, 0.0, 1.0), (0.0, -0.1, 1.0), (-0.5, 0.0, 1.0), (0.0, 0.0, 0.09), (1e-10, -1e-10, 0.09)],
)
def test_motion_is_scaled_and_its_noise_grows_with_time(distance: float, turn: float, share: float) -> None:
    moved = motion(Odometry(distance=distance, turn=turn, dt=0.5), MODEL)
    assert (moved.distance, moved.turn, moved.dt) == pytest.approx((0.9 * distance, 1.1 * turn, 0.5))
    variances = [moved.along, moved.across, moved.heading]
    assert variances == pytest.approx([0.04 * 0.5 * share, 0.0025 * 0.5 * share, 0.0004 * 0.5 * share])


def test_range_noise_grows_with_the_range_and_consecutive_frames_share_it() -> None:
    vision = VisionSection(range_floor=0.03, range_share=0.07, bearing=0.02, frames=5.0)
    assert range_variance(2.0, vision) == pytest.approx(5 * (0.03**2 + 0.14**2))
    assert bearing_variance(vision) == pytest.approx(5 * 0.02**2)


def test_the_motion_since_a_sighting_is_its_share_of_the_tick() -> None:
    moved = TickMotion(0.8, 0.2, 0.5, 0.0, 0.0, 0.0)
    old = Sighting(subject="object/ball", range=1.0, bearing=0.0, age=0.125)
    assert motion_since(old, moved) == pytest.approx((0.2, 0.05))
    assert motion_since(old, None) == (0.0, 0.0)
    assert motion_since(old.model_copy(update={"age": 0.0}), moved) == (0.0, 0.0)


@given(angle=st.floats(-1e3, 1e3))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = float(wrap(np.array(angle)))
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)
