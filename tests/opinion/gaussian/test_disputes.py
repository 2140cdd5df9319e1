"""Two robots that see one object at two places: it is between them, and moves neither."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.disputes import told_by_both
from blackboard.opinion.gaussian.joint import Factor, Innovation
from blackboard.opinion.gaussian.relation import Bias, Kind, Relative, measured
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, Motion
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.square import PLACES, evidence_of, new_team, sees

BALL, HERE, THERE = "object/ball", (2.0, 2.0), (2.0, 6.0)
TICKS = 40
Place = tuple[float, float]


def settle(team: TeamJoint, tick: int, seen: dict[str, Place | None], *, sure: float = 1.0, noise: float = 0.1) -> None:
    """A tick in which robots say where they see the ball; r1 claims a variance that is divided by `sure`. r1 alone moves."""
    draw, news = np.random.default_rng(tick).normal, []
    for robot in PLACES:
        place = seen.get(robot)
        relatives = []
        if place is not None:
            relative = sees(robot, BALL, (place[0] + noise * draw(), place[1] + noise * draw()))
            by = sure if robot == "robot/r1" else 1.0
            variances = {
                "range_variance": relative.range_variance / by,
                "bearing_variance": relative.bearing_variance / by,
            }
            relatives = [replace(relative, **variances)]
        evidence = evidence_of(robot, tick, *relatives)
        if robot == "robot/r1":
            evidence = replace(evidence, travelled=Motion(dt=tick, moving=tick))
        news.append(evidence)
    team.settle(tick, 1.0, news)


def off(team: TeamJoint, subject: str, at: Place) -> float:
    return float(np.hypot(*(team.marginal(subject).mean[AXES] - at)))


def moved(team: TeamJoint) -> float:
    """How far the robot is, but for r1, that is farthest from where it stands."""
    return max(off(team, robot, place) for robot, place in PLACES.items() if robot != "robot/r1")


@pytest.mark.parametrize("sure", [1.0, 25.0])
def test_an_object_is_between_two_robots_that_see_it_at_two_places(sure: float) -> None:
    """Before, it was where it had been placed first."""
    team = new_team()
    for tick in range(1, TICKS):
        settle(team, tick, {"robot/r1": HERE, "robot/r2": THERE if tick > 5 else None}, sure=sure)
    assert off(team, BALL, (2.0, 4.0)) < 1.0
    assert set(team.disputing(BALL)) == {frozenset({"robot/r1"}), frozenset({"robot/r2"})}
    assert float(np.trace(team.marginal(BALL).covariance)) > 1.0
    assert moved(team) < 0.2


def watch(team: TeamJoint, seconds: float, seen: dict[str, Place]) -> None:
    """Robots see the ball again and again, each so far from where it is expected."""
    for _ in range(round(seconds / 0.5)):
        team.disputes.pass_time(0.5)
        for robot, away in seen.items():
            apart, noise = np.array(away), 0.01 * np.eye(2)
            factor, innovation = Factor(apart, {BALL: np.eye(2)}, noise), Innovation(apart, 2 * noise)
            team.disputes.on_sighting(robot, BALL, factor, innovation, apart, 0.01)


def votes(team: TeamJoint) -> dict[str, int]:
    return {robot: team.majority(robot, BALL) for robot in team.disputes.seeing(BALL)}


@pytest.mark.parametrize(
    ("since", "away", "right"), [(1.0, 3.0, 1), (6.0, 3.0, 0), (1.0, 0.3, 0)], ids=["lately", "long ago", "not apart"]
)
def test_of_two_alone_who_sees_an_object_where_it_is_expected_is_right_if_a_third_saw_it_lately(
    since: float, away: float, right: int
) -> None:
    """Before, both counted the same, and a robot that did not know where it was drew the object half-way to itself."""
    team = TeamJoint()
    watch(team, 5.0, {"robot/r2": (0.0, 0.0), "robot/r3": (0.0, 0.0)})
    watch(team, since, {"robot/r2": (0.0, 0.0)})
    watch(team, 5.0, {"robot/r1": (away, 0.0), "robot/r2": (0.0, 0.0)})
    assert votes(team) == {"robot/r1": -right, "robot/r2": right}


def test_robots_that_see_an_object_at_several_places_are_no_majority() -> None:
    """Before, two that differed from a third outvoted it, though they differed from each other as well."""
    team = TeamJoint()
    watch(team, 5.0, {"robot/r1": (-3.0, 0.0), "robot/r2": (0.0, 0.0), "robot/r3": (3.0, 0.0)})
    assert votes(team) == dict.fromkeys(("robot/r1", "robot/r2", "robot/r3"), 0)


def test_who_looks_no_more_outvotes_nobody_together_with_one_that_looks() -> None:
    team = TeamJoint()
    watch(team, 5.0, {"robot/r1": (3.0, 0.0), "robot/r2": (0.0, 0.0)})
    watch(team, 3.0, {"robot/r3": (3.0, 0.0), "robot/r2": (0.0, 0.0)})
    assert votes(team) == dict.fromkeys(("robot/r2", "robot/r3"), 0)


def test_who_has_just_come_to_see_an_object_does_not_end_a_dispute_about_it() -> None:
    """It differed from neither side yet, and counted for both: so a liar was believed, and drew the object and who sees it along."""
    team, sides = TeamJoint(), {"robot/r1": (0.5, 0.0), "robot/r2": (0.0, 0.0)}
    watch(team, 5.0, sides)
    watch(team, 0.5, {**sides, "robot/r3": (0.0, 0.0)})
    assert votes(team) == {"robot/r1": 0, "robot/r2": 0, "robot/r3": 1}
    assert set(team.disputing(BALL)) == {frozenset({"robot/r1"}), frozenset({"robot/r2"})}
    watch(team, 5.0, {**sides, "robot/r3": (0.0, 0.0)})
    assert votes(team) == {"robot/r1": -1, "robot/r2": 1, "robot/r3": 1}


def test_who_tells_an_object_aside_of_where_it_was_agreed_leads_it_no_farther_than_that_and_moves_no_robot() -> None:
    """Before, it took the object and the robot that sees it along, a step in each tick."""
    team, step = new_team(), 0.5
    settle(team, 1, {"robot/r2": HERE})
    for tick in range(2, 2 * TICKS):
        x, y = team.marginal(BALL).mean
        settle(team, tick, {"robot/r1": (x + step, y), "robot/r2": HERE}, sure=25.0)
    assert off(team, BALL, HERE) < 2 * step
    assert moved(team) < step


def test_what_a_disputed_object_has_moved_is_taken_back() -> None:
    """Before, robots stayed where a liar had led them by the object until it was found out."""
    team, tick, farthest = new_team(), 1, 0.0
    settle(team, tick, {"robot/r2": HERE})
    while not team.disputing(BALL):
        (x, y), farthest, tick = team.marginal(BALL).mean, moved(team), tick + 1
        settle(team, tick, {"robot/r1": (x + 0.5, y), "robot/r2": HERE}, sure=25.0)
    assert moved(team) < 0.5 * farthest


def test_nobody_has_placed_an_object_for_others_while_it_is_disputed() -> None:
    """Before, a third robot, which was right, was not believed for a minute: it led the object too far from where the liar had it."""
    team = of_walks(0.1)
    for tick in range(1, 10):
        settle(team, tick, {"robot/r1": HERE, "robot/r2": HERE if tick < 6 else None})
    assert team.is_alone("robot/r3", BALL) is False  # r1 looks
    assert team.is_alone("robot/r1", BALL)
    for tick in range(10, 20):
        settle(team, tick, {"robot/r1": THERE, "robot/r2": HERE})
    assert team.disputing(BALL)
    for tick in range(20, 23):
        settle(team, tick, {"robot/r3": HERE})
    assert team.disputes.seeing(BALL) == ["robot/r3"]
    assert not team.is_alone("robot/r3", BALL)


def test_an_object_is_where_two_see_it_and_not_where_a_third_one_does() -> None:
    team = new_team()
    for tick in range(1, TICKS):
        settle(team, tick, {"robot/r1": THERE, "robot/r2": HERE, "robot/r3": HERE}, sure=25.0)
    assert off(team, BALL, HERE) < 0.3
    assert moved(team) < 0.2
    assert not team.disputing(BALL)


def test_an_object_that_was_placed_absurdly_far_away_is_where_the_next_robot_sees_it_and_that_is_not_to_blame() -> None:
    """Before, its variance became the square of the way back, which no joint keeps: the honest robot was left out for it."""
    team = new_team()
    for tick in range(1, 10):
        settle(
            team,
            tick,
            {"robot/r1": (1e6, 2e6) if tick < 4 or tick % 2 else None, "robot/r2": HERE if tick >= 4 else None},
        )
    for tick in range(10, 14):
        settle(team, tick, {"robot/r2": HERE})
    assert off(team, BALL, HERE) < 0.3


@pytest.mark.parametrize("vague", [{"range_variance": 1e12}, {"bearing_variance": 1e12}, {"biases": (Bias(1e6, 5.0),)}])
def test_who_sees_an_object_that_was_placed_absurdly_vaguely_is_not_to_blame(vague: dict[str, Any]) -> None:
    """Before, the walk of the object lost all digits, and the honest robot's sighting was refused as what leaves no Gaussian."""
    team = new_team()
    for tick in range(1, 20):
        lie = [replace(sees("robot/r1", BALL, THERE), **vague)] if tick < 4 or tick % 2 else []
        honest = [sees("robot/r2", BALL, HERE)] if tick >= 4 else []
        told = {"robot/r1": lie, "robot/r2": honest}
        team.settle(tick, 1.0, [evidence_of(robot, tick, *told.get(robot, [])) for robot in PLACES])
    assert off(team, BALL, HERE) < 0.3


