"""Who keeps seeing its mates off moves itself alone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.offsets import MEMORY, Offsets
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import HEADING, Motion
from blackboard.opinion.grid import Array
from tests.opinion.gaussian import driving
from tests.opinion.gaussian.standing import LIAR, PLACES, says

BEGIN, END = 5, 40


def shifted(team: TeamJoint, robot: str, at: Array, lie: float, sides: int = 1) -> tuple[Relative, ...]:
    """It sees every mate `lie` aside of where the team has it, in turn to so many `sides`, from where it is by its own evidence."""
    angles = {mate: math.tau * (turn % sides) / sides for turn, mate in enumerate(sorted(PLACES.keys() - {robot}))}
    apart = {
        mate: team.marginal(mate).mean + [lie * math.cos(angle), lie * math.sin(angle)] - at
        for mate, angle in angles.items()
        if mate in team.subjects()
    }
    return tuple(
        Relative(robot, mate, math.hypot(x, y), math.atan2(y, x), 0.25, 0.0025) for mate, (x, y) in apart.items()
    )


def worst(lie: float, names: bool = True, sides: int = 1) -> tuple[float, set[str]]:
    """How far the farthest mate of a liar was taken along, and who was doubted. Without `names` it says that robots were seen."""
    team, farthest, doubted = TeamJoint(), 0.0, set[str]()
    for tick in range(END):
        lies = shifted(team, LIAR, PLACES[LIAR], lie, sides) if tick >= BEGIN else ()
        if not names:
            lies = tuple(replace(relative, subject="robot/?", mark=mark) for mark, relative in enumerate(lies))
        team.settle(tick, 0.2, [says(robot, tick, lies if robot == LIAR else ()) for robot in PLACES])
        doubted |= {robot for robot in PLACES if team.offsets.doubts(robot)}
        away = [float(np.hypot(*(team.marginal(mate).mean - at))) for mate, at in PLACES.items() if mate != LIAR]
        farthest = max(farthest, *away)
    return farthest, doubted


def test_who_sees_its_mates_aside_of_where_they_are_believed_to_be_does_not_take_them_along() -> None:
    assert worst(0.0) == (pytest.approx(0.0, abs=0.02), set()), (
        "an exact range is a little short: by the error of the place across"
    )
    farthest, doubted = worst(3.5)
    assert farthest < 0.1
    assert doubted == {LIAR}


@pytest.mark.parametrize("seed", range(8))
def test_a_robot_that_misreads_one_sighting_in_twenty_wildly_is_not_doubted(seed: int) -> None:
    """Each wild one counted as it was, so two of them in five seconds were a side that the robot keeps."""
    chance, team = np.random.default_rng(seed), TeamJoint()
    for tick in range(END):
        sightings = []
        for one in shifted(team, LIAR, PLACES[LIAR], 0.0) if tick >= BEGIN else ():
            far, bearing = one.range + 0.5 * chance.normal(), one.bearing + 0.05 * chance.normal()
            if chance.random() < 0.05:
                far, bearing = chance.uniform(0.5, 20.0), chance.uniform(-3.0, 3.0)
            sightings.append(replace(one, range=far, bearing=bearing))
        team.settle(tick, 0.2, [says(robot, tick, tuple(sightings) if robot == LIAR else ()) for robot in PLACES])
        assert not team.offsets.doubts(LIAR)


@pytest.mark.parametrize("names", [True, False], ids=["by name", "without names"])
@pytest.mark.parametrize("lie", [1.5, 2.0, 2.5, 2.75, 3.0, 3.5, 4.0, 6.0])
def test_smaller_lies_move_mates_by_less_and_larger_ones_are_refused(lie: float, names: bool) -> None:
    farthest, doubted = worst(lie, names)
    assert farthest < 0.92
    assert doubted <= {LIAR}


@pytest.mark.parametrize("sides", [2, 3, 4])
@pytest.mark.parametrize("lie", [0.5, 1.0, 1.5, 2.0])
def test_who_sees_each_mate_to_another_side_is_found_out_too(lie: float, sides: int) -> None:
    farthest, doubted = worst(lie, sides=sides)
    assert farthest < 1.5
    assert doubted == {LIAR}


def test_mates_that_are_off_to_different_sides_are_held_against_who_sees_them_but_for_any_one() -> None:
    assert not heard(Offsets(), 6.0, 0.0, 0.0)
    assert heard(Offsets(), 6.0, -6.0, 0.0)
    assert not heard(Offsets(), 0.3, -0.3, 0.0)


MATES = ("robot/a", "robot/b", "robot/c")


def heard(offsets: Offsets, *apart: float, aims: bool = True) -> bool:
    """An observer whose place has a variance of 1 sees exact mates so far (unit) to one side; whether it is doubted then."""
    joint = Joint.of(
        {LIAR: Moments(np.zeros(2), np.eye(2)), **dict.fromkeys(MATES, Moments(np.zeros(2), np.zeros((2, 2))))}
    )
    factors = [
        (mate, Factor(np.array([aside, 0.0]), {LIAR: -np.eye(2), mate: np.eye(2)}, 0.01 * np.eye(2)))
        for mate, aside in zip(MATES, apart, strict=True)
    ]
    offsets.on_sightings(LIAR, joint, factors, aims=aims)
    return offsets.doubts(LIAR)


def test_without_any_one_subject_the_others_still_say_all_that_they_say() -> None:
    """All share the error of the observer's place, so that each says nearly as much as all do."""
    assert heard(Offsets(), 4.2, 4.2, 4.2)
    assert not heard(Offsets(), 3.4, 3.4, 3.4)
    assert not heard(Offsets(), 9.0, 0.0, 0.0)


