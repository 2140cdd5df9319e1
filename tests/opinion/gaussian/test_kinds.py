"""Sightings of every kind: their derivatives, what they share with range and bearing, and what a straight line misses of a ring."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import NUMBERS, Bias, Kind, Relative, measured
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, BEARING, HEADING, STATES, Motion, Nuisance, correct, wrap
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.driving import furthest_slope

SEEDS = st.integers(0, 10_000)
KINDS: list[Kind] = ["range", "bearing", "position", "pose"]
UPPER = {1: np.triu_indices(1), 2: np.triu_indices(2), 3: np.triu_indices(3)}


def two_robots(chance: np.random.Generator, scale: float = 0.01) -> Joint:
    joint = Joint()
    for k, place in enumerate(([0.0, 0.0], [2.0, 0.7])):
        mean = np.zeros(STATES)
        mean[:3], mean[3:5] = [*place, chance.uniform(-3, 3)], 0.95
        joint.add(f"robot/r{k}", Moments(mean, np.eye(STATES)))
    root = chance.normal(0, scale, (2 * STATES, 2 * STATES + 3))
    joint.covariance = root @ root.T / (2 * STATES)
    return joint


def truly(joint: Joint, kind: Kind, off: Array) -> list[float]:
    """What a sighting of r1 by r0 would measure if the means were true, and its error."""
    observer, observed = (joint.mean[joint.blocks[f"robot/r{k}"]] for k in (0, 1))
    away, camera = (observed - observer)[AXES], observer[HEADING] - observer[BEARING]
    c, s = math.cos(camera), math.sin(camera)
    x, y = np.array([[c, s], [-s, c]]) @ away
    values = {
        "range": [math.hypot(x, y)],
        "bearing": [math.atan2(y, x)],
        "position": [x, y],
        "pose": [x, y, wrap(observed[HEADING] - camera)],
    }[kind]
    return [float(a + b) for a, b in zip(values, off, strict=False)]


def covariance_of(kind: Kind, chance: np.random.Generator) -> tuple[float, ...]:
    size = NUMBERS[kind]
    root = chance.normal(0, 0.1, (size, size + 2))
    return tuple(((root @ root.T) + 1e-4 * np.eye(size))[UPPER[size]].tolist())


def drawn(joint: Joint, kind: Kind, chance: np.random.Generator, off: float = 0.01) -> Relative:
    values = truly(joint, kind, chance.normal(0, off, 3))
    biases = (Bias(0.1, 7.0),) if kind != "bearing" else ()
    return measured(kind, "robot/r0", "robot/r1", values, covariance_of(kind, chance), 0.0, biases)


@pytest.mark.parametrize("kind", KINDS)
@given(seed=SEEDS)
def test_each_kind_has_the_derivatives_that_it_says(kind: Kind, seed: int) -> None:
    chance = np.random.default_rng(seed)
    joint = two_robots(chance, scale=1e-3)
    relative = drawn(joint, kind, chance, off=0.0)
    factor = linearise(joint, relative, {})
    assert len(factor.residual) == NUMBERS[kind]
    assert np.abs(factor.residual).max() < 1e-3  # a millimetre is the second-order term
    assert furthest_slope(joint, relative, factor) < 2e-3


@pytest.mark.parametrize("wide", [False, True], ids=["polar", "cartesian"])
@given(seed=SEEDS)
def test_a_position_is_a_range_and_a_bearing_where_its_errors_lie_along_and_across(wide: bool, seed: int) -> None:
    chance = np.random.default_rng(seed)
    joint = two_robots(chance, scale=1.0 if wide else 0.05)
    # As expected: its errors are as large as those that it says.
    distance, bearing = math.hypot(2.0, 0.7), chance.uniform(-3, 3)
    polar = Relative("robot/r0", "robot/r1", distance, bearing, 0.04, 0.01, 0.0, (Bias(0.1, 7.0),))
    c, s = math.cos(bearing), math.sin(bearing)
    frame = np.array([[c, -s], [s, c]])
    covariance = (frame * [0.04, distance**2 * 0.01]) @ frame.T
    place = [distance * c, distance * s]
    other = measured("position", "robot/r0", "robot/r1", place, covariance[UPPER[2]].tolist(), biases=(Bias(0.1, 7.0),))
    first, second = linearise(joint, polar, {}), linearise(joint, other, {})
    assert np.allclose(first.residual, second.residual)
    assert np.allclose(first.noise, second.noise)
    assert {
        block: np.allclose(rows, second.jacobians[block]) for block, rows in first.jacobians.items()
    } == dict.fromkeys(first.jacobians, True)


def test_ranges_whose_errors_grow_with_them_pull_nobody_nearer() -> None:
    """Errors of a fifth of the range: weighed by what was measured, 50 of them put a robot 8 % too near."""
    chance, place, share, residuals = np.random.default_rng(5), np.array([4.0, 0.0]), 0.2, []
    for _ in range(30):
        joint = Joint()
        mean = np.zeros(STATES)
        mean[:2], mean[3:5] = chance.normal(size=2) * 0.5, 1.0
        joint.add("robot/r0", Moments(mean, np.diag([0.25, 0.25, *(0.0,) * (STATES - 2)])))
        for _ in range(50):
            measured_range = 4.0 * (1 + share * chance.normal())
            bias = (Bias(0.01 * measured_range, 100.0),)
            relative = Relative(
                "robot/r0", "landmark/1", measured_range, 0.0, (share * measured_range) ** 2, 1e-4, 0.0, bias
            )
            joint.update(linearise(joint, relative, {}, place))
        residuals.append(joint.mean[0])
    assert np.mean(residuals) == pytest.approx(0.0, abs=0.06), "0.02 is the sigma of the mean"


@pytest.mark.parametrize("kind", KINDS)
@given(seed=SEEDS)
def test_what_was_measured_is_told_again_as_it_was(kind: Kind, seed: int) -> None:
    chance = np.random.default_rng(seed)
    values, covariance = tuple(chance.uniform(0.1, 3, NUMBERS[kind]).tolist()), covariance_of(kind, chance)
    numbers = measured(kind, "robot/r0", "robot/r1", values, covariance).numbers()
    assert np.allclose(numbers[0], values)
    assert numbers[1] == pytest.approx(covariance)


@pytest.mark.parametrize("kind", ["range", "bearing", "range-bearing"])
@pytest.mark.parametrize("sigma", [0.1, 0.25, 0.4])
def test_what_a_line_misses_of_a_ring_is_expected_and_added_to_the_noise(kind: Kind, sigma: float) -> None:
    """Against samples of the place. A range with its bearing is polar up to a seventh of the distance, or where a heading is unsure."""
    chance, joint = np.random.default_rng(1), Joint()
    unsure = np.zeros((STATES, STATES))
    unsure[HEADING, HEADING] = 0.04
    joint.add("robot/r0", Moments(np.zeros(STATES), unsure))
    root = sigma * np.array([[1.0, 0.0], [0.5, 0.8]])
    joint.add("object/ball", Moments(np.array([2.0, 0.0]), root @ root.T))
    if kind == "range-bearing":
        relative = Relative("robot/r0", "object/ball", 2.0, 0.0, 1e-12, 1e-12)
    else:
        relative = measured(kind, "robot/r0", "object/ball", [2.0 if kind == "range" else 0.0], [1e-12])
    factor, places = linearise(joint, relative, {}), np.array([2.0, 0.0]) + chance.normal(size=(400_000, 2)) @ root.T
    samples = np.array([np.hypot(*places.T) - 2.0, 2.0 * np.arctan2(places[:, 1], places[:, 0])])
    samples[1] -= 2.0 * 0.2 * chance.normal(size=len(places))
    rows = {"range": [0], "bearing": [1]}.get(kind, [0, 1])
    spread = np.atleast_2d(np.cov(samples[rows]))
    assert -factor.residual == pytest.approx(samples[rows].mean(axis=1), abs=0.12 * sigma**2)
    assert joint.innovation(factor).covariance == pytest.approx(spread, rel=0.15, abs=0.05 * np.max(spread))


@pytest.mark.parametrize("flat", [True, False], ids=["in x and y", "in range and bearing"])
@pytest.mark.parametrize("across", [0.02, 0.1], ids=["narrow", "wide"])
def test_many_positions_are_taken_as_their_errors_lie(flat: bool, across: float) -> None:
    """Before, those in x and y were 4 sigmas too near where the bearing errs by 0.1: each range was too long by across ** 2 / 2."""
    chance, joint, place = np.random.default_rng(5), Joint(), np.array([20.0, 5.0])
    mean = np.array([0.0, 0.0, 0.0, 1.0, 1.0, *[0.0] * (STATES - 5)])
    joint.add("robot/r0", Moments(mean, np.diag([1e-6, 1e-6, 1e-8] + [1e-12] * (STATES - 3))))
    joint.add("object/ball", Moments(place + chance.normal(size=2), np.eye(2)))
    far, angle = math.hypot(*place), math.atan2(place[1], place[0])
    for _ in range(300):
        off = chance.normal(size=2) * (0.05, across)
        seen = angle if flat else angle + off[1]
        frame = np.array([[math.cos(seen), -math.sin(seen)], [math.sin(seen), math.cos(seen)]])
        values = place + frame @ (off[0], far * off[1]) if flat else frame @ (far + off[0], 0.0)
        covariance = (frame * [0.05**2, (far * across) ** 2]) @ frame.T
        sighting = measured("position", "robot/r0", "object/ball", values.tolist(), covariance[UPPER[2]].tolist())
        correct(joint, linearise(joint, sighting, {}))
    error, ball = joint.mean[joint.blocks["object/ball"]] - place, joint.moments("object/ball")
    assert error @ np.linalg.solve(ball.covariance, error) <= 9.2, "99 %"


def test_a_pose_tells_the_heading_of_a_mate() -> None:
    joint = two_robots(np.random.default_rng(3), scale=0.05)
    its = joint.blocks["robot/r1"].start + HEADING
    joint.covariance[its, its] += 1.0
    relative = measured(
        "pose", "robot/r0", "robot/r1", truly(joint, "pose", np.array([0.0, 0.0, 0.1])), (0.01, 0, 0, 0.01, 0, 1e-4)
    )
    before = joint.mean[its]
    correct(joint, linearise(joint, relative, {}))
    assert wrap(joint.mean[its] - before) == pytest.approx(0.1, abs=0.02)
    assert joint.covariance[its, its] < 0.1


def test_a_pose_of_what_is_no_robot_is_a_position() -> None:
    joint, covariance = two_robots(np.random.default_rng(3)), (0.01, 0.002, 0.1, 0.02, 0.1, 1.0)
    pose = linearise(joint, measured("pose", "robot/r0", "object/ball", (1.0, 2.0, 0.5), covariance), {})
    position = linearise(joint, measured("position", "robot/r0", "object/ball", (1.0, 2.0), (0.01, 0.002, 0.02)), {})
    assert np.array_equal(pose.residual, position.residual)
    assert np.allclose(pose.noise, position.noise)


def entering(robot: str, tick: int, relatives: tuple[Relative, ...] = ()) -> Evidence:
    mean = np.array([0.0, 0.0, 0.0, 1.0, 1.0, *[0.0] * (STATES - 5)])
    belief = Moments(mean, np.diag([0.01] * 2 + [1e-4] * (STATES - 2)))
    return Evidence(robot, 0, tick, Motion(), Nuisance(), belief, relatives=relatives)


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_a_range_alone_of_what_nobody_knows_waits_and_of_what_is_known_counts(kind: Kind) -> None:
    team = TeamJoint()
    alone = measured(kind, "robot/r0", "object/ball", [1.0 if kind == "range" else 0.0], [1e-4])
    team.settle(0, 1.0, [entering("robot/r0", 0, (alone,))])
    assert not team.knows("object/ball")
    assert team.tally.silent == 1
    placed = Relative("robot/r1", "object/ball", 1.0, 0.0, 0.25, 0.25)
    team.settle(1, 1.0, [entering("robot/r1", 1, (placed,))])
    before = np.trace(team.marginal("object/ball").covariance)
    again = [Evidence("robot/r0", 0, 2, Motion(), Nuisance(), relatives=(alone,))]
    (verdict,) = team.settle(2, 0.0, again)
    assert (verdict.taken, verdict.freedom) == (True, 1)
    assert np.trace(team.marginal("object/ball").covariance) < before
