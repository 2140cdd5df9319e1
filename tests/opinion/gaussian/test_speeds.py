"""Steps that are many times as fast as all before are hardly ones; robots that begin to move, or are that fast, are believed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.speeds import FULL, JUMPS, Speeds
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import Motion
from tests.opinion.gaussian.driving import reports_of, team

POSE = np.diag([0.01, 0.01, 0.0001])
STEP = Motion(distance=0.1, turn=0.05, dt=0.2, moving=0.2, along=1e-6, across=1e-6, heading=1e-6)
JUMP = replace(STEP, distance=-17.0, turn=2.0, aside=3.0)


def driven(*names: str, step: Motion = STEP) -> Speeds:
    speeds = Speeds()
    for name in names * 30:
        speeds.on_motion(name, step, step.dt, POSE)
    return speeds


def test_a_jump_is_taken_for_standing_give_or_take_the_way() -> None:
    believed = driven("robot/r1").on_motion("robot/r1", JUMP, JUMP.dt, POSE)
    assert (believed.distance, believed.aside, believed.turn) == (0.0, 0.0, 0.0)
    assert believed.dt == JUMP.dt
    assert believed.along == believed.across == pytest.approx(JUMP.way**2, rel=1e-3)
    assert believed.heading == pytest.approx((FULL * STEP.turn) ** 2, rel=1e-2)


@pytest.mark.parametrize("turn", [STEP.turn, -2 * STEP.turn, 0.0])
def test_of_a_jump_a_turn_that_may_be_is_believed(turn: float) -> None:
    assert driven("robot/r1").on_motion("robot/r1", replace(JUMP, turn=turn), JUMP.dt, POSE).turn == turn


@pytest.mark.parametrize(
    "step", [STEP, replace(STEP, distance=0.9), replace(STEP, turn=-3.0), replace(STEP, aside=0.5)]
)
def test_what_is_not_much_faster_than_before_is_as_told(step: Motion) -> None:
    assert driven("robot/r1").on_motion("robot/r1", step, step.dt, POSE) is step


def test_what_a_robot_drives_that_has_hardly_moved_is_as_told() -> None:
    stood = driven("robot/r1", step=Motion(dt=0.2))
    for distance in (0.001, 0.1):
        step = replace(STEP, distance=distance)
        assert stood.on_motion("robot/r1", step, step.dt, POSE) is step


def test_noise_of_wheels_that_stand_is_no_motion_to_compare_with() -> None:
    stood = driven("robot/r1", step=replace(STEP, distance=1e-5, turn=1e-6))
    assert stood.on_motion("robot/r1", STEP, STEP.dt, POSE) is STEP


def test_what_is_within_the_sigma_of_the_place_is_as_told() -> None:
    slow = replace(STEP, distance=0.005, turn=0.0)
    step = replace(STEP, turn=0.0)
    assert driven("robot/r1", step=slow).on_motion("robot/r1", step, step.dt, np.diag([0.02, 0.02, 0.1])) is step
    assert driven("robot/r1", step=slow).on_motion("robot/r1", step, step.dt, 0.01 * POSE) is not step


def test_a_robot_that_is_that_fast_is_believed_after_some_steps() -> None:
    speeds, fast = driven("robot/r1"), replace(STEP, distance=100 * STEP.distance)
    believed = [speeds.on_motion("robot/r1", fast, fast.dt, POSE) is fast for _ in range(10)]
    assert believed == sorted(believed), "it stays believed"
    assert sum(believed) >= 5


def test_one_jump_however_far_makes_the_next_one_no_motion() -> None:
    speeds = driven("robot/r1")
    for distance in (1e9, 5.0):
        jump = replace(STEP, distance=distance)
        assert speeds.on_motion("robot/r1", jump, jump.dt, POSE) is not jump


def test_who_turns_for_the_first_time_after_long_is_believed() -> None:
    straight, turns = replace(STEP, turn=0.0), replace(JUMP, turn=0.4)
    assert driven("robot/r1", step=straight).on_motion("robot/r1", STEP, STEP.dt, POSE) is STEP
    assert driven("robot/r1", step=straight).on_motion("robot/r1", turns, turns.dt, POSE).turn == 0.4


def test_a_robot_may_be_as_fast_as_two_of_its_mates() -> None:
    """One may lie."""
    fast = replace(STEP, distance=20 * STEP.distance)
    for mates, is_believed in ((["robot/r2"], False), (["robot/r2", "robot/r3"], True)):
        speeds = driven("robot/r1")
        for mate in mates * 30:
            speeds.on_motion(mate, fast, fast.dt, POSE)
        assert (speeds.on_motion("robot/r1", fast, fast.dt, POSE) is fast) == is_believed


@given(
    st.floats(-1e6, 1e6),
    st.floats(-1e3, 1e3),
    st.floats(-1e6, 1e6),
    st.floats(1e-6, 1e4),
    st.floats(0, 1e6),
    st.floats(0, 10),
)
def test_a_motion_is_never_surer_than_told_and_says_nothing_else_of_time(
    distance: float, turn: float, aside: float, seconds: float, noise: float, moving: float
) -> None:
    told = Motion(distance, turn, seconds, moving, along=noise, across=noise, heading=noise, aside=aside)
    believed = driven("robot/r1").on_motion("robot/r1", told, seconds, POSE)
    assert (believed.dt, believed.moving) == (told.dt, told.moving)
    assert min(believed.along - noise, believed.across - noise, believed.heading - noise) >= 0
    assert believed is told or believed.along >= believed.way**2
    assert believed is told or told.way / seconds > JUMPS * STEP.way / STEP.dt


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("jump", [Motion(30.0), Motion(-200.0), Motion(30.0, dt=-1.0), Motion(30.0, dt=1e9)])
def test_a_joint_keeps_a_robot_whose_odometry_jumps_where_it_is_seen(seed: int, jump: Motion) -> None:
    """Also where it says that the step took no time, or for ever."""
    robots, joint = team(4, seed), TeamJoint()
    for tick in range(30):
        reports = [_jumped(report, jump) if tick >= 20 else report for report in reports_of(robots, tick)]
        joint.settle(tick, 1.0, reports)
    for robot in robots:
        place = joint.marginal(robot.name)
        off = place.mean - robot.place
        assert off @ np.linalg.solve(place.covariance, off) < 14.0, f"{robot.name}, 99.9 %"
        assert np.hypot(*off) < 1.0
    assert not joint.left_out


def _jumped(report: Evidence, jump: Motion) -> Evidence:
    """Of r1: its sum of motions holds a jump, of which its own filter knows nothing."""
    if report.robot != "robot/r1":
        return report
    return replace(report, travelled=report.travelled.plus(jump))
