"""Robots of one make: scales that have a share of their variance in common, against a Gaussian that has the make's as a block of its own."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import Degenerate
from blackboard.opinion.gaussian.alike import MADE, add_alike
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import FORWARD, HEADING, STATES, Motion, Nuisance, entering, wrap

SEEDS = st.integers(0, 10_000)
NUISANCE = Nuisance(1.0, 1.0, (0.15, 0.1, 0.003, 0.03, 0.02, 0.1, 0.1, 0.3, 0.2), alike=0.9)
ROBOTS = ["robot/a", "robot/b", "robot/c", "robot/d"]


def first_hand(chance: np.random.Generator, nuisance: Nuisance = NUISANCE) -> Moments:
    """A pose whose error has to do with the scales, which are as the prior has them."""
    root = chance.normal(0, 0.1, (3, 6))
    belief = entering(Moments(chance.normal(0, 1, 3), root @ root.T), nuisance)
    tie = np.eye(STATES)
    tie[:3, FORWARD:] = chance.normal(0, 0.5, (3, STATES - FORWARD))
    return Moments(belief.mean, tie @ belief.covariance @ tie.T)


def with_the_make(beliefs: dict[str, Moments], nuisance: Nuisance) -> Joint:
    """All robots, and the make as a block of its own: each scale is off by what the make's is, and by more of its own."""
    variances = np.concatenate([np.zeros(FORWARD), np.square(nuisance.sigmas)])[MADE]
    joint = Joint()
    joint.add("make", Moments(np.zeros(len(MADE)), np.diag(nuisance.alike * variances)))
    for robot, belief in beliefs.items():
        by_scales = belief.covariance[:, MADE] / variances
        alone = belief.covariance - (by_scales * nuisance.alike * variances) @ by_scales.T
        joint.add(robot, Moments(belief.mean, alone), {"make": by_scales})
    return joint


def measure(joint: Joint, robot: str, belief: Moments, chance: np.random.Generator) -> None:
    """Two numbers that are measured of a robot's states, near what it believed: beyond a sigma, less of its scales is followed."""
    rows, off = chance.normal(0, 1, (2, STATES)), chance.normal(0, 0.02, 2)
    residual = off - rows @ (joint.mean[joint.blocks[robot]] - belief.mean)
    joint.update(Factor(residual, {robot: rows}, 0.01 * np.eye(2)))


def is_as(joint: Joint, oracle: Joint, *robots: str) -> bool:
    mine, its = joint.moments(*robots), oracle.moments(*robots)
    return np.allclose(mine.mean, its.mean, atol=1e-5) and np.allclose(mine.covariance, its.covariance, atol=1e-5)


@given(seed=SEEDS, alike=st.floats(0.01, 0.99), size=st.integers(2, 4))
def test_who_enters_later_knows_what_it_would_with_the_make_as_a_block(seed: int, alike: float, size: int) -> None:
    chance, nuisance = np.random.default_rng(seed), replace(NUISANCE, alike=alike)
    beliefs = {robot: first_hand(chance, nuisance) for robot in ROBOTS[:size]}
    joint, oracle = Joint(), with_the_make(beliefs, nuisance)
    for number, (robot, belief) in enumerate(beliefs.items()):
        add_alike(joint, robot, belief, nuisance, ROBOTS[:number])
        for other in ROBOTS[: number + 1]:
            measure(joint, other, beliefs[other], np.random.default_rng([seed, number]))
            measure(oracle, other, beliefs[other], np.random.default_rng([seed, number]))
    assert is_as(joint, oracle, *beliefs)


@given(seed=SEEDS)
def test_what_a_robot_has_learned_before_it_enters_counts_once_and_for_itself(seed: int) -> None:
    chance = np.random.default_rng(seed)
    beliefs = {robot: first_hand(chance) for robot in ROBOTS[:2]}
    alone, joint, oracle = Joint(), Joint(), with_the_make(beliefs, NUISANCE)
    alone.add("robot/b", beliefs["robot/b"])
    joint.add("robot/a", beliefs["robot/a"])
    for place, robot in ((joint, "robot/a"), (oracle, "robot/a"), (alone, "robot/b"), (oracle, "robot/b")):
        measure(place, robot, beliefs[robot], np.random.default_rng(seed))
    before = joint.moments("robot/a")
    add_alike(joint, "robot/b", alone.moments("robot/b"), NUISANCE, ["robot/a"])
    assert is_as(joint, oracle, "robot/b")
    assert np.array_equal(joint.moments("robot/a").mean, before.mean)
    assert np.array_equal(joint.moments("robot/a").covariance, before.covariance)


