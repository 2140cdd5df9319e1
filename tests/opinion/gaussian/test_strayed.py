"""Mates find a robot again whose wheels turned while it stood, and that has no fixes or landmarks."""

from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.state import ABSURD
from blackboard.opinion.gaussian.strayed import PATIENCE, Strayed, displacement_of
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, Motion, Nuisance, entering
from tests.opinion.gaussian.square import PLACES, compass, evidence_of, increment_at, new_team, sees

WAY = Motion(0.6, 0.0, 1.0, 1.0, along=0.01, across=0.01)  # of a tick, as r2's wheels measure it
HERE = PLACES["robot/r2"]  # where r2 stands
TURNS = PATIENCE  # ticks in which its wheels turn
LONG = 3 * PATIENCE  # ticks in all
VAGUE = 1.5  # the variance of a place that hardly contradicts another one three units away

Seen = tuple[str, str, tuple[float, float]]  # who sees whom, and where


def settle(
    team: TeamJoint,
    tick: int,
    *seen: Seen,
    fixed: tuple[float, float] | None = None,
    robots: int = 4,
    bearing: tuple[float, float] | None = None,
    heading: bool = False,
) -> None:
    """A tick in which `robots` see others, and all but r2 stand and know where; r2 does if it is `fixed` somewhere.

    `bearing` is where r1 sees r2, too, of which it tells the direction alone. With `heading` r2 has a compass.
    """
    news, draw = [], np.random.default_rng(tick).normal
    for robot, place in list(PLACES.items())[:robots]:
        relatives = [
            sees(robot, mate, (x + 0.1 * draw(), y + 0.1 * draw())) for by, mate, (x, y) in seen if by == robot
        ]
        if robot == "robot/r1" and bearing is not None:
            relatives.append(replace(sees(robot, "robot/r2", bearing), kind="bearing"))
        told = fixed if robot == "robot/r2" else place
        evidence = evidence_of(robot, tick, *relatives, increment=None if told is None else increment_at(*told))
        if robot == "robot/r2":
            # alone it knows its place worse and worse; or no worse than at the beginning, where it has a compass
            unsure = np.diag([VAGUE if heading else 0.04 + tick * 1.0] * 2 + [0.0004])
            belief = evidence.belief if fixed else entering(Moments(np.array([*led(tick), 0.0]), unsure), Nuisance())
            evidence = replace(evidence, travelled=WAY.times(min(tick, TURNS)), belief=belief)
            if heading and fixed is None:
                evidence = replace(evidence, increment=compass())
        news.append(evidence)
    team.settle(tick, 1.0, news)


def led(tick: int) -> tuple[float, float]:
    """Where its wheels lead r2."""
    return HERE[0] + min(tick, TURNS) * WAY.distance, HERE[1]


def off(team: TeamJoint, robot: str, at: tuple[float, float]) -> float:
    """How far the joint has a robot from a place."""
    return float(np.hypot(*(team.pose(robot).mean[AXES] - at)))


def spread(team: TeamJoint, robot: str) -> float:
    """The variance of a place, in all directions together."""
    return float(np.trace(team.pose(robot).covariance[AXES, AXES]))


@pytest.mark.parametrize("heading", [False, True])
def test_a_robot_that_mates_see_in_turn_is_where_they_see_it(heading: bool) -> None:
    """Before, a compass that fits in each tick said that the robot is where it is believed."""
    team = TeamJoint()
    team.settle(0, 1.0, [evidence_of(name, 0, variance=VAGUE if name == "robot/r2" else 0.04) for name in PLACES])
    for tick in range(1, 2 * LONG):
        settle(team, tick, ("robot/r1" if tick % 2 else "robot/r4", "robot/r2", HERE), heading=heading)
    assert off(team, "robot/r2", HERE) < 0.3
    assert off(team, "robot/r1", PLACES["robot/r1"]) < 0.1