def stands(tick: int) -> Place:
    return HERE


def is_kicked(tick: int) -> Place:
    return HERE if tick % 20 < 10 else THERE


def rolls(tick: int) -> Place:
    return 0.3 * abs((tick + 10) % 20 - 10), 2.0


@pytest.mark.parametrize("motion", [stands, is_kicked, rolls])
def test_honest_robots_hardly_dispute_how_an_object_moves(motion: Callable[[int], Place]) -> None:
    """One of a thousand comparisons says so by chance, and counts for five seconds."""
    disputed = []
    for first in range(0, 800, 100):
        team = new_team()
        for tick in range(first + 1, first + 2 * TICKS):
            place = motion(tick)
            settle(team, tick, {"robot/r1": place, "robot/r2": place, "robot/r3": place if tick % 3 else None})
            disputed += [team.majority(robot, BALL) <= 0 for robot in list(PLACES)[:3]]
    assert np.mean(disputed) < 0.01


def test_an_object_that_only_a_doubted_robot_has_placed_is_where_another_one_sees_it() -> None:
    """Before, the second one was left out as long as the first one's place was believed to be sure."""
    team = new_team()
    for tick in range(1, TICKS):
        x, y = team.marginal(BALL).mean if team.knows(BALL) else HERE
        settle(team, tick, {"robot/r1": (x + 0.1, y)}, noise=0.0)
    assert team.doubts("robot/r1")
    assert off(team, BALL, HERE) > 1.0
    for tick in range(TICKS, TICKS + 3):
        settle(team, tick, {"robot/r2": HERE})
    assert off(team, BALL, HERE) < 0.3


