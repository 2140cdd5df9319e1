"""The physics of the sensors: the paper's numbers, and errors that are as large as they say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.config.world import GAINS, WorldOdometrySection, WorldVisionSection
from sim_world.sensors import Odometer, see, vision_sigma
from tests.present import present

PAPER = WorldVisionSection(preset="paper")


@pytest.mark.parametrize(
    ("distance", "sigma"),
    [
        (3.0, 36.0),
        (11.0, 28.0),
        (5.0, 20.0),
        (7.5, 0.5),
        (3 - 1e-9, 30.08),
        (11 + 1e-9, 25.06),
        (12.5, 20 * math.log(5)),
    ],
)
def test_vision_is_as_bad_as_printed(distance: float, sigma: float) -> None:
    """The branches nearly meet: 36 and 30 cells at d = 3, 28 and 25 at d = 11."""
    assert vision_sigma(distance) == pytest.approx(sigma, abs=0.01)


@pytest.mark.parametrize("distance", [0.0, 1.0, 13.0, 20.0])
def test_nothing_is_seen_outside_1_to_13_cells(distance: float) -> None:
    assert vision_sigma(distance) is None


@given(distance=st.floats(1.001, 12.999))
def test_a_camera_has_the_same_shape_and_a_smaller_sigma(distance: float) -> None:
    paper, camera = vision_sigma(distance, floor=1e-9), vision_sigma(distance, GAINS["camera"], 0.5)
    assert camera is not None
    assert camera == max(0.5, GAINS["camera"] * present(paper))
    assert 0.5 <= camera <= 3.0


def test_a_sighting_needs_to_be_ahead() -> None:
    vision = WorldVisionSection(half_angle=1.0)
    noise = np.random.default_rng(1)
    pose = (20.0, 20.0, math.pi)  # looks along -x
    assert see(vision, pose, "object/ball", (13.0, 20.0), noise) is not None
    assert see(vision, pose, "object/ball", (27.0, 20.0), noise) is None
    edge = [(20 - 7 * math.cos(a), 20 - 7 * math.sin(a)) for a in (0.99, -0.99, 1.01, -1.01)]
    assert [see(vision, pose, "object/ball", place, noise) is not None for place in edge] == [True, True, False, False]


def test_what_is_not_seen_costs_no_chance() -> None:
    noise, twin = np.random.default_rng(1), np.random.default_rng(1)
    assert see(PAPER, (0.0, 0.0, 0.0), "object/ball", (-5.0, 0.0), noise) is None
    assert noise.normal() == twin.normal()


@pytest.mark.parametrize(
    ("vision", "distance"), [(PAPER, 8.0), (WorldVisionSection(), 4.0), (WorldVisionSection(), 7.5)]
)
def test_a_seen_position_is_off_by_sigma_in_each_coordinate(vision: WorldVisionSection, distance: float) -> None:
    noise = np.random.default_rng(2)
    x, y, heading = 3.0, -2.0, 2.5
    bearing = 0.4
    place = (x + distance * math.cos(heading + bearing), y + distance * math.sin(heading + bearing))
    sightings = [s for _ in range(4000) if (s := see(vision, (x, y, heading), "robot/r2", place, noise))]
    angles = np.array([heading + s.bearing for s in sightings])
    ranges = np.array([s.range for s in sightings])
    errors = np.stack([x + ranges * np.cos(angles) - place[0], y + ranges * np.sin(angles) - place[1]])
    sigma = present(vision_sigma(distance, vision.scale, vision.floor))
    assert np.allclose(errors.std(axis=1), sigma, rtol=0.05)
    assert np.allclose(errors.mean(axis=1), 0, atol=4 * sigma / math.sqrt(4000))
    assert abs(np.corrcoef(errors)[0, 1]) < 0.06


def test_odometry_errs_along_the_way_with_its_square_root() -> None:
    physics = WorldOdometrySection(along=0.3, turn=0.02)
    wheels = Odometer(physics, np.random.default_rng(3))
    for distance, turn in ((0.2, 0.1), (3.2, -1.6)):
        steps = [wheels.step(distance, turn, 0.2) for _ in range(4000)]
        assert all(step.dt == 0.2 for step in steps)
        errors = np.array([(s.distance - distance, s.turn - turn) for s in steps])
        assert np.allclose(errors.std(axis=0), (0.3 * math.sqrt(distance), 0.02 * math.sqrt(abs(turn))), rtol=0.05)
        assert np.allclose(errors.mean(axis=0), 0, atol=0.05)


def test_a_robot_that_stands_measures_nothing() -> None:
    step = Odometer(WorldOdometrySection(), np.random.default_rng(3)).step(0.0, 0.0, 0.2)
    assert (step.distance, step.turn) == (0.0, 0.0)


def test_the_odometry_is_reset_each_time_the_way_exceeds_5_cells() -> None:
    wheels = Odometer(WorldOdometrySection(reset_after=5.0), np.random.default_rng(4))
    resets = []
    for k in range(1, 25):
        wheels.step(1.0, 0.0, 1.0)
        if wheels.fix_if_due((float(k), 0.0)):
            resets.append(k)
    assert resets == [6, 12, 18, 24]


def test_a_fix_is_off_by_what_it_says() -> None:
    wheels = Odometer(WorldOdometrySection(fix=0.7), np.random.default_rng(5))
    fixes = [wheels.fix((10.0, 20.0)) for _ in range(4000)]
    assert {fix.sigma for fix in fixes} == {0.7}
    errors = np.array([fix.position for fix in fixes]) - (10.0, 20.0)
    assert np.allclose(errors.std(axis=0), 0.7, rtol=0.05)
    assert np.allclose(errors.mean(axis=0), 0, atol=0.05)