def test_in_a_team_of_three_a_robot_that_one_mate_alone_sees_is_where_that_sees_it() -> None:
    team = TeamJoint()
    for tick in range(LONG):
        settle(team, tick, ("robot/r1", "robot/r2", HERE), robots=3)
    assert off(team, "robot/r2", HERE) < 0.3
    assert off(team, "robot/r1", PLACES["robot/r1"]) < 0.1


@pytest.mark.parametrize(("both", "strayed"), [(False, {"robot/r2"}), (True, set())])
def test_in_a_team_of_three_one_mate_is_enough_unless_it_contradicts_both_others(both: bool, strayed: set[str]) -> None:
    """A robot with GPS whose wheels measured nothing had fixes that fitted where it believed to be, so both others were widened."""
    machine, away, found = Strayed(), displacement_of(np.eye(2), np.array([4.0, 0.0])), set[str]()
    for _ in range(PATIENCE):
        for robot in ("robot/r2", "robot/r3")[: 1 + both]:
            machine.contradict(robot, "robot/r1", away)
        found |= set(machine.end_tick(3))
    assert found == strayed


@pytest.mark.parametrize("misread", [LONG, PATIENCE + 2])
def test_one_mate_alone_moves_no_robot_that_nothing_else_places(misread: int) -> None:
    """It may lie. One misread of another mate does not make it right."""
    team, lie = new_team(), (5.0, 9.0)
    for tick in range(1, LONG):
        seen: list[Seen] = [("robot/r1", "robot/r2", lie)]
        settle(team, tick, *seen, *[("robot/r4", "robot/r2", (0.0, 9.0))] * (tick == misread))
        assert spread(team, "robot/r2") < 2.0
    assert off(team, "robot/r2", led(LONG)) < 1.0


@pytest.mark.parametrize("by", ["robot/r3", "itself"])
def test_a_robot_stays_where_others_see_it_or_its_own_sensors_have_it(by: str) -> None:
    team = new_team()
    for tick in range(1, LONG):
        lie: Seen = ("robot/r1", "robot/r2", HERE)
        if by == "itself":
            settle(team, tick, lie, fixed=led(tick))
        else:
            settle(team, tick, lie, ("robot/r3", "robot/r2", led(tick)))
        assert spread(team, "robot/r2") < 0.2
    assert off(team, "robot/r2", led(LONG)) < 0.5


@pytest.mark.parametrize("place", [(60.0, 60.0), (5.0, 12.0)])
def test_one_mate_does_not_choose_the_place_of_a_robot_that_another_mate_has_lost(place: tuple[float, float]) -> None:
    """Before, each of the two was a witness of the other. The liar is taken first, by its name."""
    team = new_team()
    for tick in range(1, 60):
        settle(team, tick, ("robot/r1", "robot/r2", place), ("robot/r4", "robot/r2", HERE))
    assert off(team, "robot/r2", HERE) < off(team, "robot/r2", place) / 2


def test_one_mate_alone_does_not_keep_a_robot_where_two_others_do_not_see_it() -> None:
    """Before, a single sighting that fits outweighed all others."""
    team = new_team()
    for tick in range(1, LONG):
        settle(team, tick, ("robot/r3" if tick % 2 else "robot/r4", "robot/r2", HERE), bearing=led(tick))
    assert off(team, "robot/r2", HERE) < 0.3


@pytest.mark.parametrize("place", [(60.0, 60.0), (-60.0, -60.0), (5.0, -12.0), (-20.0, 3.0)])
def test_who_tells_the_direction_alone_of_a_lost_robot_moves_it_little_beside_another_mate(
    place: tuple[float, float],
) -> None:
    """Along a line it may be anywhere, so that a line agrees with more than a place does."""
    team = new_team()
    for tick in range(1, 60):
        settle(team, tick, ("robot/r4", "robot/r2", HERE), bearing=place)
        assert off(team, "robot/r2", HERE) < 2 * WAY.distance * TURNS


