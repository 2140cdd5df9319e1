"""Late sightings of objects say where the object was when they were taken."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.relation import Relative, measured
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.gaussian.walks import Model
from tests.opinion.gaussian.square import PLACES, evidence_of

BALL = "object/ball"
SIGMA = 0.05  # of a sighting along each axis (unit)
PART = 0.05  # seconds, of which all times are multiples
TICK = 4  # parts in a tick
Seen = tuple[str, int, np.ndarray]  # who saw the ball, in which part, and where


def new_team(model: Model = "walk", drift: float = 0.3, variance: float = 1e-4) -> TeamJoint:
    """Robots that stand, and know where, with so much variance, and that the ball moves so."""
    team = TeamJoint(Objects(drift=drift, model=model))
    team.settle(0, PART, [evidence_of(robot, 0, variance=variance) for robot in PLACES])
    return team


def told(seen: Seen, now: int) -> Relative:
    robot, part, place = seen
    at = place - np.array(PLACES[robot])
    return measured("position", robot, BALL, at.tolist(), (SIGMA**2, 0.0, SIGMA**2), age=(now - part) * PART)


def tell(team: TeamJoint, dt: float, now: int, seen: Sequence[Seen], behind: Mapping[str, float] | None = None) -> None:
    """Settle a tick; robots that are `behind` tell of a tick that ended so many seconds earlier."""
    reports = list[Evidence]()
    for robot in PLACES:
        its = [told(one, now) for one in seen if one[0] == robot]
        late = (behind or {}).get(robot, 0.0)
        evidence = evidence_of(robot, team.tick + 1, *its)
        shorter = [Relative(**{**vars(one), "age": one.age - late}) for one in its]
        reports.append(
            Evidence(**{**vars(evidence), "belief": None, "time": now * PART - late, "relatives": tuple(shorter)})
        )
    team.settle(team.tick + 1, dt, reports)


def at_their_time(seen: Sequence[Seen], parts: int, team: TeamJoint) -> TeamJoint:
    """The slow way: a tick for each part, in which what is seen is told at once."""
    for now in range(1, parts + 1):
        tell(team, PART, now, [one for one in seen if one[1] == now])
    return team


def when_the_tick_ends(
    seen: Sequence[Seen], parts: int, team: TeamJoint, behind: Mapping[str, float] | None = None
) -> TeamJoint:
    """What is seen is told at the end of the tick."""
    for now in range(TICK, parts + 1, TICK):
        tell(team, TICK * PART, now, [one for one in seen if now - TICK < one[1] <= now], behind)
    return team


def rolled(parts: int, speed: float, seed: int, robots: Sequence[str] = ("robot/r1",), every: int = 2) -> list[Seen]:
    rng = np.random.default_rng(seed)
    return [
        (robots[part // every % len(robots)], part, where_it_is(part, speed) + SIGMA * rng.normal(size=2))
        for part in range(1, parts + 1, every)
    ]


def where_it_is(part: int, speed: float) -> np.ndarray:
    return np.array([1.0, 1.0]) + speed * part * PART * np.array([0.8, 0.6])


@given(parts=st.lists(st.integers(1, 20), unique=True, min_size=1), seed=st.integers(0, 99))
@settings(max_examples=25)
def test_a_late_sighting_says_what_it_would_have_said_in_time(parts: list[int], seed: int) -> None:
    """But for the drift that is found, whose evidence fades in steps."""
    rng = np.random.default_rng(seed)
    seen = [("robot/r1", part, np.array([1.0, 2.0]) + 0.1 * rng.normal(size=2)) for part in sorted(parts)]
    slow, fast = at_their_time(seen, 20, new_team()), when_the_tick_ends(seen, 20, new_team())
    for subject in (BALL, *PLACES):
        assert fast.marginal(subject).mean == pytest.approx(slow.marginal(subject).mean, abs=1e-3)
        assert fast.marginal(subject).covariance == pytest.approx(slow.marginal(subject).covariance, rel=0.02, abs=1e-9)


@pytest.mark.parametrize("robots", [["robot/r1"], ["robot/r4", "robot/r2", "robot/r1"]])
@pytest.mark.parametrize("behind", [0.0, 0.1])
def test_a_ball_that_rolls_is_where_it_is_now(robots: list[str], behind: float) -> None:
    """By several the sightings come out of sequence: each robot's are taken together."""
    errors, held = [], []
    for seed in range(8):
        team = new_team("learn")
        seen = rolled(80, 1.0, seed, robots)
        for now in range(TICK, 81, TICK):
            tell(team, TICK * PART, now, [one for one in seen if now - 6 <= one[1] < now - 2], {"robot/r1": behind})
            if now > 40:
                marginal = team.marginal(BALL)
                apart = marginal.mean - where_it_is(now, 1.0)
                errors.append(float(apart @ apart))
                held.append(float(apart @ np.linalg.solve(marginal.covariance, apart)) < 5.99)
    assert np.sqrt(np.mean(errors)) < 0.12  # taken for now, it was .20 to .25 behind
    assert np.mean(held) > 0.88


@pytest.mark.parametrize("seed", range(4))
def test_robots_that_are_unsure_of_their_places_are_not_to_blame(seed: int) -> None:
    """What the ball has moved is no part of what the robots share with it: so the joint stays one."""
    team = new_team("learn", variance=1.0)
    seen = rolled(160, 1.0, seed, sorted(PLACES))
    for now in range(TICK, 161, TICK):
        tell(team, TICK * PART, now, [one for one in seen if now - 20 - TICK < one[1] <= now - 20])
        assert np.linalg.eigvalsh(team.joint.covariance).min() > -1e-9
    assert not team.left_out
    for robot, place in PLACES.items():
        apart = team.marginal(robot).mean - place
        assert apart @ np.linalg.solve(team.joint.moments(robot).covariance[AXES, AXES], apart) < 14.0


@pytest.mark.parametrize("ahead", [0.5, 10.0])
def test_one_that_says_that_its_tick_ended_later_makes_the_sightings_of_others_no_older(ahead: float) -> None:
    errors = []
    for behind in (0.0, -ahead):
        team = new_team("learn")
        for now in range(TICK, 81, TICK):
            tell(team, TICK * PART, now, [("robot/r1", now, where_it_is(now, 1.0))], {"robot/r4": behind})
        errors.append(np.hypot(*(team.marginal(BALL).mean - where_it_is(80, 1.0))))
    assert errors[1] == pytest.approx(errors[0], abs=1e-6)


def test_a_sighting_of_long_ago_says_little() -> None:
    team = at_their_time(rolled(20, 0.0, 1), 20, new_team())
    before = team.marginal(BALL)
    tell(team, PART, 21, [("robot/r2", 21 - 1200, where_it_is(0, 0.0) + 3.0)])
    assert np.hypot(*(team.marginal(BALL).mean - before.mean)) < 0.1