def test_who_moves_to_where_its_sightings_fit_is_doubted_for_some_seconds_more() -> None:
    offsets, doubted = Offsets(), [0.0]
    assert heard(offsets, 4.2, 4.2, 4.2)
    for tick in range(1, round(3 * MEMORY / 0.2)):
        offsets.pass_time(0.2)
        if heard(offsets, 0.0, 0.0, 0.0):
            doubted.append(tick * 0.2)
    assert max(doubted) == pytest.approx(MEMORY, abs=0.5)


def test_what_is_forgotten_of_a_robot_is_forgotten_of_those_who_saw_it() -> None:
    offsets = Offsets()
    heard(offsets, 9.0, 0.0, 0.0)
    offsets.forget(MATES[0])
    assert not heard(offsets, 0.0, 2.0, 2.0)


@pytest.mark.parametrize("aims", [True, False])
def test_in_a_team_of_ranges_alone_the_odometry_of_who_is_doubted_is_believed(aims: bool) -> None:
    """Nothing else shows how it is turned. Before, its heading was 2 to 3 rad off soon and for good, in a team with UWB alone."""
    team = TeamJoint()
    for tick in range(2 * BEGIN):
        if tick == BEGIN:
            heard(team.offsets, 9.0, 9.0, 9.0, aims=aims)
        motion = Motion(dt=0.2 * tick, moving=0.2 * tick)
        team.settle(tick, 0.2, [replace(says(robot, tick), travelled=motion) for robot in PLACES])
    assert team.doubts(LIAR)
    assert (LIAR in team.distrust) == aims
    assert (team.pose(LIAR).covariance[HEADING, HEADING] > 0.5) == aims


