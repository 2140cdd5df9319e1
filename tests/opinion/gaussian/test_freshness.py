"""Who says again what the team believes makes it no surer, and takes nothing along."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.freshness import HELD, Freshness
from blackboard.opinion.gaussian.joint import Block, Factor
from blackboard.opinion.gaussian.relation import Bias, Kind, Relative, measured
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Motion
from blackboard.opinion.grid import Array
from tests.opinion.gaussian import standing
from tests.opinion.gaussian.standing import LIAR

BEGIN, END, DT = 5, 40, 0.2
BALL, DRIFT = "object/ball", 0.1
MATES = ["robot/r0", "robot/r1", "robot/r3"]
PLACES = {robot: standing.PLACES[robot] for robot in sorted([*MATES, LIAR])}
SIGMA = 0.5  # what a sighting claims


def sightings_of(
    team: TeamJoint,
    observer: str,
    whom: str,
    aside: float = 0.0,
    kind: Kind = "range-bearing",
    biases: tuple[Bias, ...] = (),
) -> tuple[Relative, ...]:
    """A subject `aside` of where the team has it, as seen from where the observer is by its own evidence; nothing of an unknown one."""
    if not team.knows(whom):
        return ()
    x, y = team.marginal(whom).mean + [aside, 0.0] - PLACES[observer]
    away, bearing = math.hypot(x, y), math.atan2(y, x)
    if kind == "range":
        return (measured("range", observer, whom, (away,), (SIGMA**2,)),)
    if kind == "bearing":
        return (measured("bearing", observer, whom, (bearing,), ((SIGMA / away) ** 2,)),)
    return (Relative(observer, whom, away, bearing, SIGMA**2, (SIGMA / away) ** 2, biases=biases),)


def says(robot: str, tick: int, relatives: tuple[Relative, ...] = (), *, moving: bool = True) -> Evidence:
    """What a robot says that stands, of one that returns to the same place in each tick."""
    motion = Motion(along=0.01 * tick, across=0.01 * tick, heading=1e-4 * tick, dt=DT * tick, moving=DT * tick * moving)
    return replace(standing.says(robot, tick, relatives), travelled=motion, time=DT * tick)


def run(lies: Callable[[TeamJoint], list[tuple[Relative, ...]]]) -> TeamJoint:
    """A team in which one tells `lies`, after another one has seen a ball."""
    team, chance = TeamJoint(Objects(drift=DRIFT)), np.random.default_rng(1)
    for tick in range(END):
        if tick < BEGIN:
            away, bearing = [8.0, 2.0] + chance.normal(size=2) * [SIGMA, 0.05]
            sightings: dict[str, tuple[Relative, ...]] = {
                "robot/r0": (Relative("robot/r0", BALL, away, bearing, SIGMA**2, 0.05**2),)
            }
        else:
            sightings = {LIAR: sum(lies(team), ())}
        team.settle(tick, DT, [says(robot, tick, sightings.get(robot, ())) for robot in PLACES])
    return team


@pytest.mark.parametrize(
    ("kind", "biases"), [("range-bearing", ()), ("range", ()), ("bearing", ()), ("range-bearing", (Bias(1.0, 60.0),))]
)
def test_who_sees_its_mates_where_the_team_has_them_makes_it_no_surer(kind: Kind, biases: tuple[Bias, ...]) -> None:
    """Before, a mate's standard deviation fell to .6 of what it is without the liar."""
    lied_to = run(lambda team: [sightings_of(team, LIAR, whom, kind=kind, biases=biases) for whom in MATES])
    for mate in MATES:
        sigmas = [math.sqrt(np.trace(team.marginal(mate).covariance)) for team in (lied_to, run(lambda _: []))]
        assert sigmas[0] > 0.95 * sigmas[1]


@pytest.mark.parametrize("aside", [0.5, 1.0, 2.0])
def test_who_is_found_out_to_see_a_mate_always_as_far_aside_has_not_taken_it_along(aside: float) -> None:
    """What was taken of it before is taken back; before, the mate went by .7 of `aside` and more."""
    mate = MATES[0]
    away = run(lambda team: [sightings_of(team, LIAR, mate, aside)]).marginal(mate).mean - PLACES[mate]
    assert np.hypot(*away) < 0.2 * aside


