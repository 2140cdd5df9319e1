"""Who makes the others' evidence more surprising than it was without it is found out, and an honest robot is not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.influence import Influence
from blackboard.opinion.gaussian.joint import Factor, Innovation, Joint, Moments
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.relation import Relative, measured
from blackboard.opinion.gaussian.surprise import HELD, SELDOM, Surprise
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Motion, Nuisance
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.standing import LIAR, PLACES
from tests.opinion.gaussian.three import ROBOTS, beginning, drawn

TICKS, BEGIN, DT = 60, 3, 0.2
FIX, EVERY, WALK = 1.5, 24, 0.2  # the sigma of a fix, how many ticks it is to the next; how a robot wanders in a tick
SIGMA, NOISE, ASIDE = 0.5, 0.3, np.array([1.0, 1.0])


def after_some(rng: np.random.Generator) -> tuple[Joint, Influence]:
    """What is believed, and who has moved it how far, after some evidence that no model explains."""
    joint, influence = beginning(), Influence()
    for _ in range(8):
        robot, factor = drawn(rng)
        influence.on_factor(influence.after(joint, robot, factor, joint.expected(factor)))
        joint.update(factor)
    return joint, influence


def log_likelihood(innovation: Innovation) -> float:
    """But for a constant."""
    return float(-innovation.squared - np.linalg.slogdet(innovation.covariance)[1]) / 2


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_it_is_the_difference_of_the_log_likelihoods_with_and_without_what_a_robot_has_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    joint, influence = after_some(rng)
    robot, factor = drawn(rng)
    nats = influence.likelier_without(robot, factor, joint.expected(factor))
    assert nats.keys() == set(ROBOTS) - {robot}
    for source, likelier in nats.items():
        moved, honest = influence.moved(source)
        without, rows = joint.copy(), joint.indices(ROBOTS, 2).ravel()
        without.mean[rows] -= moved
        without.covariance[np.ix_(rows, rows)] += honest
        h = np.hstack([factor.jacobians.get(one, np.zeros((2, 12)))[:, :2] for one in ROBOTS])
        told = Factor(factor.residual + h @ moved, factor.jacobians, factor.noise)
        now, then = joint.innovation(factor), without.innovation(told)
        assert likelier == pytest.approx(log_likelihood(then) - log_likelihood(now), abs=1e-9)


def test_of_an_honest_robot_the_ratio_is_one_in_the_mean() -> None:
    """So it comes to n in at most one of n cases."""
    rng, ratios = np.random.default_rng(1), list[float]()
    for _ in range(40):
        joint, influence = after_some(rng)
        robot, factor = drawn(rng)
        expected = joint.expected(factor)
        residuals = rng.multivariate_normal(np.zeros(2), expected.spread + factor.noise, size=100)
        drawn_anew = [influence.likelier_without(robot, replace(factor, residual=one), expected) for one in residuals]
        ratios += [math.exp(likelier) for nats in drawn_anew for likelier in nats.values()]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.mean([ratio > 10 for ratio in ratios]) < 0.1


def test_the_worst_is_doubted_for_a_while_once_the_sum_is_beyond_what_is_seldom() -> None:
    surprise, all_of_it = Surprise(), math.log(SELDOM)
    surprise.on_evidence({"robot/r1": -50.0, "robot/r2": 0.6 * all_of_it})
    surprise.on_evidence({"robot/r1": 0.9 * all_of_it, "robot/r2": 0.3 * all_of_it})
    assert not surprise.doubts("robot/r1")
    assert not surprise.doubts("robot/r2")
    surprise.on_evidence({"robot/r1": 0.0, "robot/r2": 0.2 * all_of_it})
    assert [surprise.doubts(robot) for robot in ("robot/r1", "robot/r2")] == [False, True]
    surprise.forget_scores()
    surprise.pass_time(HELD / 2)
    assert surprise.doubts("robot/r2")
    surprise.pass_time(HELD / 2)
    assert not surprise.doubts("robot/r2")


def bearings(rng: np.random.Generator, team: TeamJoint, observer: Array) -> list[Relative]:
    """Each mate aside of where the team has it, with noise that is nearly what is claimed."""
    seen = []
    for mate in sorted((PLACES.keys() & team.subjects()) - {LIAR}):
        x, y = team.marginal(mate).mean + ASIDE + NOISE * rng.normal(size=2) - observer
        seen.append(measured("bearing", LIAR, mate, (math.atan2(y, x),), ((SIGMA / math.hypot(x, y)) ** 2,)))
    return seen


def says(robot: str, tick: int, at: Array, fix: Array | None, relatives: tuple[Relative, ...]) -> Evidence:
    """A robot whose odometry says nothing of how it wanders; a fix is where it is told to be."""
    mean, information = np.zeros(STATES), np.zeros((STATES, STATES))
    mean[AXES] = at if fix is None else fix
    information[AXES, AXES] = np.eye(2) / FIX**2
    belief = Moments(mean, np.diag([FIX**2, FIX**2, *[1e-4] * (STATES - 2)]))
    wandered = Motion(along=WALK**2 * tick, across=WALK**2 * tick, dt=DT * tick, moving=DT * tick)
    increment = Increment(mean, information, np.zeros(STATES)) if tick and fix is not None else None
    return Evidence(robot, 0, tick, wandered, Nuisance(), None if tick else belief, increment, relatives, DT * tick)


def played(seed: int, *, lies: bool) -> tuple[list[float], set[str]]:
    """Robots that wander, are told their places now and then, and see a mate: RMSE by tick of all but one, and who was doubted."""
    rng, team, doubted = np.random.default_rng(seed), TeamJoint(limits=Limits(SIGMA)), set[str]()
    at, far = {robot: place.copy() for robot, place in PLACES.items()}, list[float]()
    for tick in range(TICKS):
        told = []
        for number, robot in enumerate(PLACES):
            at[robot] += WALK * rng.normal(size=2) * bool(tick)
            mate = sorted(PLACES.keys() - {robot})[rng.integers(5)]
            x, y = at[mate] - at[robot] + SIGMA * rng.normal(size=2)
            seen = Relative(robot, mate, math.hypot(x, y), math.atan2(y, x), SIGMA**2, SIGMA**2 / (x * x + y * y))
            fix = at[robot] + FIX * rng.normal(size=2) if tick % EVERY == 4 * number or not tick else None
            relatives = [seen] * (tick % len(PLACES) == number)
            if lies and robot == LIAR and tick >= BEGIN:
                relatives += bearings(np.random.default_rng([seed, tick]), team, at[robot])
            told.append(says(robot, tick, at[robot], fix, tuple(relatives) if tick else ()))
        team.settle(tick, DT, told)
        doubted |= {robot for robot in PLACES if team.doubts(robot)}
        mates = sorted((PLACES.keys() & team.subjects()) - {LIAR})
        far.append(math.sqrt(np.mean([np.square(team.marginal(mate).mean - at[mate]).sum() for mate in mates])))
    return far, doubted


def root_mean_square(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_a_liar_whose_bearings_have_noise_of_their_own_is_found_out() -> None:
    """Before, its mates were twice as far off, and one of them was doubted: what a liar says differs as honest sightings do."""
    calm, nobody = played(2, lies=False)
    lied, doubted = played(2, lies=True)
    assert (nobody, doubted) == (set(), {LIAR})
    assert root_mean_square(lied) < 1.4 * root_mean_square(calm)