def of_walks(drift: float) -> TeamJoint:
    """The team, which was told how far objects walk in a second, and that they do not roll."""
    team = TeamJoint(Objects(drift, model="walk"))
    team.settle(0, 1.0, [evidence_of(robot, 0) for robot in PLACES])
    return team


def led_alone(team: TeamJoint, ticks: int, step: float) -> list[float]:
    """How far the ball is from where all saw it, while one robot tells it aside of where the team has it, with fresh noise."""
    away = []
    for tick in range(1, 10):
        settle(team, tick, dict.fromkeys(PLACES, HERE))
    for tick in range(10, 10 + ticks):
        x, y = team.marginal(BALL).mean
        settle(team, tick, {"robot/r1": (x + step, y)})
        away.append(off(team, BALL, HERE))
    return away


@pytest.mark.parametrize("step", [0.1, 0.3, 1.0, 3.0])
def test_one_robot_leads_an_object_that_walks_no_farther_than_that_goes_and_no_second_time(step: float) -> None:
    """Before, it was led up to 78 units away."""
    drift, ticks = 0.1, 60
    away = led_alone(of_walks(drift), ticks, step)
    walked = np.sqrt(quantile(GATE, 2) * (drift**2 * np.arange(1, ticks + 1) + 0.1))
    assert (np.array(away) < walked).all()
    assert away[-1] < max(0.3, 0.5 * walked[-1])


