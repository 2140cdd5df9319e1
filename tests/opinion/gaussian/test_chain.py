"""Many sightings at once are what each is alone, and a chain of measurements what they are one after the other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.chain import Chain
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise, linearise_all
from blackboard.opinion.gaussian.relation import Bias, Relative, measured
from blackboard.opinion.gaussian.vehicle import FLAT, FORWARD, STATES, TURN, Motion
from blackboard.opinion.grid import Array

SEEDS = st.integers(0, 10_000)
ROBOTS = [f"robot/r{k}" for k in range(4)]
PROFILE = ((0.5, 0.1), (2.0, 0.2), (6.0, 1.0))


def team(chance: np.random.Generator) -> Joint:
    """Robots and an object with a random belief in which all hang together, and a robot that nobody knows the place of."""
    moments = {}
    for robot in ROBOTS:
        mean = np.zeros(STATES)
        mean[:3], mean[[FORWARD, TURN]] = chance.uniform(-3, 3, 3), 0.95
        moments[robot] = Moments(mean, np.eye(STATES))
    joint = Joint.of({**moments, "object/ball": Moments(chance.uniform(-3, 3, 2), np.eye(2))})
    root = chance.normal(0, chance.choice([0.02, 0.5]), (len(joint.mean), len(joint.mean) + 3))
    joint.covariance = root @ root.T / len(joint.mean)
    lost = np.zeros(STATES)
    lost[[FORWARD, TURN]] = 0.95
    joint.add("robot/lost", Moments(lost, np.diag([FLAT, FLAT, *[0.1] * (STATES - 2)])))
    return joint


def any_sighting(chance: np.random.Generator) -> Relative:
    """Of any kind, of a mate, an object, or what the joint does not have."""
    observer, subject = chance.permutation([*ROBOTS, "robot/lost", "object/ball", "object/new"])[:2].tolist()
    if observer.startswith("object/"):
        observer, subject = "robot/r0" if subject != "robot/r0" else "robot/r1", observer
    biases = (Bias(0.1, 7.0),) if chance.random() < 0.3 else ()
    age = float(chance.choice([0.0, 0.1, 0.3]))
    kind = str(chance.choice(["range-bearing", "range", "bearing", "position", "pose"]))
    if kind == "range-bearing":
        profile = PROFILE if chance.random() < 0.5 else ()
        return Relative(
            observer, subject, chance.uniform(0.5, 5), chance.uniform(-3, 3), 0.04, 0.01, age, biases, "", profile
        )
    values = {"range": (2.0,), "bearing": (0.4,), "position": (1.5, -0.7), "pose": (1.5, -0.7, 0.3)}[kind]
    upper = np.triu_indices(len(values))
    return measured(kind, observer, subject, values, tuple((0.05 * np.eye(len(values)))[upper].tolist()), age, biases)  # type: ignore[arg-type]


@given(seed=SEEDS)
def test_sightings_that_are_linearised_at_once_are_what_each_is_alone(seed: int) -> None:
    chance = np.random.default_rng(seed)
    joint, sightings = team(chance), [any_sighting(chance) for _ in range(12)]
    motions = {robot: Motion(0.3, 0.1, 0.2, 0.2, 0.01, 0.01, 0.001) for robot in ROBOTS[:3]}
    at_once = linearise_all(joint, sightings, motions)
    innovations = joint.innovations(at_once)
    for sighting, factor, innovation in zip(sightings, at_once, innovations, strict=True):
        alone = linearise(joint, sighting, motions)
        assert factor.jacobians.keys() == alone.jacobians.keys()
        assert factor.priors.keys() == alone.priors.keys()
        assert factor.anchors.keys() == alone.anchors.keys()
        for block, part in alone.jacobians.items():
            assert np.allclose(factor.jacobians[block], part, rtol=1e-12, atol=1e-12)
        assert np.allclose(factor.residual, alone.residual, rtol=1e-12, atol=1e-12)
        assert np.allclose(factor.noise, alone.noise, rtol=1e-12, atol=1e-12)
        assert np.allclose(innovation.covariance, joint.innovation(alone).covariance, rtol=1e-9)


def plain(chance: np.random.Generator, joint: Joint) -> Factor:
    """A linear measurement of two blocks, which does not care where it was linearised."""
    observer, observed = chance.permutation(ROBOTS)[:2].tolist()
    rows = {block: chance.normal(size=(2, STATES)) for block in (observer, observed)}
    root = chance.normal(size=(2, 3))
    return Factor(chance.normal(size=2), rows, root @ root.T)


def moved(factor: Factor, joint: Joint, mean: Array) -> Factor:
    """The same measurement once the mean has moved from where it was linearised."""
    gone = sum(part @ (joint.mean - mean)[joint.blocks[block]] for block, part in factor.jacobians.items())
    return Factor(factor.residual - gone, factor.jacobians, factor.noise)


@given(seed=SEEDS)
def test_a_chain_says_and_leaves_what_one_after_the_other_does(seed: int) -> None:
    chance = np.random.default_rng(seed)
    joint = team(chance)
    factors = [plain(chance, joint) for _ in range(6)]
    one_by_one, chain = joint.copy(), Chain(joint, factors)
    for factor in factors:
        innovation, alone = chain.next(), moved(factor, one_by_one, joint.mean)
        assert np.allclose(innovation.residual, alone.residual, rtol=1e-6, atol=1e-8)
        assert np.allclose(innovation.covariance, one_by_one.innovation(alone).covariance, rtol=1e-6, atol=1e-8)
        if chance.random() < 0.7:
            wider = float(chance.choice([1.0, 3.0]))
            chain.add(factor.widened(wider))
            one_by_one.update(alone.widened(wider))
    taken = chain.taken()
    if taken is not None:
        joint.update(taken[0], expected=taken[1])
    assert np.allclose(joint.mean, one_by_one.mean, rtol=1e-6, atol=1e-8)
    assert np.allclose(joint.covariance, one_by_one.covariance, rtol=1e-6, atol=1e-8)


def test_what_is_exact_on_both_sides_says_nothing_to_a_chain() -> None:
    joint = Joint.of({robot: Moments(np.zeros(STATES), np.zeros((STATES, STATES))) for robot in ROBOTS})
    factor = Factor(np.zeros(2), {ROBOTS[0]: np.eye(2, STATES)}, np.zeros((2, 2)))
    chain = Chain(joint, [factor, factor])
    for _ in range(2):
        assert chain.next().squared == pytest.approx(0.0)
        chain.add(factor)
    assert chain.taken() is None
