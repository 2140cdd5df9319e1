"""Sightings of `landmark/?`: a robot with a map finds out which ones it sees, and takes no more of them than it can know."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.wire.messages import Fix, Odometry, Sighting
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import WHEELED, Sensors, Wheels
from tests.robot_agent.robots import Pose, measured

ROBOT = "robot/r1"
APART = {"landmark/a": (3.0, 2.0), "landmark/b": (-1.0, 3.0), "landmark/c": (4.0, -2.0), "landmark/d": (-2.0, -2.0)}
GROUP = {"landmark/a": (2.0, 0.0), "landmark/b": (2.1, 0.12), "landmark/c": (2.05, -0.1)}
STEPS = 40
WITHOUT_SCALE = Wheels(replace(WHEELED, sigmas=(*WHEELED.sigmas[:5], 0.0, *WHEELED.sigmas[6:])))  # of ranges


def sighted(
    pose: Pose,
    name: str,
    place: tuple[float, float],
    noise: np.random.Generator,
    named: bool,
    with_sigmas: bool = False,
) -> Sighting:
    """A noisy sighting of a landmark from a pose. `named`: it says which landmark it is; `told`: it comes with the camera's sigmas."""
    off = np.subtract(place, pose[:2])
    distance, bearing = float(np.hypot(*off)) + 0.05 * noise.normal(), math.atan2(off[1], off[0]) - pose[2]
    bearing = math.remainder(bearing + 0.02 * noise.normal(), math.tau)
    sigmas = {"range_sigma": 0.05, "bearing_sigma": 0.02} if with_sigmas else {}
    if named:
        return Sighting(subject=name, range=distance, bearing=bearing, landmark=place, **sigmas)
    return Sighting(subject="landmark/?", range=distance, bearing=bearing, **sigmas)


def driven(
    places: dict[str, tuple[float, float]],
    named: bool,
    *,
    seed: int = 1,
    off: float = 0.0,
    known: dict[str, tuple[float, float]] | None = None,
    with_sigmas: bool = False,
) -> tuple[FirstHand, Pose]:
    """A robot after a drive on an arc, and where it is; `known` is its map [default: all], `off` how far its start is wrong."""
    noise, pose = np.random.default_rng(seed), (0.0, -0.5, 0.3)
    robot = FirstHand(ROBOT, Sensors(WITHOUT_SCALE, landmarks=places if known is None else known))
    start = Fix(position=(pose[0] + off, pose[1]), sigma=0.1, heading=pose[2], heading_sigma=0.05)
    robot.step(measured(0, fix=start))
    for tick in range(1, STEPS + 1):
        x, y, heading = pose
        pose = (x + 0.02 * math.cos(heading + 0.01), y + 0.02 * math.sin(heading + 0.01), heading + 0.02)
        sightings = [sighted(pose, name, place, noise, named, with_sigmas) for name, place in places.items()]
        moved = Odometry(distance=0.02 * (1 + 0.1 * noise.normal()), turn=0.02, dt=0.2)
        robot.step(measured(tick, time=0.2 * tick, odometry=moved, sightings=sightings))
    return robot, pose


def believed(robot: FirstHand) -> Moments:
    assert robot.belief is not None
    return Moments(robot.belief.mean[AXES], robot.belief.covariance[AXES, AXES])