def test_who_has_led_an_object_too_far_is_believed_about_it_again_once_another_one_sees_it_there() -> None:
    team = of_walks(0.1)
    led_alone(team, 60, 1.0)
    for tick in range(70, 90):
        settle(team, tick, {"robot/r1": THERE, "robot/r2": THERE})
    assert off(team, BALL, THERE) < 0.3
    for tick in range(90, 120):
        settle(team, tick, {"robot/r1": THERE})
    assert off(team, BALL, THERE) < 0.3
    assert team.seen[BALL] == 0.0


def test_an_object_that_walks_as_told_is_followed_by_one_robot_alone() -> None:
    errors = []
    for seed in range(8):
        team, draw, place = of_walks(0.3), np.random.default_rng(seed).normal, np.array(HERE)
        for tick in range(1, 120):
            place = place + 0.3 * draw(size=2)
            at = float(place[0]), float(place[1])
            settle(team, tick, {"robot/r1": at} if tick > 3 else dict.fromkeys(PLACES, at))
            errors.append(off(team, BALL, at))
    assert np.sqrt(np.mean(np.square(errors))) < 0.3


def test_what_a_robot_has_moved_an_object_is_taken_back_once_more_robots_see_that_elsewhere() -> None:
    team, tick = of_walks(0.3), 0
    while team.majority("robot/r1", BALL) >= 0 and tick < 40:
        tick += 1
        x, y = team.marginal(BALL).mean if BALL in team.joint else HERE
        others = dict.fromkeys(["robot/r2", "robot/r3"], HERE) if tick < 4 or tick > 16 else {}
        settle(team, tick, {"robot/r1": (x + 0.5, y) if tick > 3 else HERE, **others})
    assert team.majority("robot/r1", BALL) < 0
    moved_by_it, _ = team.influence.moved("robot/r1")
    assert not moved_by_it[-2:].any()  # robots come first, then the ball


def ball_without(team: TeamJoint) -> bool:
    """Whether the ball, which one robot led along after all saw it, is where the others saw it once that one is left out."""
    for tick in range(1, 14):
        others = dict.fromkeys(list(PLACES)[1:], HERE) if tick < 10 else {}
        settle(team, tick, {"robot/r1": HERE if tick < 10 else (HERE[0] + 0.1 * (tick - 9), HERE[1]), **others})
    team.leave_out(frozenset({"robot/r1"}))
    return BALL in team.joint and off(team, BALL, HERE) < 0.1


def test_an_object_that_others_have_placed_stays_when_one_who_saw_it_is_left_out() -> None:
    """Before, it was forgotten, and began anew where the next robot told it; so is still one that may move in any way."""
    assert ball_without(of_walks(0.1))
    assert not ball_without(new_team())


def test_who_is_left_out_has_no_vote_on_where_an_object_is() -> None:
    """Before, an object that another robot had seen once was forgotten, because one that was left out saw it elsewhere."""
    team = new_team()
    settle(team, 1, {"robot/r2": HERE})
    for _ in range(2):
        team.trust.judge("robot/r1", BALL, agrees=False)
    team.left_out = frozenset({"robot/r1"})
    team.forget_objects()
    assert BALL in team.joint


