"""Odometry that was contradicted is not believed until where the robot is seen fits it again."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.distrust import LASTING, LONGEST, Distrust
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, POSE, Motion, Nuisance, drive, entering

ROBOT, NUISANCE, USUAL = "robot/r1", Nuisance(), np.array([0.5, 0.4])
STEP = Motion(distance=0.1, turn=0.08, dt=0.2, moving=0.2, along=1e-4, across=1e-4, heading=1e-4)
SEEN = np.diag([0.02, 0.02, 0.01])  # how well its team knows the pose of the robot


def moments_at(pose: np.ndarray) -> Moments:
    return entering(Moments(pose, SEEN), NUISANCE)


def seconds_distrusted(told: Motion, *, seed: int = 0, longest: float = LONGEST) -> float:
    """Seconds until a robot's odometry is believed again. It drives `STEP` and is seen after each; its odometry says `told`."""
    random, distrust, truth = np.random.default_rng(seed), Distrust(), Joint.of({ROBOT: moments_at(np.zeros(3))})
    distrust.begin(ROBOT)
    for number in range(round(longest / STEP.dt)):
        if ROBOT not in distrust:
            return number * STEP.dt
        drive(truth, ROBOT, STEP, NUISANCE)
        distrust.on_motion(ROBOT, told, STEP.dt, NUISANCE, USUAL)
        pose = truth.moments(ROBOT).mean[POSE]
        distrust.judge(ROBOT, moments_at(random.multivariate_normal(pose, SEEN / 4)), USUAL)
    return longest


def test_a_motion_is_as_told_if_the_odometry_was_never_contradicted() -> None:
    distrust = Distrust()
    distrust.begin("robot/r2")
    assert distrust.on_motion(ROBOT, STEP, STEP.dt, NUISANCE, USUAL) is STEP


def test_who_was_contradicted_may_have_moved_in_any_way_at_its_usual_speed() -> None:
    distrust = Distrust()
    distrust.begin(ROBOT)
    moved = distrust.on_motion(ROBOT, STEP, STEP.dt, NUISANCE, USUAL)
    way, turn = 2 * LASTING * STEP.dt * USUAL**2
    assert (moved.along, moved.across) == pytest.approx((STEP.along + way, STEP.across + way))
    assert moved.heading == pytest.approx(STEP.heading + turn)
    assert replace(moved, along=STEP.along, across=STEP.across, heading=STEP.heading) == STEP


@pytest.mark.parametrize("seed", range(5))
def test_who_was_carried_once_is_believed_again_after_seconds(seed: int) -> None:
    assert 3.0 <= seconds_distrusted(STEP, seed=seed) <= 12.0


@pytest.mark.parametrize(
    "told",
    [
        replace(STEP, distance=0.0, turn=0.0),
        replace(STEP, distance=0.0),
        replace(STEP, turn=-STEP.turn),
        replace(STEP, distance=-STEP.distance),
        replace(STEP, distance=3 * STEP.distance),
    ],
    ids=["nothing", "no way", "left-handed", "backwards", "thrice"],
)
@pytest.mark.parametrize("seed", range(3))
def test_odometry_that_stays_wrong_is_never_believed(told: Motion, seed: int) -> None:
    assert seconds_distrusted(told, seed=seed, longest=90.0) == 90.0


def test_who_stands_is_believed_to_stand() -> None:
    distrust, still = Distrust(), Motion(dt=0.2)
    distrust.begin(ROBOT)
    for _ in range(60):
        distrust.on_motion(ROBOT, still, still.dt, NUISANCE, USUAL)
        distrust.judge(ROBOT, moments_at(np.zeros(3)), USUAL)
    assert ROBOT not in distrust


def test_who_is_seen_by_nobody_is_believed_again_in_the_end() -> None:
    distrust, unseen = Distrust(), moments_at(np.zeros(3))
    unseen.covariance[AXES, AXES] = 1e4 * np.eye(2)
    distrust.begin(ROBOT)
    for _ in range(round(LONGEST / STEP.dt) + 2):
        distrust.on_motion(ROBOT, STEP, STEP.dt, NUISANCE, USUAL)
        distrust.judge(ROBOT, unseen, USUAL)
    assert ROBOT not in distrust


def test_a_copy_is_asked_without_changing_the_first() -> None:
    distrust = Distrust()
    distrust.copy().begin(ROBOT)
    assert ROBOT not in distrust


@given(
    numbers=st.tuples(*[st.floats(-1e9, 1e9)] * 3),
    seconds=st.floats(-1.0, 1e12),
    usual=st.tuples(st.floats(0.0, 1e6), st.floats(0.0, 1e6)),
)
def test_whatever_is_told_nothing_is_raised_and_noise_only_grows(
    numbers: tuple[float, float, float], seconds: float, usual: tuple[float, float]
) -> None:
    distrust, speeds = Distrust(), np.array(usual)
    distance, turn, aside = numbers
    told = Motion(distance=distance, turn=turn, aside=aside, dt=0.1, along=1.0, across=1.0, heading=0.1)
    distrust.begin(ROBOT)
    for _ in range(3):
        moved = distrust.on_motion(ROBOT, told, seconds, NUISANCE, speeds)
        assert min(moved.along - told.along, moved.across - told.across, moved.heading - told.heading) >= 0.0
        assert np.isfinite([moved.along, moved.across, moved.heading]).all()
        distrust.judge(ROBOT, moments_at(np.zeros(3)), speeds)


def test_a_heading_beyond_half_a_turn_is_the_same_as_one_below() -> None:
    distrust, still = Distrust(), Motion(dt=1.0)
    distrust.begin(ROBOT)
    for number in range(12):
        distrust.on_motion(ROBOT, still, still.dt, NUISANCE, USUAL)
        pose = np.zeros(3)
        pose[HEADING] = np.pi if number % 2 else -np.pi
        distrust.judge(ROBOT, moments_at(pose), USUAL)
    assert ROBOT not in distrust
