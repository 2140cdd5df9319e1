"""What each robot has moved is known exactly, and stays within what an honest one would move, whatever it says."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.influence import FAINT, FARTHEST, MEMORY, Influence
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments, squared_distance
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, STATES, correct
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.standing import LIAR, PLACES, SPREAD, says

ROBOTS, BALL, CAN = ("robot/r1", "robot/r2", "robot/r3"), "object/ball", "object/can"
TICKS, BEGIN = 10, 3
BOUND = math.sqrt(FARTHEST * SPREAD)  # no farther than honest sightings move a mate in 999 of 1000 cases


def drawn(rng: np.random.Generator) -> tuple[str, Factor]:
    """A sighting of one robot by another, or a fix of its own, by who tells it."""
    observer, observed = rng.choice(ROBOTS, 2, replace=False)
    rows = np.zeros((2, STATES))
    rows[:, AXES] = rng.normal(size=(2, 2))
    jacobians = {str(observer): rows} if rng.random() < 0.3 else {str(observer): -rows, str(observed): rows}
    return str(observer), Factor(rng.normal(size=2), jacobians, np.diag(rng.uniform(0.1, 2.0, 2)))


def seen_or_told(rng: np.random.Generator) -> tuple[str, Factor]:
    """The same, or a sighting of the ball."""
    robot, factor = drawn(rng)
    if rng.random() < 0.5:
        factor = replace(factor, jacobians={robot: -factor.jacobians[robot], BALL: rng.normal(size=(2, 2))})
    return robot, factor


def beginning() -> Joint:
    """Three robots that know where they are, each by itself, and whose headings are no matter."""
    joint = Joint()
    for robot in ROBOTS:
        joint.add(robot, Moments(np.zeros(STATES), np.diag([1.0, 2.0, *[0.0] * (STATES - 2)])))
    return joint


@pytest.mark.parametrize("source", [LIAR, BALL])
@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000))
def test_what_a_source_has_moved_is_the_difference_to_the_same_filter_without_it(source: str, seed: int) -> None:
    """Without all evidence of a robot and all sightings by it and of it, or all sightings of a ball."""
    rng, joint, influence = np.random.default_rng(seed), beginning(), Influence()
    joint.add(BALL, Moments(np.zeros(2), np.eye(2)))
    others = joint.mean
    begun = Factor(np.zeros(2), {LIAR: np.zeros((2, STATES))}, np.eye(2))
    influence.on_factor(influence.after(joint, LIAR, begun, joint.expected(begun)))
    errors = np.kron(np.ones((2, 2)), joint.covariance)  # of both means
    for _ in range(12):
        robot, factor = seen_or_told(rng)
        is_of_it = source == robot or source in factor.jacobians
        h = np.zeros((2, len(joint.mean)))
        for block, rows in factor.jacobians.items():
            h[:, joint.blocks[block]] = rows
        expected = joint.expected(factor)
        gain = np.linalg.solve(expected.spread + factor.noise, expected.cross).T
        measured = factor.residual + h @ joint.mean
        left = np.eye(len(joint.mean)) - gain @ h
        if not is_of_it:
            others = others + gain @ (measured - h @ others)
        heard = np.kron(np.diag([1.0, float(not is_of_it)]), left - np.eye(len(left))) + np.eye(2 * len(left))
        noisy = np.vstack([gain, gain * (not is_of_it)])
        errors = heard @ errors @ heard.T + noisy @ factor.noise @ noisy.T
        influence.on_factor(influence.after(joint, robot, factor, expected))
        joint.update(factor)
    apart = np.hstack([np.eye(len(others)), -np.eye(len(others))])
    moved, honest = influence.moved(source)
    places = [joint.blocks[block].start + axis for block in (*ROBOTS, BALL) for axis in (0, 1)]
    assert moved == pytest.approx((joint.mean - others)[places], abs=1e-9)
    assert honest == pytest.approx((apart @ errors @ apart.T)[np.ix_(places, places)], abs=1e-9)


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000))
def test_what_is_taken_back_leaves_others_as_uncertain_as_they_were_without(seed: int) -> None:
    rng, joint, influence = np.random.default_rng(seed), beginning(), Influence()
    before = joint.copy()
    for _ in range(6):
        _, factor = drawn(rng)
        influence.on_factor(influence.after(joint, LIAR, factor, joint.expected(factor)))
        joint.update(factor)
    own, before_own = slice(2 * ROBOTS.index(LIAR), 2 * ROBOTS.index(LIAR) + 2), influence.moved(LIAR)
    influence.take_back(joint, LIAR)
    moved, honest = influence.moved(LIAR)
    assert np.linalg.eigvalsh(honest).min() > -1e-9
    assert (moved[own], honest[own, own]) == (pytest.approx(before_own[0][own]), pytest.approx(before_own[1][own, own]))
    for robot in set(ROBOTS) - {LIAR}:
        assert joint.moments(robot).mean == pytest.approx(before.moments(robot).mean, abs=1e-9)
        assert joint.moments(robot).covariance == pytest.approx(before.moments(robot).covariance, abs=1e-9)
    assert np.linalg.eigvalsh(joint.covariance).min() > -1e-9


def seen_by_the_liar() -> tuple[Joint, Influence]:
    """A ball and a can that the liar alone has seen; the can went a way."""
    joint, influence = beginning(), Influence()
    for thing in (BALL, CAN):
        joint.add(thing, Moments(np.zeros(2), np.eye(2)))
        seen = Factor(np.ones(2), {LIAR: np.eye(2, STATES), thing: -np.eye(2)}, 0.1 * np.eye(2))
        influence.on_factor(influence.after(joint, LIAR, seen, joint.expected(seen)))
        joint.update(seen)
    influence.go(CAN, np.array([1.0, 0.0]))
    return joint, influence


def test_what_is_taken_back_of_a_robot_is_not_taken_back_again_of_what_it_saw() -> None:
    """Before, it was, and the way of the can was divided by what robots had moved it, which was nothing then: it flew off."""
    joint, influence = seen_by_the_liar()
    influence.take_back(joint, LIAR)
    before = joint.copy()
    influence.take_back(joint, BALL)
    for block in (*set(ROBOTS) - {LIAR}, CAN):
        assert joint.moments(block).mean == pytest.approx(before.moments(block).mean, abs=1e-9)
        assert joint.moments(block).covariance == pytest.approx(before.moments(block).covariance, abs=1e-9)


def test_an_object_is_not_held_to_have_moved_the_way_that_another_one_went() -> None:
    joint, influence = seen_by_the_liar()
    moved, before = influence.moved(BALL)[0], joint.moments(CAN).mean
    influence.take_back(joint, BALL, told_by=[LIAR])
    assert moved[-2:].all()
    assert joint.moments(CAN).mean == pytest.approx(before - moved[-2:], abs=1e-9)


def test_of_a_robot_of_a_team_that_is_too_large_to_be_counted_nothing_is_taken_back() -> None:
    """Before, this was a TypeError in teams of 20 robots or more, and boards left out all evidence of a robot that was doubted."""
    joint, influence, robots = Joint(), Influence(), [f"robot/r{k}" for k in range(20)]
    for robot in robots:
        joint.add(robot, Moments(np.zeros(STATES), np.eye(STATES)))
    assert not influence.is_counted(len(robots))
    before = joint.copy()
    influence.take_back(joint, robots[0])
    assert np.array_equal(joint.mean, before.mean)
    assert np.array_equal(joint.covariance, before.covariance)


def test_what_rounding_adds_does_not_grow_with_the_evidence() -> None:
    """Before, what was not symmetric grew by each sighting, and after a minute at 10 Hz an honest robot broke the joint."""
    rng, joint, influence = np.random.default_rng(1), beginning(), Influence()
    for _ in range(3000):
        robot, factor = drawn(rng)
        influence.on_factor(influence.after(joint, robot, factor, joint.expected(factor)))
        joint.update(factor)
        for mate in ROBOTS:  # they drive on
            place = joint.blocks[mate]
            joint.covariance[place, place][AXES, AXES] += np.eye(2)
        influence.pass_time(0.02)
    for robot in ROBOTS:
        _, honest = influence.moved(robot)
        assert honest == pytest.approx(honest.T, abs=1e-9)
        assert np.linalg.eigvalsh(honest).min() > -1e-9


def anything(rng: np.random.Generator, team: TeamJoint) -> tuple[Increment | None, tuple[Relative, ...]]:
    """What a liar may say in a tick: of itself, and of mates it sees aside of where the team has them or anywhere."""
    relatives = []
    for mate in sorted((PLACES.keys() & team.subjects()) - {LIAR}):
        if rng.random() < 0.7:
            x, y = team.marginal(mate).mean + rng.normal(size=2) * 10.0 ** rng.uniform(-2, 1.5) - PLACES[LIAR]
            variances = 10.0 ** rng.uniform(-6, 2, 2)
            relatives.append(Relative(LIAR, mate, math.hypot(x, y), math.atan2(y, x), *variances))
    if rng.random() < 0.5:
        return None, tuple(relatives)
    information = np.zeros((STATES, STATES))
    information[AXES, AXES] = np.eye(2) * 10.0 ** rng.uniform(-3, 9)
    mean = np.zeros(STATES)
    mean[AXES] = PLACES[LIAR] + rng.normal(size=2) * 10.0 ** rng.uniform(-2, 1.5)
    return Increment(mean, information, np.zeros(STATES)), tuple(relatives)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 100_000), st.booleans(), st.sampled_from([0.0, 0.05, 0.1, 1.0, 10.0]))
def test_whatever_one_of_six_says_its_mates_are_no_farther_off_than_an_honest_one_would_move_them(
    seed: int, same: bool, scale: float
) -> None:
    """All others are exact. So how far off they are is what the liar has moved."""
    rng, team, farthest = np.random.default_rng(seed), TeamJoint(limits=Limits(0.5)), 0.0
    lies: tuple[Increment | None, tuple[Relative, ...]] = None, ()
    for tick in range(TICKS):
        if tick == BEGIN or (tick > BEGIN and not same):
            lies = anything(rng, team)
        said = [says(robot, tick) for robot in PLACES if robot != LIAR]
        increment, relatives = lies
        mine = says(LIAR, tick, relatives, scale)
        team.settle(tick, 0.2, [*said, mine if increment is None else replace(mine, increment=increment)])
        away: list[Array] = [team.marginal(robot).mean - at for robot, at in PLACES.items() if robot != LIAR]
        farthest = max(farthest, *(float(np.hypot(*offset)) for offset in away))
    assert farthest <= BOUND * math.exp((TICKS - BEGIN) * 0.2 / MEMORY)


@pytest.mark.parametrize("step", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("noise", [0.005, 0.02, 0.1])
def test_a_robot_whose_odometry_leads_it_away_takes_a_mate_that_sees_it_no_farther_along(
    step: float, noise: float
) -> None:
    """Both stand. Before, each made the other follow: the mate went 5 to 20 units in 8 s, and 98 to 1091 stood here for 13.8."""
    team, mate, rows = TeamJoint(), ROBOTS[0], np.eye(2, STATES)
    for robot in (mate, LIAR):
        team.joint.add(robot, Moments(np.zeros(STATES), np.diag([SPREAD, SPREAD, *[1e-4] * (STATES - 2)])))
    for _ in range(40):
        team.influence.pass_time(0.2)
        for robot, way in ((mate, 0.0), (LIAR, step)):
            moved = team.joint.moments(robot).mean + way * np.eye(STATES)[0]
            team.joint.move(robot, moved, np.eye(STATES), noise * rows.T @ rows)
        apart = (team.joint.moments(LIAR).mean - team.joint.moments(mate).mean)[AXES]
        seen = Factor(-apart, {mate: -rows, LIAR: rows}, 0.25 * np.eye(2))
        correct(team.joint, seen, team.bounded(mate, seen))
        led, honest = team.influence.moved(LIAR)
        faint = FAINT * float(team.joint.variances[AXES].mean()) * np.eye(2)
        assert squared_distance(led[AXES], honest[AXES, AXES] + faint) <= FARTHEST


@pytest.mark.parametrize("scale", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("longer", [-3.0, 1.5, 3.0, 6.0])
def test_who_measures_ranges_that_are_too_long_moves_its_mates_no_farther_by_claiming_a_scale(
    longer: float, scale: float
) -> None:
    """What is too long by a constant looks partly like a scale, so that it is found out later."""
    team, farthest = TeamJoint(), 0.0
    for tick in range(TICKS + 20):
        ways = {mate: PLACES[mate] - PLACES[LIAR] for mate in PLACES if mate != LIAR and tick >= BEGIN}
        lies = tuple(
            Relative(LIAR, mate, math.hypot(x, y) + longer, math.atan2(y, x), 0.25, 0.0025)
            for mate, (x, y) in ways.items()
        )
        said = {robot: says(robot, tick) for robot in PLACES} | {LIAR: says(LIAR, tick, lies, scale)}
        team.settle(tick, 0.2, list(said.values()))
        away = [float(np.hypot(*(team.marginal(mate).mean - at))) for mate, at in PLACES.items() if mate != LIAR]
        farthest = max(farthest, *away)
    assert farthest < BOUND