def test_who_is_doubted_keeps_no_other_from_saying_where_an_object_is() -> None:
    """Of two that contradict each other the one is believed that placed the object first, but not if it is doubted."""
    team, ball, witness, far = TeamJoint(), "object/ball", "robot/r0", np.array([6.0, 0.0])

    def said(robot: str, tick: int) -> Evidence:
        evidence = says(robot, tick)
        (x, y), observes = far * (robot == LIAR) - PLACES[robot], robot == LIAR or (robot == witness and tick >= BEGIN)
        relatives = (Relative(robot, ball, math.hypot(x, y), math.atan2(y, x), 0.25, 0.0025),) if observes else ()
        return replace(evidence, belief=says(robot, 0).belief, relatives=relatives)

    for tick in range(END // 2):
        if tick == BEGIN:
            heard(team.offsets, 4.2, 4.2, 4.2)
        team.settle(tick, 0.2, [said(robot, tick) for robot in PLACES])
        assert team.doubts(LIAR) == (tick >= BEGIN)
    assert {(verdict.source, verdict.taken) for verdict in team.tally.verdicts if verdict.subject == ball} == {
        (LIAR, False),
        (witness, True),
    }
    assert float(np.hypot(*team.marginal(ball).mean)) < 1.0


def rolling(doubted: int, aside: int = END) -> list[bool]:
    """For each tick whether a ball is believed to roll that all saw stand, and that a robot alone then sees go.

    From a tick on the robot is doubted; from another on it sees the ball 2 units farther on.
    """
    team, ball, doubted_at = TeamJoint(), "object/ball", list[bool]()

    def said(robot: str, tick: int) -> Evidence:
        way = [0.4 * max(0, tick - BEGIN) + 2.0 * (tick >= aside), 0.0]
        x, y = way - PLACES[robot]
        relatives = (Relative(robot, ball, math.hypot(x, y), math.atan2(y, x), 0.01, 1e-4),)
        return replace(says(robot, tick), relatives=relatives if robot == LIAR or tick < BEGIN else ())

    for tick in range(END):
        if tick == doubted:
            heard(team.offsets, 9.0, 9.0, 9.0)
        team.settle(tick, 0.2, [said(robot, tick) for robot in PLACES])
        doubted_at.append(team.velocity(ball) is not None)
    return doubted_at


def test_who_is_doubted_tells_nobody_how_an_object_moves() -> None:
    assert any(rolling(doubted=END))
    assert not any(rolling(doubted=BEGIN)[: BEGIN + int(MEMORY / 0.2)])


def test_of_who_is_found_out_it_is_forgotten_how_objects_move_though_its_newest_sightings_were_refused() -> None:
    doubted = rolling(doubted=25, aside=23)
    assert doubted[24]
    assert not any(doubted[25:])


def test_of_honest_robots_none_is_doubted() -> None:
    for seed in range(3):
        robots, team = driving.team(4, seed), TeamJoint()
        for tick in range(60):
            team.settle(tick, 1.0, driving.reports_of(robots, tick))
            assert not [robot.name for robot in robots if team.offsets.doubts(robot.name)]


def test_one_that_stops_is_believed_again() -> None:
    team, doubts = TeamJoint(), []
    for tick in range(END + round(5 * 5 * MEMORY)):
        lies = shifted(team, LIAR, PLACES[LIAR], 3.5) if BEGIN <= tick < END else ()
        team.settle(tick, 0.2, [says(robot, tick, lies if robot == LIAR else ()) for robot in PLACES])
        doubts.append(team.offsets.doubts(LIAR))
    assert any(doubts)
    assert not doubts[-1]


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 1000), st.floats(0.01, 10.0))
def test_what_is_considered_alone_stays_to_the_bit_and_the_rest_moves_as_ever(seed: int, noise: float) -> None:
    chance, whole = np.random.default_rng(seed), Joint()
    for name in ("a", "b", "c"):
        whole.add(name, Moments(chance.normal(size=3), np.eye(3)))
    root = chance.normal(size=(9, 12))
    whole.covariance = root @ root.T / 9
    part, before = whole.copy(), whole.copy()
    rows: dict[object, Array] = {"a": chance.normal(size=(2, 3)), "b": chance.normal(size=(2, 3))}
    factor = Factor(chance.normal(size=2), rows, noise * np.eye(2))
    whole.update(factor)
    part.update(factor, ["a"])
    assert np.array_equal(part.moments("b", "c").mean, before.moments("b", "c").mean)
    assert np.array_equal(part.moments("b", "c").covariance, before.moments("b", "c").covariance)
    assert part.moments("a").mean == pytest.approx(whole.moments("a").mean)
    assert part.moments("a").covariance == pytest.approx(whole.moments("a").covariance)
    assert float(np.linalg.eigvalsh(part.covariance)[0]) > -1e-9