def evidence(robot: str, nuisance: Nuisance, tick: int = 0, turn: float = 0.0, **more: Any) -> Evidence:
    motion = Motion(turn=turn, driven=turn, dt=float(tick), moving=float(tick), heading=1e-4)
    return Evidence(f"robot/{robot}", 0, tick, motion, nuisance, time=float(tick), **more)


@pytest.mark.parametrize(("other", "learns"), [(NUISANCE, True), (replace(NUISANCE, alike=0.0), False)])
def test_a_robot_learns_its_scales_from_those_of_its_make_alone(other: Nuisance, learns: bool) -> None:
    """On curves a turns 0.6 of what it is told, as its landmarks show. Nobody sees b."""
    joint, pose = TeamJoint(), Moments(np.zeros(3), 1e-4 * np.eye(3))
    for tick in range(11):
        told = {robot: evidence(robot, n, tick, 0.5 * tick) for robot, n in (("a", NUISANCE), ("b", other))}
        if tick == 0:
            told = {robot: replace(its, belief=entering(pose, its.nuisance)) for robot, its in told.items()}
        elif tick < 10:
            heading = Increment(np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros(STATES))
            heading.reference[HEADING] = wrap(0.6 * 0.5 * tick)
            heading.information[HEADING, HEADING] = 1e4
            told["a"] = replace(told["a"], increment=heading)
        joint.settle(tick, 1.0, told.values())
    turned = {robot: joint.joint.moments(f"robot/{robot}").mean[HEADING] for robot in ("a", "b")}
    assert turned["a"] == pytest.approx(wrap(0.6 * 5.0), abs=0.05)
    off = abs(wrap(float(turned["b"] - turned["a"])))
    assert off < 0.3 if learns else off > 1.0


@pytest.mark.parametrize("claimed", [1000.0, 1.4, -5.0])
def test_a_scale_that_a_robot_claims_when_it_enters_moves_the_next_by_a_sigma_at_most(claimed: float) -> None:
    """Within the format, and surely: the next robot of the make entered with .9 of that."""
    joint, pose = TeamJoint(), Moments(np.zeros(3), 1e-4 * np.eye(3))
    state = entering(pose, NUISANCE)
    state.mean[FORWARD], state.covariance[FORWARD, FORWARD] = claimed, 1e-12
    told = [evidence("a", NUISANCE, belief=state), evidence("b", NUISANCE, belief=entering(pose, NUISANCE))]
    joint.settle(0, 1.0, told)
    block = joint.joint.moments("robot/b")
    assert abs(block.mean[FORWARD] - 1.0) <= NUISANCE.sigmas[0]
    assert block.covariance[FORWARD, FORWARD] > 0.0


@pytest.mark.parametrize("zero", [[FORWARD], MADE])
def test_scales_that_a_robot_claims_to_know_exactly_bar_nobody_else(zero: list[int]) -> None:
    joint, pose = TeamJoint(), Moments(np.zeros(3), 1e-4 * np.eye(3))
    state = entering(pose, NUISANCE)
    state.covariance[zero, zero] = 0.0
    joint.settle(0, 1.0, [evidence("a", NUISANCE, belief=entering(pose, NUISANCE))])
    try:
        joint.settle(1, 1.0, [evidence("b", NUISANCE, 1, belief=state)])
    except Degenerate as degenerate:
        assert degenerate.robot == "robot/b"
    else:
        assert "robot/b" in joint.subjects()


def test_one_that_is_of_no_make_enters_as_ever() -> None:
    belief = first_hand(np.random.default_rng(1))
    one, other = Joint(), Joint()
    for joint in (one, other):
        joint.add("robot/a", belief)
    one.add("robot/b", belief)
    add_alike(other, "robot/b", belief, NUISANCE, [])
    assert np.array_equal(one.covariance, other.covariance)
