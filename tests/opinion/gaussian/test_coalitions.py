"""Coalitions as the gate of a joint: a lone voice against the prediction is left out, two that agree win over it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.gaussian.choosing import choose_evidence
from blackboard.opinion.gaussian.coalitions import PREDICTION, about, choose
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import HEADING, STATES, Motion, Nuisance, entering
from blackboard.opinion.grid import Array
from tests.opinion.gaussian import driving
from tests.opinion.gaussian.square import PLACES, compass, evidence_of, increment_at, new_team, sees


def place(x: float, y: float) -> Moments:
    return Moments(np.array([x, y]), np.eye(2) * 0.3**2)


def test_opinions_that_agree_are_members_and_others_are_not() -> None:
    chosen = choose({PREDICTION: place(0, 0), "a": place(6, 0), "b": place(6.2, 0.1)}, Coalition())
    assert chosen.members == {"a", "b"}
    assert chosen.outvoted
    assert sum(chosen.components) == pytest.approx(1.0)
    chosen = choose({PREDICTION: place(0, 0), "a": place(6, 0), "b": place(0.2, 0.1)}, Coalition())
    assert chosen.members == {PREDICTION, "b"}
    assert not chosen.outvoted


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_whatever_the_opinions_are_the_choice_is_one(seed: int) -> None:
    chance = np.random.default_rng(seed)
    opinions = {}
    for name in (PREDICTION, "a", "b", "c"):
        root = chance.normal(0, 10.0 ** chance.uniform(-3, 2), (2, 2))
        opinions[name] = Moments(chance.normal(0, 10.0 ** chance.uniform(-2, 3), 2), root @ root.T + np.eye(2) * 1e-8)
    chosen = choose(opinions, Coalition())
    assert chosen.members | chosen.others == opinions.keys()
    assert not chosen.members & chosen.others
    assert sum(chosen.components) == pytest.approx(1.0)
    shifted = {name: Moments(opinion.mean + [3.0, -7.0], opinion.covariance) for name, opinion in opinions.items()}
    assert choose(shifted, Coalition()).members == chosen.members


@pytest.mark.parametrize("piece", [increment_at(3.0, 4.0), sees("robot/r2", "robot/r1", (3.0, 4.0))])
def test_what_a_piece_says_of_a_place_does_not_depend_on_what_was_believed_of_it(piece: Increment | Relative) -> None:
    source = "robot/r1" if isinstance(piece, Increment) else piece.observer
    claimed = about(new_team().joint, "robot/r1", {source: piece}, {})[source]
    assert claimed.mean == pytest.approx((3.0, 4.0), abs=0.05)
    assert math.sqrt(claimed.covariance[0, 0]) < 0.5


def test_what_an_increment_says_of_the_heading_alone_is_no_opinion_on_a_place() -> None:
    heading = increment_at(0, 0)
    heading = replace(heading, information=np.diag([0, 0, 100.0, *[0.0] * (STATES - 3)]))
    assert about(new_team().joint, "robot/r1", {"robot/r1": heading}, {}) == {}


def carried(*relatives: Relative, own: Array | None = None) -> TeamJoint:
    """Robot r1 may have been carried away; what its mates see of it, and what it says itself."""
    team = new_team()
    by = {robot: tuple(r for r in relatives if r.observer == robot) for robot in PLACES}
    increments = {"robot/r1": None if own is None else increment_at(*own)}
    team.settle(1, 1.0, [evidence_of(robot, 1, *by[robot], increment=increments.get(robot)) for robot in PLACES])
    return team


@pytest.mark.parametrize("things", [[], ["object/can"]])
def test_a_compass_and_what_a_robot_sees_of_an_object_are_not_outvoted_about_its_place(things: list[str]) -> None:
    """One liar was enough for a heading that fitted and for sightings to be left out, and for the object to be forgotten."""
    team = new_team()
    for tick in range(1, 12):
        seen = [sees("robot/r2", thing, (8.0, 2.0)) for thing in things]
        news = [replace(evidence_of("robot/r2", tick, *seen), increment=compass())]
        for robot, at in {"robot/r1": (5.0, 0.0), "robot/r3": (5.0, 0.0), "robot/r4": (5.0, -2.0)}.items():
            news.append(evidence_of(robot, tick, sees(robot, "robot/r2", at), increment=increment_at(*PLACES[robot])))
        verdicts = [verdict for verdict in team.settle(tick, 1.0, news) if verdict.source == "robot/r2"]
        assert {verdict.subject: verdict.taken for verdict in verdicts} == dict.fromkeys(["robot/r2", *things], True)
        assert team.pose("robot/r2").covariance[HEADING, HEADING] < 0.03**2
    for thing in things:
        assert team.marginal(thing).mean == pytest.approx((8.0, 2.0), abs=0.3)


def test_one_voice_against_the_prediction_is_left_out() -> None:
    team = carried(sees("robot/r2", "robot/r1", (4.0, 4.0)))
    assert team.marginal("robot/r1").mean == pytest.approx((0.0, 0.0), abs=0.05)
    assert [v.taken for v in team.tally.verdicts] == [False]


def test_two_mates_that_agree_win_over_the_prediction_and_a_third_that_does_not_is_named() -> None:
    here, there = (4.0, 4.0), (-9.0, 0.0)
    team = carried(
        sees("robot/r2", "robot/r1", here), sees("robot/r3", "robot/r1", here), sees("robot/r4", "robot/r1", there)
    )
    assert team.marginal("robot/r1").mean == pytest.approx(here, abs=0.3)
    verdicts = {v.source: v for v in team.tally.verdicts}
    assert verdicts["robot/r2"].taken
    assert verdicts["robot/r3"].taken
    assert verdicts["robot/r4"].outvoted_by == ("robot/r2", "robot/r3")
    choice = team.tally.choices["robot/r1"]
    assert choice.outvoted
    assert len(choice.components) == 4


def test_mates_that_err_together_are_one_voice() -> None:
    """What two mates say of a robot is no coalition against it where both may be off in the same way."""
    counts = {}
    for shared in (0.0, 9.0):
        team = new_team()
        axes = [team.joint.blocks[robot].start + axis for robot in ("robot/r2", "robot/r3") for axis in (0, 1)]
        team.joint.covariance[np.ix_(axes, axes)] += 9.0 * np.eye(4)
        for first, second in ((0, 2), (1, 3)):
            team.joint.covariance[axes[first], axes[second]] += shared
            team.joint.covariance[axes[second], axes[first]] += shared
        away = (0.0, 9.7)
        team.settle(
            1,
            1.0,
            [
                evidence_of(r, 1, sees(r, "robot/r1", away), variance=9.04)
                if r in ("robot/r2", "robot/r3")
                else evidence_of(r, 1)
                for r in PLACES
            ],
        )
        counts[shared] = team.tally.outvoted
    assert counts == {0.0: 1, 9.0: 0}


def test_a_robot_that_lies_of_its_own_place_is_outvoted_by_those_who_see_it() -> None:
    true = PLACES["robot/r1"]
    team = carried(sees("robot/r2", "robot/r1", true), sees("robot/r3", "robot/r1", true), own=np.array([6.0, -6.0]))
    assert team.marginal("robot/r1").mean == pytest.approx(true, abs=0.2)
    assert not any(v.taken for v in team.tally.verdicts if v.kind == "increment")


def test_a_robot_that_was_carried_away_is_believed_once_a_mate_confirms_it() -> None:
    here = (4.0, 4.0)
    team = carried(sees("robot/r2", "robot/r1", here), own=np.array(here))
    assert team.marginal("robot/r1").mean == pytest.approx(here, abs=0.3)
    assert team.tally.outvoted == 1


def test_those_whom_most_of_the_team_contradicts_form_no_coalition() -> None:
    team = new_team()
    team.left_out = frozenset({"robot/r2", "robot/r3"})
    here = (4.0, 4.0)
    news = {
        robot: evidence_of(robot, 1, *((sees(robot, "robot/r1", here),) if robot in team.left_out else ()))
        for robot in PLACES
    }
    assert choose_evidence(team, news, dict.fromkeys(PLACES, Motion()), set(PLACES)) == {}


def test_a_robot_that_enters_with_a_lie_is_outvoted_in_the_same_tick() -> None:
    """Its mates see it from places that they know, and it says that it is 8 units beside."""
    team = TeamJoint()
    vague = np.diag([2.0, 2.0, 0.0004])
    entering_at = {robot: np.array([*at, 0.0]) for robot, at in PLACES.items()}
    entering_at["robot/r1"] = np.array([8.0, 0.0, 0.0])
    reports = [
        replace(
            evidence_of(robot, 0, *(sees(robot, other, PLACES[other]) for other in PLACES if other != robot)),
            belief=entering(Moments(pose, vague), Nuisance()),
        )
        for robot, pose in entering_at.items()
    ]
    team.settle(0, 1.0, reports)
    team.settle(1, 1.0, [replace(report, tick=1) for report in reports])
    assert team.tally.outvoted == 1
    for robot, at in PLACES.items():
        assert team.marginal(robot).mean == pytest.approx(at, abs=0.8), robot


def others_error(seed: int, lie: float) -> float:
    """RMSE of four honest robots beside a fifth that says of its place, in all that it sends, that it is `lie` units beside."""
    robots = driving.team(5, seed)
    liar, team, squared = robots[2], TeamJoint(), []
    away = np.array([0.0, lie, *[0.0] * (STATES - 2)])
    for tick in range(20):
        reports = driving.reports_of(robots, tick)
        said = next(report for report in reports if report.robot == liar.name)
        assert said.belief is not None
        false = replace(
            said,
            belief=Moments(said.belief.mean + away, said.belief.covariance),
            increment=said.increment and replace(said.increment, reference=said.increment.reference + away),
        )
        team.settle(tick, 1.0, [false if report is said else report for report in reports])
        squared += [float(((team.marginal(r.name).mean - r.place) ** 2).sum()) for r in robots if r is not liar]
    return math.sqrt(np.mean(squared))


@pytest.mark.team
def test_a_liar_of_five_raises_the_error_of_the_others_by_a_fifth_at_most() -> None:
    honest, lying = (np.mean([others_error(seed, lie) for seed in range(3)]) for lie in (0.0, 8.0))
    assert lying <= 1.2 * honest


def test_two_that_contradict_each_other_do_not_meet_in_an_object() -> None:
    """Robot r1 lies by 9 units of its place; r2 sees it and the ball, which r1 has entered where it believes itself to see it."""
    team = TeamJoint()
    lie = {"robot/r1": (9.0, 0.0)}
    ball = (2.0, 2.0)

    def said(robot: str, tick: int, *relatives: Relative) -> Evidence:
        pose = Moments(np.array([*lie.get(robot, PLACES[robot]), 0.0]), np.diag([0.25, 0.25, 0.0004]))
        return replace(evidence_of(robot, tick, *relatives), belief=entering(pose, Nuisance()))

    team.settle(0, 1.0, [said("robot/r1", 0, sees("robot/r1", "object/ball", ball)), said("robot/r2", 0)])
    for tick in range(1, 6):
        relatives = sees("robot/r2", "robot/r1", PLACES["robot/r1"]), sees("robot/r2", "object/ball", ball)
        reports = [said("robot/r1", tick, sees("robot/r1", "object/ball", ball)), said("robot/r2", tick, *relatives)]
        team.settle(tick, 1.0, reports)
    assert team.marginal("robot/r2").mean == pytest.approx(PLACES["robot/r2"], abs=0.05)


def test_the_objects_of_a_robot_that_is_left_out_enter_again_without_it() -> None:
    team = new_team()
    team.settle(
        1, 1.0, [evidence_of(robot, 1, sees(robot, "object/ball", (2.0, 2.0))) for robot in ("robot/r1", "robot/r2")]
    )
    assert "object/ball" in team.joint
    team.leave_out(frozenset({"robot/r4"}))
    assert "object/ball" in team.joint, "r4 has not seen it"
    team.leave_out(frozenset({"robot/r1", "robot/r4"}))
    assert "object/ball" not in team.joint
    team.settle(2, 1.0, [evidence_of("robot/r2", 2, sees("robot/r2", "object/ball", (2.0, 2.0)))])
    assert team.marginal("object/ball").mean == pytest.approx((2.0, 2.0), abs=0.1)
