"""A sighting that arrives some steps late is used with the poses that both robots had when it was taken."""

import math

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import HEADING, KEPT, POSE, Motion, Nuisance, entering, moved_in, turned_by

STEP, RATE, SPEED = 0.1, 1.0, 0.5  # seconds, radians / s while it turns, unit / s
TURNS = 3  # steps in a turn; then as many straight ahead
AGE = 0.25  # seconds: of a sighting
NUISANCE = Nuisance()
MATE = (4.0, 3.0)


def moved(number: int) -> Motion:
    """The motion of a step by its number."""
    turn = RATE * STEP if number // TURNS % 2 else 0.0
    return Motion(distance=SPEED * STEP, turn=turn, dt=STEP, moving=STEP, along=1e-6, across=1e-6, heading=1e-6)


def went(pose: np.ndarray, motion: Motion, share: float = 1.0) -> np.ndarray:
    """A pose after a share of a motion."""
    turn, way = share * motion.turn, share * motion.distance
    return np.array(pose + [*turned_by((way, 0.0), pose[HEADING] + turn / 2), turn])


def seen(pose: np.ndarray) -> Relative:
    dx, dy = MATE - pose[:2]
    bearing = math.remainder(math.atan2(dy, dx) - pose[HEADING], math.tau)
    return Relative("robot/r1", "robot/r2", math.hypot(dx, dy), bearing, 1e-4, 1e-4, AGE)


def told(robot: str, tick: int, travelled: Motion, pose: Moments, *relatives: Relative) -> Evidence:
    belief = None if tick else entering(pose, NUISANCE)
    return Evidence(robot, 0, tick, travelled, NUISANCE, belief, None, relatives, STEP * tick)


def off(tick: int) -> tuple[float, float]:
    """Errors of place (unit) and heading (rad) of a robot that turns in some steps. In each step it tells a late sighting of a mate."""
    start = Moments(np.zeros(3), np.diag([0.01, 0.01, 0.01]))
    placed = Moments(np.array([*MATE, 0.0]), np.diag([1e-6, 1e-6, 1e-6]))
    team, travelled, poses = TeamJoint(), Motion(), [np.zeros(3)]
    still = Motion(dt=STEP)
    for number in range(tick):
        relatives: tuple[Relative, ...] = ()
        if number:
            travelled = travelled.plus(moved(number))
            poses.append(went(poses[-1], moved(number)))
            back, share = divmod(round(AGE / STEP, 6), 1.0)
            if number > back:
                then = number - int(back) - 1
                relatives = (seen(went(poses[then], moved(then + 1), 1.0 - share)),)
        stood = still.times(number)
        both = [told("robot/r1", number, travelled, start, *relatives), told("robot/r2", number, stood, placed)]
        team.settle(number, STEP, both)
    apart = team.joint.moments("robot/r1").mean[POSE] - poses[-1]
    return math.hypot(*apart[:2]), abs(apart[HEADING])


def test_what_was_seen_before_a_turn_began_does_not_turn_its_observer() -> None:
    """A regression: with the last step extrapolated to the whole age, the errors were .3 units and .07 radians."""
    for tick in range(12, 24):
        place, heading = off(tick)
        assert place < 0.005, tick
        assert heading < 0.001, tick


def test_a_robot_goes_back_by_the_motions_that_led_it() -> None:
    motion, pose, poses = Motion(), np.zeros(3), [np.zeros(3)]
    for number in range(40):
        motion = moved(number).after(motion, STEP)
        pose = went(pose, motion)
        poses.append(pose)
    state = entering(Moments(pose, np.eye(3)), NUISANCE).mean
    for steps in (1, 2, 5, 9):
        way, turned = moved_in(state, motion, steps * STEP)
        assert [*way, turned] == pytest.approx(pose - poses[-1 - steps])
    assert KEPT <= motion.covered < KEPT + 3 * STEP


def test_after_a_gap_nothing_is_known_of_what_was_before() -> None:
    assert moved(3).after(moved(2), STEP).before == (moved(2),)
    assert moved(3).after(moved(2), 5.0).before == ()
    assert moved(3).after(Motion(), STEP).before == ()
    assert moved(3).after(moved(2), STEP).plus(moved(4)).before == ()