def test_who_is_found_out_moves_nobody_neither_by_what_it_sees_nor_by_being_seen() -> None:
    """Before, a mate that saw it was led to where the liar had moved itself."""
    first, second, third = MATES
    team, tick = TeamJoint(), 0
    while not team.doubts(LIAR):
        lie = sightings_of(team, LIAR, first, 1.0)
        team.settle(tick, DT, [says(robot, tick, lie if robot == LIAR else ()) for robot in PLACES])
        tick += 1
    places = []
    for sightings in ({}, {LIAR: sightings_of(team, LIAR, third, 1.0), second: sightings_of(team, second, LIAR, 1.0)}):
        after = team.copy()
        after.settle(tick, DT, [says(robot, tick, sightings.get(robot, ())) for robot in PLACES])
        places.append([after.marginal(mate) for mate in MATES])
    for without, with_it in zip(*places, strict=True):
        assert with_it.mean == pytest.approx(without.mean)
        assert with_it.covariance == pytest.approx(without.covariance)


def test_an_object_is_not_taken_along_by_one_that_sees_it_aside_of_where_the_team_has_it_in_each_tick() -> None:
    """Before, it went 13 units in 7 s."""
    before, after = run(lambda _: []), run(lambda team: [sightings_of(team, LIAR, BALL, 2.0)])
    assert np.hypot(*(after.marginal(BALL).mean - before.marginal(BALL).mean)) < 1.0
    assert after.drift_of(BALL) < 2 * DRIFT


def test_an_exact_sensor_of_robots_that_stand_is_taken_for_no_liar() -> None:
    """Somebody's first simulator: what is seen is the same in each tick, and true."""
    team, mate, true = TeamJoint(), MATES[0], PLACES[MATES[0]] + [1.0, 0.0]
    away = true - PLACES[LIAR]
    sighting = Relative(LIAR, mate, math.hypot(*away), math.atan2(away[1], away[0]), 0.01, 0.0001)
    for tick in range(END):
        sightings = {LIAR: (sighting,)} if tick else {}
        team.settle(tick, DT, [says(robot, tick, sightings.get(robot, ()), moving=False) for robot in PLACES])
    assert team.marginal(mate).mean[0] - PLACES[mate][0] > 0.4, "its own fixes say 0, what is seen says 1"


def factor(residual: Array, biases: tuple[Bias, ...] = ()) -> tuple[Relative, Factor]:
    sighting = Relative("robot/a", "robot/b", 5.0, 0.0, SIGMA**2, 0.01, biases=biases)
    rows = np.zeros((2, STATES))
    rows[AXES, AXES] = np.eye(2)
    lasting: dict[Block, Array] = {block: np.array([[sigma], [0.0]]) for block, sigma in sighting.blocks().items()}
    return sighting, Factor(residual, {"robot/b": rows, **lasting}, SIGMA**2 * np.eye(2))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.5, 5.0), st.floats(0.0, 10.0))
def test_of_those_with_half_the_noise_that_they_claim_or_more_hardly_any_is_held_to_lack_it(
    seed: int, wider: float, offset: float
) -> None:
    """However far aside they see it: only the differences count."""
    chance, freshness, held = np.random.default_rng(seed), Freshness(), 0
    for _ in range(200):
        sighting, evidence = factor(offset + wider * SIGMA * chance.normal(size=2))
        freshness.pass_time(DT)
        freshness.on_sighting(sighting, evidence)
        held += freshness.doubts(sighting.observer)
    assert held <= 50, "two false alarms"


def test_who_begins_to_say_anew_what_it_sees_is_believed_again() -> None:
    chance, freshness = np.random.default_rng(3), Freshness()
    for tick in range(20 + round(2 * HELD / DT)):
        sighting, evidence = factor(np.array([2.0, 0.0]) if tick < 20 else SIGMA * chance.normal(size=2))
        freshness.pass_time(DT)
        freshness.on_sighting(sighting, evidence)
        if tick == 19:
            assert freshness.doubts(sighting.observer)
    assert not freshness.doubts(sighting.observer)


@pytest.mark.parametrize(("noise", "is_doubted"), [(1.0, False), (0.5, False), (0.0, True)])
def test_who_declares_lasting_errors_of_its_ranges_is_believed_as_long_as_its_bearings_have_their_noise(
    noise: float, is_doubted: bool
) -> None:
    """Before, whoever declared them was not asked for any noise."""
    chance, freshness = np.random.default_rng(3), Freshness()
    for _ in range(40):
        residual = np.array([2.0, noise * SIGMA * chance.normal()])
        freshness.on_sighting(*factor(residual, (Bias(SIGMA, 60.0),)))
    assert freshness.doubts("robot/a") == is_doubted