@pytest.mark.parametrize("turned", [-3.0, -2.0, 1.0, 2.0])
def test_a_robot_whose_gyro_was_set_anew_is_turned_back_by_what_it_and_its_mates_see(turned: float) -> None:
    """Before, it was pulled away from where its mates saw it, its heading stayed wrong and sure, and it was left out."""
    team, mates = new_team(), [robot for robot in PLACES if robot != "robot/r2"]
    for tick in range(1, LONG):
        news = [
            evidence_of(
                robot, tick, *[_seen(robot, "robot/r2", tick)][: tick % 2], increment=increment_at(*PLACES[robot])
            )
            for robot in mates
        ]
        seen = [_seen("robot/r2", mate, tick) for mate in mates]
        own = evidence_of("robot/r2", tick, *[replace(one, bearing=one.bearing + turned) for one in seen], variance=9.0)
        team.settle(tick, 1.0, [*news, own])
    assert off(team, "robot/r2", HERE) < 0.3
    assert team.pose("robot/r2").mean[HEADING] == pytest.approx(-turned, abs=0.1)
    assert not team.left_out


def _seen(observer: str, subject: str, tick: int) -> Relative:
    """A sighting in a tick, by its noise."""
    x, y = np.random.default_rng([tick, int(observer[-1])]).normal(PLACES[subject], 0.1)
    return sees(observer, subject, (x, y))


def test_what_is_tried_on_a_copy_is_not_counted() -> None:
    """Before, a single misread counted twice, which made it a witness."""
    team = new_team()
    for tick in range(1, LONG):
        seen: list[Seen] = [("robot/r1", "robot/r2", (5.0, 9.0))]
        seen += [("robot/r4", "robot/r2", (0.0, 9.0))] * (tick == PATIENCE + 2)
        settle(team.copy(), tick, *seen)
        settle(team, tick, *seen)
        assert spread(team, "robot/r2") < 2.0


def test_misreads_between_sightings_that_fit_move_nobody() -> None:
    team = new_team()
    for tick in range(1, LONG):
        settle(team, tick, ("robot/r1", "robot/r2", led(tick) if tick % PATIENCE == 0 else (0.0, 9.0)))
    assert off(team, "robot/r2", led(LONG)) < 0.5
    assert spread(team, "robot/r2") < 0.2


def test_who_is_said_to_be_beyond_the_map_again_and_again_is_not_made_absurd() -> None:
    team = new_team()
    for tick in range(1, 20 * PATIENCE):
        settle(team, tick, ("robot/r1" if tick % 2 else "robot/r4", "robot/r2", (1e6, 0.0)))
    assert spread(team, "robot/r2") < ABSURD


def test_what_a_robot_s_fixes_say_again_and_again_is_believed_though_its_compass_fits_in_between() -> None:
    """Before, each heading that was taken was an increment that fits, so that the fixes were left out for good."""
    team = new_team()
    for tick in range(1, 4 * LONG):
        settle(team, tick, fixed=HERE if tick > TURNS and tick % 3 == 0 else None, heading=True)
    assert off(team, "robot/r2", HERE) < 0.5


def test_headings_that_are_misread_now_and_then_make_no_robot_less_sure() -> None:
    team = new_team()
    spreads = []
    for tick in range(1, 6 * LONG):
        news = [evidence_of(robot, tick, increment=increment_at(*place)) for robot, place in PLACES.items()]
        news[1] = replace(news[1], increment=compass(1.0 if tick % 6 == 0 else 0.0))
        team.settle(tick, 1.0, news)
        spreads.append(spread(team, "robot/r2"))
    assert max(spreads) < 1.1 * spreads[0]


def test_who_claims_that_a_step_took_ages_is_not_believed_the_sooner() -> None:
    team = new_team()
    team.distrust.begin("robot/r2")
    for tick in range(1, 5):
        news = [evidence_of(robot, tick) for robot in PLACES]
        ages = Motion(dt=tick * 1e6, moving=tick * 1e6)
        team.settle(tick, 1.0, [replace(one, travelled=ages) if one.robot == "robot/r2" else one for one in news])
    assert "robot/r2" in team.distrust
