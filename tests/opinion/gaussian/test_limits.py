"""How much one robot's evidence may be worth, whatever it claims."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.limits import ROUGHLY, Limits
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Motion, Nuisance, entering
from tests.opinion.gaussian.driving import reports_of, team

SHARPEST = 0.5
SURE = st.floats(1e-6, 1e12)  # information
LIAR, MATE = "robot/liar", "robot/mate"


def began(place: tuple[float, float], variance: float) -> Moments:
    return entering(Moments(np.array([*place, 0.0]), np.diag([variance, variance, 1e-4])), Nuisance())


def claim(along: float, across: float, turn: float) -> Increment:
    """An increment that puts the place at (3, 0), with this information along two axes that are turned."""
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s], [s, c]])
    information = np.zeros((STATES, STATES))
    information[AXES, AXES] = (axes * [along, across]) @ axes.T
    off = np.zeros(STATES)
    off[0] = 3.0
    return Increment(np.zeros(STATES), information, information @ off)


def limited() -> TeamJoint:
    return TeamJoint(limits=Limits(SHARPEST))


claims = st.builds(claim, SURE, SURE, st.floats(0, 3))


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(claims, st.booleans(), SURE), min_size=1, max_size=12))
def test_what_a_robot_says_of_itself_is_never_worth_more_than_the_sharpest_sensor(
    said: list[tuple[Increment, bool, float]],
) -> None:
    team_joint, epoch = limited(), 0
    for tick, (increment, anew, sure) in enumerate(said):
        epoch += anew
        belief = began((0.0, 0.0), 1 / sure)
        team_joint.settle(tick, 0.2, [Evidence(LIAR, epoch, tick, Motion(), Nuisance(), belief, increment)])
        least = np.linalg.eigvalsh(team_joint.marginal(LIAR).covariance)[0]
        assert least >= SHARPEST**2 * (1 - 1e-3)


@settings(deadline=None, max_examples=40)
@given(st.lists(claims, min_size=1, max_size=8), st.floats(0.3, 30), st.floats(0.3, 30))
def test_nor_much_more_than_the_belief_that_it_tells_beside_it(said: list[Increment], x: float, y: float) -> None:
    """Its increments say how far its mates are moved, its belief is what they hold against it: so the two must fit."""
    team_joint, belief = limited(), began((0.0, 0.0), 1.0)
    belief.covariance[AXES, AXES] = np.diag([x, y])
    for tick, increment in enumerate(said):
        team_joint.settle(tick, 0.2, [Evidence(LIAR, 0, tick, Motion(), Nuisance(), belief, increment)])
    assert np.linalg.eigvalsh(team_joint.marginal(LIAR).covariance - ROUGHLY * np.diag([x, y]))[0] >= -1e-3


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_who_tells_as_its_own_gain_what_the_team_believes_of_it_makes_that_no_surer(share: float) -> None:
    """It tells as its belief that of the team, or a weighted mean of that and its own."""
    team_joint, own = limited(), began((0.0, 0.0), 9.0)
    for tick in range(30):
        told = own if tick == 0 else team_joint.joint.moments(LIAR)
        told = Moments(told.mean, (1 - share) * told.covariance + share * own.covariance)
        matrix = np.zeros((STATES, STATES))
        matrix[AXES, AXES] = np.linalg.inv(told.covariance[AXES, AXES])
        increment = Increment(told.mean, matrix, np.zeros(STATES)) if tick else None
        travelled = Motion(dt=0.2 * tick, moving=0.2 * tick)
        said = Evidence(LIAR, 0, tick, travelled, Nuisance(), told, increment, time=0.2 * tick)
        verdicts = team_joint.settle(tick, 0.2, [said])
        assert [(verdict.kind, verdict.taken) for verdict in verdicts] == [("echo", False)] * (tick > 0)
    assert np.linalg.eigvalsh(team_joint.marginal(LIAR).covariance)[0] > 0.9 * 9.0


def test_what_a_robot_gained_counts_where_it_believes_as_much() -> None:
    team_joint, information = limited(), 1.0
    for tick in range(10):
        belief = began((0.0, 0.0), 1.0 / information)
        increment = claim(1.0, 1.0, 0.0) if tick else None
        travelled = Motion(dt=0.2 * tick, moving=0.2 * tick)
        team_joint.settle(
            tick, 0.2, [Evidence(LIAR, 0, tick, travelled, Nuisance(), belief, increment, time=0.2 * tick)]
        )
        assert team_joint.marginal(LIAR).covariance == pytest.approx(
            max(1 / information, SHARPEST**2) * np.eye(2), rel=1e-3
        )
        information += 1.0


@settings(deadline=None, max_examples=60)
@given(SURE, SURE, st.floats(0.01, 30), st.lists(SURE, max_size=3))
def test_no_sighting_tells_a_place_better_than_the_sharpest_sensor(
    along: float, turn: float, distance: float, profile: list[float]
) -> None:
    spread = tuple((float(n), 1 / information) for n, information in enumerate(profile))
    sighting = Limits(SHARPEST).sighting(
        Relative(LIAR, MATE, distance, 0.0, 1 / along, 1 / turn, profile=spread), distance
    )
    least = SHARPEST**2 * (1 - 1e-9)
    assert sighting.range_variance >= least
    assert sighting.bearing_variance * max(distance, SHARPEST) ** 2 >= least
    assert all(variance >= least for _, variance in sighting.profile)


@given(SURE, SURE, st.floats(-1, 1), st.sampled_from(["position", "pose"]))
def test_nor_does_a_position_or_a_pose_that_is_seen(
    x: float, y: float, share: float, kind: Literal["position", "pose"]
) -> None:
    both = share * (1 / x / y) ** 0.5
    spread = (1 / x, both, 1 / y) if kind == "position" else (1 / x, both, 0.0, 1 / y, 0.0, 0.1)
    limited_spread = (
        Limits(SHARPEST).sighting(Relative(LIAR, MATE, 1.0, 0.0, 1.0, 1.0, kind=kind, spread=spread), 1.0).spread
    )
    first, cross, second = (limited_spread[0], limited_spread[1], limited_spread[2 if kind == "position" else 3])
    assert np.linalg.eigvalsh([[first, cross], [cross, second]])[0] >= SHARPEST**2 * (1 - 1e-9)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.integers(2, 4))
def test_evidence_within_the_limits_is_taken_as_it_is_to_the_bit(seed: int, number: int) -> None:
    free, bounded, robots = TeamJoint(), TeamJoint(limits=Limits(0.05)), team(number, seed)
    for tick in range(8):
        reports = reports_of(robots, tick)
        free.settle(tick, 1.0, reports)
        bounded.settle(tick, 1.0, reports)
    assert bounded.joint.mean.tobytes() == free.joint.mean.tobytes()
    assert bounded.joint.covariance.tobytes() == free.joint.covariance.tobytes()


@settings(deadline=None, max_examples=20)
@given(st.floats(1e-9, 1.0), st.floats(1e-9, 1.0), st.booleans())
def test_a_robot_that_begins_anew_each_tick_does_not_drag_its_mates_along(
    variance: float, noise: float, standing: bool
) -> None:
    """A mate that knows its place up to 1 stays where it is, up to what three opinions of the sharpest kind could do."""
    team_joint, place = limited(), 0.0
    for tick in range(100):
        place += 0.05
        relative = Relative(LIAR, MATE, 5.0, 0.0, noise, noise)
        epoch = 1 if standing else tick
        liar = Evidence(LIAR, epoch, tick, Motion(), Nuisance(), began((place - 5.0, 0.0), variance), None, (relative,))
        mate = Evidence(MATE, 1, tick, Motion(), Nuisance(), began((0.0, 0.0), 1.0))
        team_joint.settle(tick, 0.2, [liar, mate])
    share = 1 - team_joint.marginal(MATE).covariance[0, 0]
    assert share <= 1 - 1 / (1 + 5 / SHARPEST**2)
    assert abs(team_joint.marginal(MATE).mean[0]) < 2.0


def begun_again(before: float, mates: tuple[float, ...], claimed: float) -> float:
    """The variance of the place of a robot that begins again, and is certain of it, among mates that know theirs so well."""
    team_joint = limited()
    for tick, own in enumerate([before, claimed]):
        said = {LIAR: own} | {f"{MATE}{n}": variance for n, variance in enumerate(mates)}
        news = [
            Evidence(robot, tick if robot == LIAR else 0, tick, Motion(), Nuisance(), began((0.0, 0.0), variance))
            for robot, variance in said.items()
        ]
        team_joint.settle(tick, 0.2, news)
    return float(np.linalg.eigvalsh(team_joint.marginal(LIAR).covariance)[0])


@given(st.floats(1.0, 100.0), st.lists(st.floats(1.0, 100.0), min_size=2, max_size=5), SURE)
@settings(deadline=None, max_examples=20)
def test_who_begins_again_knows_no_more_than_it_did_or_than_two_mates_do(
    before: float, mates: list[float], sure: float
) -> None:
    """Before, it counted as the sharpest sensor, and outweighed five mates of which none had seen a landmark."""
    claimed = 1 / sure
    expected = max(claimed, min(before, sorted(mates)[1]), SHARPEST**2)
    assert begun_again(before, tuple(mates), claimed) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("before", "mates"), [(0.3, (9.0, 9.0, 9.0)), (9.0, (0.3, 0.3, 9.0)), (9.0, (9.0,))])
def test_a_robot_that_was_started_again_is_believed_to_know_its_place_as_it_or_as_two_others_did(
    before: float, mates: tuple[float, ...]
) -> None:
    assert begun_again(before, mates, 0.3) == pytest.approx(0.3)


def driven(objects: int) -> float:
    """How far a robot gets that drives 20 cells with so many objects that stay where they are beside it."""
    team_joint, travelled = limited(), Motion()
    for tick in range(100):
        travelled = travelled.plus(Motion(0.2, 0.0, 0.2, 0.2, along=0.01, across=0.001))
        relatives = [Relative(LIAR, f"object/{i:02}", 3.0 + i, 0.1 * i, 0.01, 0.01) for i in range(objects)]
        team_joint.settle(
            tick, 0.2, [Evidence(LIAR, 0, tick, travelled, Nuisance(), began((0, 0), 1.0), None, tuple(relatives))]
        )
    return float(team_joint.marginal(LIAR).mean[0])


def test_sixty_objects_that_nobody_else_sees_tell_their_observer_no_more_than_four() -> None:
    assert driven(60) == pytest.approx(driven(4), abs=0.5)


def test_an_increment_of_what_is_known_as_well_as_can_be_is_worth_nothing() -> None:
    limits = Limits(SHARPEST)
    limits.entering(LIAR, began((0.0, 0.0), SHARPEST**2))
    assert limits.increment(LIAR, claim(1.0, 1.0, 0.0), 1.0) is None
    copy = limits.copy()
    copy.drive(LIAR, Motion(1.0, 0.0, 1.0, 1.0, along=1.0, across=1.0), Nuisance())
    assert copy.increment(LIAR, claim(1.0, 1.0, 0.0), 1.0) is not None
    assert limits.increment(LIAR, claim(1.0, 1.0, 0.0), 1.0) is None


def test_the_record_of_a_robot_outlives_its_epochs() -> None:
    bounded, robots = TeamJoint(), team(4, 1)
    for tick in range(40):
        reports = reports_of(robots, tick)
        epoch = tick if tick > 5 else 0
        liar = reports[0]
        off = np.zeros(STATES)
        off[0] = 6.0
        assert liar.belief is not None
        lie = replace(liar, epoch=epoch, belief=Moments(liar.belief.mean + off, liar.belief.covariance))
        bounded.settle(tick, 1.0, [lie, *reports[1:]])
        robots[0].epoch = epoch
    assert bounded.subjects() == ["robot/r1", "robot/r2", "robot/r3"]