def test_landmarks_that_stand_apart_tell_as_much_as_with_their_names() -> None:
    with_names, without = (believed(driven(APART, named)[0]) for named in (True, False))
    assert without.mean == pytest.approx(with_names.mean, abs=1e-6)
    assert without.covariance == pytest.approx(with_names.covariance, rel=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_of_a_group_they_tell_less_than_with_names_and_nothing_false(seed: int) -> None:
    """Noise and scale of the ranges are known: their estimates would differ between sightings with and without names."""
    robot, pose = driven(GROUP, False, seed=seed, with_sigmas=True)
    without, with_names = believed(robot), believed(driven(GROUP, True, seed=seed, with_sigmas=True)[0])
    apart = without.mean - pose[:2]
    assert np.trace(without.covariance) >= np.trace(with_names.covariance)
    assert apart @ np.linalg.solve(without.covariance, apart) < 13.8  # 99.9 %
    assert np.trace(without.covariance) < 0.1**2 + 0.1**2  # better than the start alone


CROWDED = APART | {"landmark/e": (3.1, 2.1)}


@settings(max_examples=25, deadline=None)
@given(st.permutations(sorted(CROWDED)), st.integers(0, 100))
def test_their_order_in_a_frame_changes_nothing(order: list[str], seed: int) -> None:
    places, beliefs = CROWDED, []
    for names in (sorted(places), order):
        noise = np.random.default_rng(seed)
        by_name = {name: sighted((0.1, 0.0, 0.0), name, places[name], noise, named=False) for name in sorted(places)}
        robot = FirstHand(ROBOT, Sensors(landmarks=places))
        fix = Fix(position=(0, 0), sigma=0.2, heading=0.0, heading_sigma=0.1)
        robot.step(measured(0, fix=fix))
        still = Odometry(distance=0, turn=0, dt=0.2)
        sightings = [by_name[name] for name in names]
        robot.step(measured(1, time=0.2, odometry=still, sightings=sightings))
        beliefs.append(believed(robot))
    assert beliefs[0].mean == pytest.approx(beliefs[1].mean, abs=1e-9)
    assert beliefs[0].covariance == pytest.approx(beliefs[1].covariance, abs=1e-9)


def test_what_else_has_no_name_keeps_its_number_among_all_that_have_none() -> None:
    robot, pose = driven(APART, False)
    noise, names = np.random.default_rng(1), ("landmark/a", "landmark/b")
    landmarks = [sighted(pose, name, APART[name], noise, False) for name in names]
    mate = Sighting(subject="robot/?", range=2.0, bearing=0.5)
    readings = measured(STEPS + 1, time=9.0, sightings=[landmarks[0], mate, landmarks[1]])
    assert [(relative.subject, relative.mark) for relative in robot.step(readings).relatives] == [("robot/?", 1)]


def test_without_a_map_they_tell_nothing() -> None:
    none = believed(driven(APART, False, known={})[0])
    assert np.trace(none.covariance) >= 2 * 0.1**2


def test_a_robot_that_sees_what_is_not_on_its_map_is_not_where_it_believes() -> None:
    robot, _ = driven(APART, False, off=2.0)
    assert robot.mishaps.moved


def test_where_the_robot_does_not_know_where_it_is_they_tell_nothing_and_a_large_map_costs_little() -> None:
    places = {f"landmark/{n}": (float(n % 30), float(n // 30)) for n in range(900)}
    robot, noise = FirstHand(ROBOT, Sensors(landmarks=places)), np.random.default_rng(1)
    robot.step(measured(0, compass=0.0))  # a heading and no place
    sightings = [sighted((0.1, 0.0, 0.0), name, places[name], noise, named=False) for name in list(places)[:60]]
    still = Odometry(distance=0, turn=0, dt=0.2)
    robot.step(measured(1, time=0.2, compass=0.0, odometry=still, sightings=sightings))
    assert np.trace(believed(robot).covariance) > 1e5
    assert not robot.mishaps.moved


def test_what_may_be_one_of_two_that_stand_apart_is_not_taken() -> None:
    places = {"landmark/a": (2.0, 1.0), "landmark/b": (2.0, -1.0)}
    robot = FirstHand(ROBOT, Sensors(landmarks=places))
    fix = Fix(position=(0, 0), sigma=0.02, heading=0.0, heading_sigma=0.6)
    robot.step(measured(0, fix=fix))
    before = believed(robot)
    sightings = [Sighting(subject="landmark/?", range=math.hypot(2, 1), bearing=0.0)]
    still = Odometry(distance=0, turn=0, dt=0.2)
    robot.step(measured(1, time=0.2, odometry=still, sightings=sightings))
    assert believed(robot).mean == pytest.approx(before.mean, abs=1e-9)
    assert np.all(believed(robot).covariance >= before.covariance - 1e-12)
