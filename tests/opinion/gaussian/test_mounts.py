"""A compass that may be askew: its readings are taken into a joint with the error that they have in common, once each."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.comparing import AGAIN
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.mounts import (
    USUAL,
    CompassReading,
    add_with_heading,
    compass_of,
    correct_heading,
    north_of,
    reading_factor,
)
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import HEADING, STATES, Motion, Nuisance, entering
from tests.opinion.gaussian.standing import LIAR, PLACES, SPREAD, says

ROBOT = "robot/r1"
SIGMA = 0.05


def standing(heading: float = 0.0, variance: float = 0.04) -> Joint:
    joint = Joint()
    pose = Moments(np.array([0.0, 0.0, heading]), np.diag([0.1, 0.1, variance]))
    joint.add(ROBOT, entering(pose, Nuisance()))
    return joint


def told(tick: int, heading: float, sigma: float = SIGMA) -> Evidence:
    """A robot that stands at heading 0, knows it to .2 rad when it enters, and has a compass."""
    evidence = says(ROBOT, tick)
    if evidence.belief is not None:
        evidence.belief.covariance[HEADING, HEADING] = 0.04
    reading = CompassReading(heading, sigma, most=1.0)
    return replace(evidence, travelled=Motion(dt=float(tick)), compass=reading, time=float(tick))


def heading(team: TeamJoint, robot: str = ROBOT) -> tuple[float, float]:
    block = team.pose(robot)
    return float(block.mean[HEADING]), float(block.covariance[HEADING, HEADING])


@given(own=st.floats(1e-6, 1.0), variance=st.floats(1e-6, 3.0), tie=st.floats(-1e6, 1e6))
def test_an_error_that_the_heading_rests_on_leaves_the_robot_as_it_was(own: float, variance: float, tie: float) -> None:
    joint, mount = standing(variance=variance), compass_of(ROBOT)
    add_with_heading(joint, mount, Moments(np.zeros(1), np.array([[own]])), tie)
    at, bias = joint.blocks[ROBOT].start + HEADING, joint.blocks[mount.block].start
    assert joint.variances[at] == pytest.approx(variance)
    assert joint.variances[bias] == pytest.approx(own)
    assert joint.covariance[at, bias] ** 2 <= own * variance * (1 + 1e-9)
    if tie**2 * own <= variance:
        assert joint.regression(bias)[at] == pytest.approx(tie, abs=1e-9)


@given(read=st.floats(-1.0, 1.0), bias=st.floats(-0.2, 0.2), seed=st.integers(0, 1000))
def test_a_heading_that_rests_on_a_compass_is_what_a_reading_tells_a_robot_of_whose_heading_nothing_is_known(
    read: float, bias: float, seed: int
) -> None:
    """Whatever the joint knows of the errors of one compass and of all. The robot assumed that they sum to `bias`."""
    chance, mount, north = np.random.default_rng(seed), compass_of(ROBOT, 0.05), north_of()
    errors, variance = mount.block, SIGMA**2
    entered, told = standing(read - bias, variance), standing(0.0, 1e6)
    for joint in (entered, told):
        joint.begin({errors: mount.prior(), north.block: north.prior()})
    known = [chance.normal(0.0, 0.1, 1), chance.uniform(0.0, 1.0, (1, 1)), chance.uniform(0.0, 1.0, (1, 1))]
    for joint in (entered, told):
        joint.update(Factor(known[0], {errors: known[1], north.block: known[2]}, np.array([[0.001]])))
    correct_heading(entered, ROBOT, CompassReading(read, SIGMA, bias=bias, tie=-1.0), mount, north)
    told.update(reading_factor(told, ROBOT, CompassReading(read, SIGMA), mount, north))
    assert (entered.covariance == entered.covariance.T).all()
    assert entered.mean == pytest.approx(told.mean, abs=1e-5)
    assert entered.covariance == pytest.approx(told.covariance, abs=1e-5)


def test_a_robot_that_enters_again_has_the_compass_that_it_had() -> None:
    """The board keeps its estimate of the error of the compass, and corrects by it the heading with which the robot enters."""
    team, chance, pair = TeamJoint(), np.random.default_rng(3), ("robot/r1", "robot/r2")
    places, entries = {robot: PLACES[robot] for robot in pair}, 0
    for tick in range(80):
        news = []
        for robot, mate in (pair, pair[::-1]):
            (dx, dy), strays = places[mate] - places[robot], robot == pair[0] and tick // 10 % 2 == 1
            seen = Relative(robot, mate, math.hypot(dx, dy), math.atan2(dy, dx), 0.01, 0.001)
            pose = np.array([*places[robot] + 8.0 * strays, 0.2 if tick else 0.0])
            belief = entering(Moments(pose, np.diag([SPREAD, SPREAD, 0.001])), Nuisance())
            read = CompassReading(0.2 + chance.normal(0.0, SIGMA), SIGMA, most=1.0, tie=-1.0 if tick else 0.0)
            motion = Motion(dt=float(tick), moving=float(tick), heading=1e-3 * tick)
            own = replace(says(robot, tick, (seen,)), belief=belief, travelled=motion, compass=read, time=float(tick))
            news.append(own)
        team.settle(tick, 1.0, news)
        for robot in [robot for robot in pair if tick and team.pose(robot).covariance[0, 0] > AGAIN * SPREAD / 2]:
            entries += 1
            errors = [team.compasses[robot].known(team.joint), team.north.known(team.joint)]
            assert math.sqrt(errors[0].covariance[0, 0]) < 0.8 * USUAL
            assert sum(error.mean[0] for error in errors) == pytest.approx(0.2, abs=0.06)
            assert abs(heading(team, robot)[0]) < 0.12
    assert entries >= 6


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), off=st.sampled_from([-0.3, 0.25, 0.3]))
def test_what_is_believed_once_it_is_found_is_what_a_filter_with_the_wide_prior_has(seed: int, off: float) -> None:
    """The slow way is to begin anew with the wide prior, and to take all readings and all fixes of the heading again."""
    joints = []
    for small in (0.001, 0.2):
        chance, joint, mount = np.random.default_rng(seed), standing(), compass_of(ROBOT, small)
        for _ in range(40):
            reading = CompassReading(off + chance.normal(0.0, SIGMA), SIGMA)
            joint.update(reading_factor(joint, ROBOT, reading, mount))
            seen = np.array([chance.normal(0.0, 0.1) - joint.moments(ROBOT).mean[HEADING]])
            joint.update(Factor(seen, {ROBOT: np.eye(STATES)[[HEADING]]}, np.array([[0.01]])))
        mount.on_noise(joint, 1.0, 1.0)
        joints.append((joint, mount))
    (found, mount), (slow, _) = joints
    assert mount.judge(found)
    assert found.mean == pytest.approx(slow.mean, abs=1e-6)
    assert found.covariance == pytest.approx(slow.covariance, abs=1e-8)
    assert mount.known(found).mean[0] == pytest.approx(off, abs=0.1)


def test_a_board_takes_each_reading_once_and_none_of_the_tick_in_which_its_robot_enters() -> None:
    team = TeamJoint()
    team.settle(0, 1.0, [told(0, 0.1)])
    assert heading(team) == pytest.approx((0.0, 0.04))
    team.settle(1, 1.0, [told(1, 0.1)])
    once = heading(team)
    assert once[0] > 0.05
    assert once[1] < 0.04
    team.settle(1, 1.0, [told(1, 0.1)])
    assert heading(team) == once


def test_readings_that_err_alike_tell_a_heading_no_better_than_their_common_error() -> None:
    """As increments, a hundred of them said it to .005 rad."""
    team = TeamJoint()
    for tick in range(100):
        team.settle(tick, 0.1, [told(tick, 0.0)])
    assert math.sqrt(heading(team)[1]) >= 0.8 * SIGMA


def test_a_reading_far_from_what_is_believed_is_left_out_and_named_and_a_robot_that_was_turned_is_found_again() -> None:
    team = TeamJoint()
    for tick in range(20):
        team.settle(tick, 1.0, [told(tick, 0.0)])
    before = heading(team)
    (verdict,) = [verdict for verdict in team.settle(20, 1.0, [told(20, 2.0)]) if verdict.kind == "compass"]
    assert not verdict.taken
    assert heading(team) == before
    for tick in range(21, 60):
        team.settle(tick, 1.0, [told(tick, 2.0)])
    assert heading(team)[0] == pytest.approx(2.0, abs=0.3)


def disturbed(sees: bool) -> list[float]:
    """How far off a heading is, each fifth of a second, from when its compass begins to read .6 rad too much."""
    team, mate, off = TeamJoint(), "robot/r2", list[float]()
    x, y = PLACES[mate] - PLACES[ROBOT]
    seen = Relative(ROBOT, mate, math.hypot(x, y), math.atan2(y, x), 0.01, 1e-3)
    for tick in range(100):
        evidence = told(tick, 0.6 if tick >= 50 else 0.0)
        evidence = replace(evidence, travelled=Motion(dt=0.2 * tick), time=0.2 * tick)
        relatives = (seen,) if sees and tick % 3 == 0 else ()
        team.settle(tick, 0.2, [replace(evidence, relatives=relatives), says(mate, tick)])
        off.append(heading(team)[0])
    return off[50:]


def test_a_compass_that_reads_otherwise_is_believed_after_five_seconds_and_never_where_a_mate_shows_that_it_is_wrong() -> (
    None
):
    """It was believed after five readings, which is one second here. What is seen of mates did not count against it."""
    alone = disturbed(sees=False)
    assert max(map(abs, alone[:25])) < 0.1
    assert alone[-1] == pytest.approx(0.6, abs=0.2)
    assert max(map(abs, disturbed(sees=True))) < 0.1


@pytest.mark.parametrize("sigma", [1e-6, 1e3])
@pytest.mark.parametrize("read", [0.0, 1e3])
@pytest.mark.parametrize("bias", [0.0, -1e3])
@pytest.mark.parametrize("tie", [0.0, 1e300, -1e300])
def test_no_reading_ends_a_joint(sigma: float, read: float, bias: float, tie: float) -> None:
    team = TeamJoint()
    for tick in range(10):
        said = told(tick, read, sigma)
        assert said.compass is not None
        team.settle(tick, 1.0, [replace(said, compass=replace(said.compass, bias=bias, tie=tie))])
    assert np.isfinite(team.pose(ROBOT).mean).all()
    assert (np.linalg.eigvalsh(team.joint.covariance) > -1e-9).all()


@pytest.mark.parametrize("off", [-0.3, 0.2, 1.0])
@pytest.mark.parametrize("noise", [1.0, 2000.0])
def test_one_robot_that_lies_about_its_compass_turns_no_mate_farther_than_an_honest_one_may_err(
    off: float, noise: float
) -> None:
    """It claims to know its heading and to have an exact compass, as if all compasses read too much."""
    team, honest = TeamJoint(), ["robot/r0", "robot/r1", "robot/r3"]
    information = np.zeros((STATES, STATES))
    for tick in range(60):
        news = []
        for robot in (*honest, LIAR):
            is_liar, chance = robot == LIAR, np.random.default_rng([tick, int(robot[-1])])
            information[HEADING, HEADING] = 1e9 if is_liar else 1 / 0.1**2
            own = says(robot, tick)
            vector = information[:, HEADING] * (0.0 if is_liar else chance.normal(0.0, 0.1))
            gained = own.increment and Increment(
                own.increment.reference, own.increment.information + information, vector
            )
            sigma = 1e-6 if is_liar else SIGMA
            read = off if is_liar else chance.normal(0.0, SIGMA)
            factor = noise if is_liar and tick % 2 else 1.0
            reading = CompassReading(read, sigma, factor, most=2000.0 if is_liar else 1.0)
            motion = Motion(dt=float(tick), moving=float(tick), heading=1e-3 * tick)
            news.append(replace(own, increment=gained, travelled=motion, compass=reading, time=float(tick)))
        team.settle(tick, 1.0, news)
    for robot in honest:
        assert abs(team.pose(robot).mean[HEADING]) <= 0.05
