"""The robot's sensor models: the printed numbers, and the slow formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.wire.messages import Odometry, Sighting
from robot_agent.config import OdometrySection, VisionSection
from robot_agent.sensing import (
    Motion,
    bearing_variance,
    motion,
    motion_since,
    position_likelihood,
    position_sigma,
    range_variance,
    uncertain_likelihood,
    wrap,
)
from sim_world.sensors import vision_sigma

PAPER = VisionSection(gain=1.0, floor=0.5)


@pytest.mark.parametrize(
    ("distance", "sigma"),
    [
        (3.0, 36.0),
        (11.0, 28.0),
        (5.0, 20.0),
        (7.5, 0.5),
        (2.999999, 30.08),
        (11.000001, 25.06),
        (12.5, 20 * math.log(5)),
    ],
)
def test_sigma_is_as_printed(distance: float, sigma: float) -> None:
    assert position_sigma(np.array([distance]), PAPER)[0] == pytest.approx(sigma, abs=0.01)


@given(distance=st.floats(0.0, 20.0), gain=st.sampled_from([1.0, 0.05]))
def test_a_right_model_is_the_worlds_physics(distance: float, gain: float) -> None:
    """Written twice on purpose; here they must agree."""
    truth = vision_sigma(distance, gain, 0.5)
    found = position_sigma(np.array([distance]), VisionSection(gain=gain, floor=0.5))[0]
    assert found == pytest.approx(math.inf if truth is None else truth)


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


def test_an_uncertain_subject_is_a_sum_over_its_possible_distances() -> None:
    """The formula of the docstring, node by node; the weights are those of 7 points for a standard normal distribution."""
    vision, covariance = VisionSection(), np.array([[1.2, 0.5], [0.5, 0.8]])
    seen = np.array([6.2, 0.4])
    nodes, weights = np.polynomial.hermite.hermgauss(7)
    for x, y in ((5.0, 1.0), (2.0, -0.5), (-7.0, 8.0), (1.5, 0.0)):
        mean = np.array([x, y])
        distance = np.linalg.norm(mean)
        spread = math.sqrt(mean @ covariance @ mean) / distance
        expected = 0.0
        for node, weight in zip(nodes, weights, strict=True):
            sigma = vision_sigma(distance + math.sqrt(2) * node * spread, vision.gain, vision.floor)
            if sigma is not None:
                total = covariance + np.eye(2) * sigma**2
                away = (mean - seen) @ np.linalg.solve(total, mean - seen)
                density = math.exp(-0.5 * away) / (2 * math.pi * math.sqrt(np.linalg.det(total)))
                expected += weight / math.sqrt(math.pi) * density
        found = uncertain_likelihood(np.array([x]), np.array([y]), (6.2, 0.4), covariance, vision)[0]
        assert found == pytest.approx(expected, rel=1e-9)


MODEL = OdometrySection(distance_scale=0.9, turn_scale=1.1, along=0.2, across=0.05, turn=0.02, standing=0.3)


@pytest.mark.parametrize(
    ("distance", "turn", "share"),
    [(0.5, 0.1, 1.0), (0.5, 0.0, 1.0), (0.0, -0.1, 1.0), (-0.5, 0.0, 1.0), (0.0, 0.0, 0.09)],
)
def test_motion_is_scaled_and_its_noise_grows_with_time(distance: float, turn: float, share: float) -> None:
    found = motion(Odometry(distance=distance, turn=turn, dt=0.5), MODEL)
    assert (found.distance, found.turn, found.dt) == pytest.approx((0.9 * distance, 1.1 * turn, 0.5))
    variances = [found.along, found.across, found.heading]
    assert variances == pytest.approx([0.04 * 0.5 * share, 0.0025 * 0.5 * share, 0.0004 * 0.5 * share])


def test_range_noise_grows_with_the_range_and_consecutive_frames_share_it() -> None:
    vision = VisionSection(range_floor=0.03, range_share=0.07, bearing=0.02, frames=5.0)
    assert range_variance(2.0, vision) == pytest.approx(5 * (0.03**2 + 0.14**2))
    assert bearing_variance(vision) == pytest.approx(5 * 0.02**2)


def test_the_motion_since_a_sighting_is_its_share_of_the_tick() -> None:
    moved = Motion(0.8, 0.2, 0.5, 0.0, 0.0, 0.0)
    old = Sighting(subject="object/ball", range=1.0, bearing=0.0, age=0.125)
    assert motion_since(old, moved) == pytest.approx((0.2, 0.05))
    assert motion_since(old, None) == (0.0, 0.0)
    assert motion_since(old.model_copy(update={"age": 0.0}), moved) == (0.0, 0.0)


@given(angle=st.floats(-50, 50))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    found = float(wrap(np.array(angle)))
    assert -math.pi <= found < math.pi
    assert math.cos(found - angle) == pytest.approx(1.0)