def by_one_number(kind: Kind, observer: str, at: Place, *, sure: float = 1.0, noise: float = 0.0) -> Relative:
    """Where a robot sees the ball, by its range or its bearing alone."""
    full = sees(observer, BALL, at)
    value, variance = (full.range, full.range_variance) if kind == "range" else (full.bearing, full.bearing_variance)
    return measured(kind, observer, BALL, (value + noise * math.sqrt(variance),), (variance / sure,))


@pytest.mark.parametrize("sure", [1.0, 25.0])
@pytest.mark.parametrize(("kind", "way"), [("bearing", (1.0, -1.0)), ("range", (1.0, 1.0))])
def test_who_tells_an_object_aside_by_one_number_does_not_lead_it_away(kind: Kind, way: Place, sure: float) -> None:
    """Before, it took the object 2 units away by bearings, until that was forgotten, and the robot that sees it was never heard."""
    team, worst = new_team(), 0.0
    settle(team, 1, {"robot/r2": HERE})
    for tick in range(2, TICKS):
        x, y = team.marginal(BALL).mean
        lie = by_one_number(kind, "robot/r1", (x + way[0], y + way[1]), sure=sure)
        told = [evidence_of("robot/r1", tick, lie), evidence_of("robot/r2", tick, sees("robot/r2", BALL, HERE))]
        team.settle(tick, 1.0, [*told, *(evidence_of(robot, tick) for robot in ("robot/r3", "robot/r4"))])
        worst = max(worst, off(team, BALL, HERE))
    assert worst < 1.5 * math.hypot(*way)
    assert moved(team) < math.hypot(*way)


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_honest_robots_hardly_dispute_what_one_of_them_measures_by_one_number(kind: Kind) -> None:
    disputed = []
    for seed in range(4):
        team, draw = new_team(), np.random.default_rng(seed).normal
        for tick in range(1, 2 * TICKS):
            one = by_one_number(kind, "robot/r1", HERE, noise=draw())
            others = [sees(robot, BALL, (2.0 + 0.1 * draw(), 2.0 + 0.1 * draw())) for robot in ("robot/r2", "robot/r3")]
            told = [evidence_of(of.observer, tick, of) for of in (one, *others)]
            team.settle(tick, 1.0, [*told, evidence_of("robot/r4", tick)])
            disputed += [team.majority(robot, BALL) <= 0 for robot in list(PLACES)[:3]]
    assert np.mean(disputed) < 0.01


symmetric = (
    st.lists(st.floats(-3, 3), min_size=4, max_size=4).map(lambda r: np.reshape(r, (2, 2))).map(lambda r: r @ r.T)
)


@given(symmetric, symmetric)
def test_what_both_tell_is_the_inverse_of_both_variances_together(one: Array, other: Array) -> None:
    assume(min(np.linalg.eigvalsh(one)[0], np.linalg.eigvalsh(other)[0]) > 1e-3)
    both, freedom = told_by_both(one, other)
    assert freedom == 2
    np.testing.assert_allclose(both, np.linalg.inv(np.linalg.inv(one) + np.linalg.inv(other)), rtol=1e-6, atol=1e-9)


@given(st.floats(0, math.pi), st.floats(0, math.pi), symmetric)
def test_of_a_line_of_sight_both_tell_what_is_across_it_and_two_lines_always_meet(
    one: float, other: float, full: Array
) -> None:
    lines = [np.array([math.cos(angle), math.sin(angle)]) for angle in (one, other)]
    assume(abs(lines[0] @ lines[1]) < 0.99 and np.linalg.eigvalsh(full)[0] > 1e-3)
    along = np.outer(lines[0], lines[0])
    both, freedom = told_by_both(along, full)
    variance = 1.0 + lines[0] @ np.linalg.inv(full) @ lines[0]
    assert freedom == 1
    np.testing.assert_allclose(both, along / variance, rtol=1e-6, atol=1e-9)
    assert told_by_both(along, np.outer(lines[1], lines[1]))[1] == 0
