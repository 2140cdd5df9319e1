"""The team's joint belief: each piece of evidence counts once, whatever the network does."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments, squared_distance
from blackboard.opinion.gaussian.relation import Bias, Relative
from blackboard.opinion.gaussian.state import FADED, MAX_ERRORS, Objects
from blackboard.opinion.gaussian.strayed import PATIENCE
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import STATES, Motion, entering
from blackboard.opinion.grid import Array, Grid
from tests.opinion.gaussian.driving import NUISANCE, Own

ROBOTS = ("robot/r1", "robot/r2", "robot/r3")


def story(seed: int, ticks: int = 6, robots: Sequence[str] = ROBOTS) -> list[list[Evidence]]:
    chance = np.random.default_rng(seed)
    team = [Own(name, np.array([0.0, 3.0 * k]), chance) for k, name in enumerate(robots)]
    return [[own.tick(tick, team) for own in team] for tick in range(ticks)]


def settled(reports: Sequence[Sequence[Evidence]]) -> TeamJoint:
    team = TeamJoint()
    for tick, of_tick in enumerate(reports):
        team.settle(tick, 1.0, of_tick)
    return team


def information(team: TeamJoint, subject: str) -> Array:
    return np.asarray(np.linalg.inv(team.marginal(subject).covariance))


# --- exactness -----------------------------------------------------------------------------------------------------------


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_where_all_is_linear_it_is_the_plain_joint_kalman_filter(seed: int) -> None:
    """The oracle: positions only, one matrix, every reading once, in one process."""
    chance = np.random.default_rng(seed)
    owns = [Own(name, np.array([0.0, 3.0 * k]), chance) for k, name in enumerate(ROBOTS)]
    team = TeamJoint()
    mean, covariance, doubted = np.concatenate([o.place for o in owns]), np.eye(6) * 0.5, set[str]()

    def update(row: Array, measured: Array, noise: Array) -> None:
        nonlocal mean, covariance
        gain = covariance @ row.T @ np.linalg.inv(row @ covariance @ row.T + noise)
        mean, covariance = mean + gain @ (measured - row @ mean), covariance - gain @ row @ covariance

    for tick in range(6):
        reports = [own.tick(tick, owns) for own in owns]
        if tick == 0:  # all enter with the belief after their first tick
            reports = [replace(r, relatives=()) for r in reports]
        team.settle(tick, 1.0, reports)
        doubted |= {name for name in ROBOTS if team.doubts(name)}
        mean = mean + np.array([1.0, 0.0] * 3)
        covariance = covariance + np.diag([0.04, 0.02] * 3)
        for k, own in enumerate(owns):
            for fix in own.fixed:
                update(np.eye(6)[2 * k : 2 * k + 2], fix, np.eye(2) * 0.25)
        for k, report in enumerate(reports):
            for relative in sorted(report.relatives, key=lambda r: r.subject):
                row = np.zeros((2, 6))
                other = ROBOTS.index(relative.subject)
                row[:, 2 * other : 2 * other + 2], row[:, 2 * k : 2 * k + 2] = np.eye(2), -np.eye(2)
                update(row, relative.range * relative.along(), np.eye(2) * 0.04)
    if team.tally.gated == 0 and not doubted:  # what is gated, or doubted as one in a thousand, is not the oracle's
        for k, name in enumerate(ROBOTS):
            got = team.marginal(name)
            assert np.allclose(got.covariance, covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2], rtol=1e-5)
            assert np.allclose(got.mean, mean[2 * k : 2 * k + 2], atol=1e-5)


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_the_joint_of_one_robot_is_its_own_filter(seed: int) -> None:
    reports = story(seed, ticks=8, robots=ROBOTS[:1])
    team = settled(reports)
    own = reports[-1][0].belief
    assert own is not None
    assert np.allclose(team.pose(ROBOTS[0]).mean, own.mean, atol=1e-9)
    assert np.allclose(team.pose(ROBOTS[0]).covariance, own.covariance, atol=1e-9)


# --- once ----------------------------------------------------------------------------------------------------------------


@given(st.integers(0, 1000), st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_neither_the_order_of_arrival_nor_repetition_changes_anything(seed: int, chance: object) -> None:
    reports = story(seed)
    plain, shaken = settled(reports), TeamJoint()
    for tick, of_tick in enumerate(reports):
        several = [*of_tick, *of_tick, *(reports[tick - 1] if tick else [])]
        chance.shuffle(several)  # type: ignore[attr-defined]
        shaken.settle(tick, 1.0, several)
        assert shaken.settle(tick, 1.0, of_tick) == []
    assert np.array_equal(plain.joint.mean, shaken.joint.mean)
    assert np.array_equal(plain.joint.covariance, shaken.joint.covariance)
    assert shaken.tally.repeated > 0


@given(st.integers(0, 1000), st.lists(st.tuples(st.integers(1, 5), st.integers(0, 2)), max_size=8))
@settings(max_examples=20)
def test_what_is_lost_is_lost_and_never_adds(seed: int, lost: list[tuple[int, int]]) -> None:
    reports = story(seed)
    whole = settled(reports)
    less = settled([[e for k, e in enumerate(of_tick) if (t, k) not in lost] for t, of_tick in enumerate(reports)])
    if whole.tally.gated or less.tally.gated:
        return
    for name in ROBOTS:
        if (5, ROBOTS.index(name)) in lost:
            continue  # not yet moved to the last tick
        worse = information(whole, name) - information(less, name)
        assert np.linalg.eigvalsh(worse).min() > -0.05 * np.linalg.norm(information(whole, name))


def test_a_lost_report_loses_no_motion() -> None:
    reports = story(4)
    team = settled([[e for e in of_tick if e.robot != "robot/r2" or t in (0, 5)] for t, of_tick in enumerate(reports)])
    assert team.pose("robot/r2").mean[0] == pytest.approx(6.0, abs=1.5)
    assert team.tally.silent > 0


@pytest.mark.parametrize("seconds", [0.3, 1.0, 3.0, 6.0])
def test_who_drove_curves_while_nobody_heard_it_is_known_as_badly_as_its_way(seconds: float) -> None:
    """The sums of its way and turn do not say where the curves were: its mates were pulled along with a place that was not true."""
    robot, team, travelled = "robot/r1", TeamJoint(), Motion()
    pose = entering(Moments(np.zeros(3), np.diag([0.01, 0.01, 0.001])), NUISANCE)
    place, heading = np.zeros(2), 0.0
    for tick in range(101):
        turn = 0.09 if tick % 60 < 40 else -0.06  # left for 4 s, right for 2 s
        step = Motion(0.1, turn, 0.1, 0.1, along=1e-4, heading=1e-5)
        if tick:
            place = place + 0.1 * np.array([math.cos(heading + turn / 2), math.sin(heading + turn / 2)])
            heading, travelled = heading + turn, travelled.plus(step)
        if tick <= 20 or tick >= 20 + 10 * seconds:
            team.settle(tick, 0.1, [Evidence(robot, 0, tick, travelled, NUISANCE, pose, time=0.1 * tick)])
            assert squared_distance(team.marginal(robot).mean - place, team.marginal(robot).covariance) < 5.99


# --- comings and goings --------------------------------------------------------------------------------------------------


def test_a_late_robot_enters_with_its_belief_and_its_mates_gain() -> None:
    reports = story(7, ticks=5)
    late = settled([[e for e in of_tick if e.robot != "robot/r3" or t >= 3] for t, of_tick in enumerate(reports)])
    never = settled([[e for e in of_tick if e.robot != "robot/r3"] for of_tick in reports])
    assert late.subjects() == sorted(ROBOTS)
    assert np.trace(late.marginal("robot/r1").covariance) <= np.trace(never.marginal("robot/r1").covariance) + 1e-9


def test_a_new_epoch_replaces_the_robot_and_an_old_one_is_not_heard() -> None:
    reports = story(8, ticks=3)
    team = settled(reports)
    fresh = entering(Moments(np.array([20.0, 20.0, 0.0]), np.eye(3)), NUISANCE)
    old = replace(reports[2][0], tick=4)
    team.settle(3, 1.0, [Evidence("robot/r1", 1, 3, Motion(), NUISANCE, fresh, time=3.0)])
    assert team.marginal("robot/r1").mean == pytest.approx((20.0, 20.0))
    team.settle(4, 1.0, [old])
    assert team.marginal("robot/r1").mean == pytest.approx((20.0, 20.0))


def test_a_robot_that_is_lost_is_not_in_the_joint_until_it_has_one_hypothesis() -> None:
    team = TeamJoint()
    team.settle(0, 1.0, [Evidence("robot/r1", 0, 0, Motion(), NUISANCE)])
    assert team.subjects() == []
    assert not team.knows("robot/r1")
    belief = entering(Moments(np.zeros(3), np.eye(3)), NUISANCE)
    team.settle(1, 1.0, [Evidence("robot/r1", 0, 1, Motion(), NUISANCE, belief)])
    assert team.subjects() == ["robot/r1"]


def test_a_robot_without_a_position_gets_one_when_a_mate_sees_it() -> None:
    known = entering(Moments(np.array([3.0, 4.0, 0.0]), np.diag([0.01, 0.01, 0.0001])), NUISANCE)
    flat = entering(Moments(np.zeros(3), np.diag([1e6, 1e6, 0.001])), NUISANCE)
    team = TeamJoint()
    relatives = (Relative("robot/r1", "robot/r2", 2.0, math.pi / 2, 0.01, 0.001),)
    reports = [
        Evidence("robot/r1", 0, 0, Motion(), NUISANCE, known, None, relatives),
        Evidence("robot/r2", 0, 0, Motion(), NUISANCE, flat),
    ]
    team.settle(0, 1.0, reports)
    assert team.knows("robot/r2")
    assert team.marginal("robot/r2").mean == pytest.approx((3.0, 6.0), abs=1e-3)
    assert np.trace(team.marginal("robot/r2").covariance) == pytest.approx(0.02 + 0.01 + 4 * 0.0011, rel=0.02)


def test_an_object_enters_where_it_is_seen_spreads_and_is_forgotten() -> None:
    belief = entering(Moments(np.array([1.0, 1.0, 0.0]), np.diag([0.01, 0.01, 0.0])), NUISANCE)
    relatives = (Relative("robot/r1", "object/ball", 2.0, 0.0, 0.01, 0.0025),)
    team = TeamJoint(Objects(drift=0.5, kept=3.0))
    team.settle(0, 1.0, [Evidence("robot/r1", 0, 0, Motion(), NUISANCE, belief, None, relatives)])
    assert team.marginal("object/ball").mean == pytest.approx((3.0, 1.0), abs=1e-4)
    first = team.marginal("object/ball").covariance[0, 0]
    assert first == pytest.approx(0.02, rel=0.01)
    team.settle(1, 1.0, [])
    assert team.marginal("object/ball").covariance[0, 0] == pytest.approx(first + 0.25, rel=1e-6)
    for tick in (2, 3, 4):
        team.settle(tick, 1.0, [])
    assert "object/ball" not in team.subjects()


def test_an_object_that_is_said_to_stand_hardly_spreads() -> None:
    belief = entering(Moments(np.array([1.0, 1.0, 0.0]), np.diag([0.01, 0.01, 0.0])), NUISANCE)
    relatives = tuple(Relative("robot/r1", f"object/{name}", 2.0, 0.0, 0.01, 0.0025) for name in ("ball", "can"))
    team = TeamJoint(Objects(drift=0.5, drifts={"can": 0.0}))
    team.settle(0, 1.0, [Evidence("robot/r1", 0, 0, Motion(), NUISANCE, belief, None, relatives)])
    before = {name: team.marginal(f"object/{name}").covariance.copy() for name in ("ball", "can")}
    team.settle(1, 1.0, [])
    assert team.marginal("object/can").covariance == pytest.approx(
        before["can"] + (0.5 / 32) ** 2 * np.eye(2), rel=1e-2
    )
    assert team.marginal("object/ball").covariance == pytest.approx(before["ball"] + 0.25 * np.eye(2), rel=1e-2)


def seen_at(places: Sequence[Sequence[float]], drift: float) -> list[tuple[Array, float]]:
    """Where a can is, and how fast it walks, after each of some ticks in which a robot that stands sees it at a place."""
    belief = entering(Moments(np.array([1.0, 1.0, 0.0]), np.diag([0.01, 0.01, 0.0])), NUISANCE)
    team, after = TeamJoint(Objects(drift=0.5, drifts={"can": drift})), []
    for tick, (x, y) in enumerate(places):
        way = np.array([x, y]) - belief.mean[:2]
        relatives = (Relative("robot/r1", "object/can", math.hypot(*way), math.atan2(way[1], way[0]), 0.01, 0.0025),)
        team.settle(tick, 0.2, [Evidence("robot/r1", 0, tick, Motion(), NUISANCE, belief, None, relatives)])
        after.append((team.marginal("object/can").mean, team.drift_of("object/can")))
    return after


@pytest.mark.parametrize("drift", [0.0, 0.5])
@pytest.mark.parametrize("there", [(8.0, 1.0), (1.0, 5.0), (-4.0, 1.0)])
def test_an_object_that_stood_is_where_it_was_kicked_to_with_the_second_sighting(
    there: tuple[float, float], drift: float
) -> None:
    after = seen_at([(3.0, 1.0)] * 80 + [there] * 20, drift)
    assert after[79][1] < 0.05
    for place, _ in after[81:]:
        assert place == pytest.approx(there, abs=0.2)
    assert after[-1][1] < 1.0


@given(st.lists(st.tuples(st.integers(20, 79), st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=4))
@settings(max_examples=30, deadline=None)
def test_single_misreads_neither_move_an_object_nor_let_it_seem_to_move(wild: list[tuple[int, float, float]]) -> None:
    """One in twenty ticks made a ball that stands 5 times as far off."""
    places = [(3.0, 1.0)] * 80
    for tick, x, y in wild:
        places[tick - tick % 2] = (x, y)  # never two in a row
    for place, drift in seen_at(places, 0.5)[20:]:
        assert place == pytest.approx((3.0, 1.0), abs=0.3)
        assert drift < 0.2


# --- lasting errors ------------------------------------------------------------------------------------------------------


def biased(observer: str, seconds: float, group: str = "", distance: float = 2.0) -> Relative:
    """What one of two robots sees of the other, with a range error that lasts."""
    subject, bearing = ("robot/r2", math.pi / 2) if observer == "robot/r1" else ("robot/r1", -math.pi / 2)
    return Relative(observer, subject, distance, bearing, 0.01, 0.001, 0.0, (Bias(0.1, seconds),), group)


def watching(relatives: Sequence[Relative], tick: int) -> list[Evidence]:
    """Robot r1 at (0, 0) and r2 at (0, 2), with what they say that they see."""
    places = {"robot/r1": (0.0, 0.0), "robot/r2": (0.0, 2.0)}
    poses = {name: Moments(np.array([*place, 0.0]), np.diag([0.01, 0.01, 1e-4])) for name, place in places.items()}
    beliefs = {name: entering(pose, NUISANCE) for name, pose in poses.items()}
    return [
        Evidence(
            name, 0, tick, Motion(), NUISANCE, beliefs[name], None, tuple(r for r in relatives if r.observer == name)
        )
        for name in places
    ]


def errors_of(team: TeamJoint) -> set[str]:
    """The groups whose lasting errors are in the joint."""
    return {block[2] for block in team.joint.blocks if isinstance(block, tuple)}


def test_what_a_sighting_brings_along_is_added_only_if_the_sighting_is_taken() -> None:
    for distance, taken in ((30.0, False), (2.0, True)):
        team = TeamJoint()
        (verdict,) = team.settle(0, 1.0, watching([biased("robot/r1", 100.0, distance=distance)], 0))
        assert verdict.taken == taken
        assert errors_of(team) == ({"robot/r2"} if taken else set())


def test_an_observer_has_as_many_lasting_errors_as_were_used_last() -> None:
    """Somebody who names a new group with every sighting does not make the joint grow."""
    team = TeamJoint()
    for tick in range(2 * MAX_ERRORS):
        mine = [biased("robot/r1", 1e12, group) for group in ("kept", f"g{tick}")]
        team.settle(tick, 0.2, watching([*mine, biased("robot/r2", 1e12)], tick))
    newest = [f"g{tick}" for tick in range(2 * MAX_ERRORS)][1 - MAX_ERRORS :]
    assert errors_of(team) == {"kept", "robot/r1", *newest}


def test_a_lasting_error_that_has_faded_is_dropped_and_the_beliefs_stay() -> None:
    team = TeamJoint()
    team.settle(0, 1.0, watching([biased("robot/r1", 7.0)], 0))
    before = team.marginal("robot/r2")
    for tick in range(1, 40):
        team.settle(tick, 1.0, watching([], tick))
        assert bool(errors_of(team)) == (tick <= FADED * 7.0)
    assert np.allclose(team.marginal("robot/r2").covariance, before.covariance)


# --- the gate ------------------------------------------------------------------------------------------------------------


def test_a_sighting_that_contradicts_is_left_out_and_named() -> None:
    reports = story(9, ticks=3)
    wrong = Relative("robot/r1", "robot/r2", 9.0, -1.5, 0.01, 0.0001)
    team = settled(reports)
    before = team.marginal("robot/r2").mean.copy()
    last = replace(reports[2][0], tick=3, increment=None, relatives=(wrong,))
    verdicts = team.settle(3, 1.0, [last, replace(reports[2][1], tick=3, increment=None, relatives=())])
    assert [(v.source, v.subject, v.taken) for v in verdicts] == [("robot/r1", "robot/r2", False)]
    assert team.marginal("robot/r2").mean == pytest.approx(before)


def test_a_robot_that_was_moved_is_opened_up_until_its_evidence_is_believed() -> None:
    reports = story(10, ticks=3)
    team = settled(reports)
    e = reports[2][0]
    gain = np.zeros((STATES, STATES))
    gain[0, 0] = gain[1, 1] = 100.0
    there = team.pose("robot/r1").mean.copy()
    there[:2] += 4.0
    for tick in range(3, 3 + 8 * PATIENCE):
        increment = Increment(there, gain, np.zeros(STATES))
        team.settle(tick, 1.0, [replace(e, tick=tick, increment=increment, relatives=())])
    assert team.tally.gated >= PATIENCE
    assert team.marginal("robot/r1").mean == pytest.approx(there[:2], abs=0.1)


def test_what_is_drawn_has_the_marginal_s_mean() -> None:
    team = settled(story(11))
    belief = team.drawn("robot/r1", Grid((100, 100), 0.25, (-5.0, -10.0)))
    assert belief.mean() == pytest.approx(team.marginal("robot/r1").mean, abs=0.05)
