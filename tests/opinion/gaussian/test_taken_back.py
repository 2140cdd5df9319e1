"""A robot that has lied and is honest again is taken back; one that goes on is not, and neither is one that lies now and then."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.believed import UNMET
from blackboard.opinion.gaussian.contacts import CERTAIN
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.claims import contradictions
from tests.opinion.gaussian.driving import reports_of, team

LIAR = "robot/r2"
#: Ticks from the end of a lie: the own place is corrected in every second one, and leaves a third of its error.
WITHIN = 20


def lying(evidence: Evidence, offset: Array) -> Evidence:
    """The evidence of a robot with the heading 0 that says that all is off by an offset."""
    belief, increment = evidence.belief, evidence.increment
    assert belief is not None
    away = np.zeros(len(belief.mean))
    away[AXES] = offset
    return replace(
        evidence,
        belief=replace(belief, mean=belief.mean + away),
        increment=None if increment is None else replace(increment, reference=increment.reference + away),
        relatives=tuple(moved(relative, offset) for relative in evidence.relatives),
    )


def moved(relative: Relative, offset: Array) -> Relative:
    x, y = relative.range * relative.along() + offset
    return replace(relative, range=float(np.hypot(x, y)), bearing=float(np.arctan2(y, x)))


def left_out(
    lie: Callable[[int], float], seed: int, *, ticks: int = 55, leave: int = 0
) -> tuple[list[bool], TeamJoint, float]:
    """For each tick whether the joint leaves the liar out of five robots; the joint; how far off it has the liar at last.

    From the tick `leave` on three of the robots are gone.
    """
    robots, joint, left_out_at = team(5, seed), TeamJoint(), []
    for tick in range(ticks):
        there = [robot for robot in robots if not 0 < leave <= tick or robot.name in (LIAR, "robot/r0")]
        reports = [
            lying(report, np.array([lie(tick), 0.0])) if report.robot == LIAR else report
            for report in reports_of(there, tick)
        ]
        joint.settle(tick, 1.0, reports)
        left_out_at.append(LIAR not in joint.subjects())
    true = next(robot.place for robot in robots if robot.name == LIAR)
    return left_out_at, joint, float(np.hypot(*(joint.marginal(LIAR).mean - true)))


@pytest.mark.parametrize("size", [4.0, 8.0, 15.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_robot_whose_lie_has_ended_is_taken_back_at_its_true_place(size: float, seed: int) -> None:
    out, joint, off = left_out(lambda tick: size if 10 <= tick < 30 else 0.0, seed)
    assert out[25:30] == [True] * 5
    assert out[30 + WITHIN :] == [False] * (len(out) - 30 - WITHIN)
    assert joint.subjects() == [f"robot/r{k}" for k in range(5)]
    assert off < 1.0


@pytest.mark.parametrize("seed", range(3))
def test_robots_that_are_gone_accuse_nobody_for_ever(seed: int) -> None:
    out, _, off = left_out(lambda tick: 8.0 if 10 <= tick < 30 else 0.0, seed, ticks=30 + int(UNMET) + 5, leave=30)
    assert all(out[25:50]), "two of them have accused it"
    assert not any(out[31 + int(UNMET) :])
    assert off < 1.0


@pytest.mark.parametrize("seed", range(2))
def test_who_lies_again_after_its_accusers_were_gone_for_long_is_found_out_again(seed: int) -> None:
    """Its accusers are gone only while it is silent for so long: the first ticks with them are enough."""
    robots, joint, out = team(5, seed), TeamJoint(), []
    for tick in range(30 + int(UNMET) + 20):
        is_silent = 30 <= tick < 32 + int(UNMET)
        lie = np.array([8.0 if tick >= 10 else 0.0, 0.0])
        there = [robot for robot in robots if not (is_silent and robot.name == LIAR)]
        reports = [lying(report, lie) if report.robot == LIAR else report for report in reports_of(there, tick)]
        joint.settle(tick, 1.0, reports)
        out.append(LIAR in joint.left_out)
    assert all(out[20:30])
    assert all(out[34 + int(UNMET) :])


@pytest.mark.parametrize(("size", "pauses"), [(4.0, False), (15.0, False), (8.0, True)])
@pytest.mark.parametrize("seed", range(2))
def test_a_robot_that_goes_on_lying_always_or_now_and_then_stays_out(size: float, pauses: bool, seed: int) -> None:
    out, _, _ = left_out(lambda tick: size if tick >= 10 and (tick // 2 % 2 or not pauses) else 0.0, seed)
    assert all(out[20:])


def test_a_pair_agrees_again_once_its_errors_are_new_after_a_lie() -> None:
    """Each correction makes half of a distance new, so `CERTAIN` of them take two seconds each, and the change shows after one or two."""
    runs = np.array([contradictions(lambda s: 8.0 if s < 20 else 0.0, seed, 40)[4::5] for seed in range(80)])
    assert runs[:, 19].mean() > 0.97
    assert runs[:, 20:22].mean() > 0.95, "not at once"
    assert runs[:, 20 + 2 + 2 * int(CERTAIN)].mean() < 0.1
    assert runs[:, -1].mean() < 0.05


@pytest.mark.parametrize("size", [5.0, 8.0])
def test_a_pair_that_goes_on_contradicting_is_never_taken_to_have_changed(size: float) -> None:
    runs = np.array([contradictions(lambda _: size, seed, 50)[4::5] for seed in range(40)])
    firm = runs[runs[:, 29]]  # those that are found out by then
    assert firm[:, 30:].mean() > 0.99


def test_a_pair_that_contradicts_now_and_then_is_hardly_ever_believed_in_between() -> None:
    runs = np.array([contradictions(lambda s: 8.0 * (s // 2 % 2), seed, 40)[4::5] for seed in range(40)])
    assert runs[:, 10:].mean() > 0.93
