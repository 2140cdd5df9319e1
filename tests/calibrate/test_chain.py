"""The chain of ticks against plain linear algebra, and the model's derivatives against differences."""

import numpy as np
import pytest

from blackboard.calibrate.chain import Factors, NormalEquations
from blackboard.calibrate.drives import drives_of
from blackboard.calibrate.model import EACH, EXPECTED, LAG, Model, Noise
from tests.calibrate.teams import Robot, team

TICKS, ROBOTS, SHARED = 5, 2, 2


def factors(rng: np.random.Generator) -> list[Factors]:
    """Random measurements that tie all poses to each other and to the shared numbers."""
    k, n = (index.ravel() for index in np.mgrid[1:TICKS, 0:ROBOTS])
    shape = (len(k), 3)
    ties = Factors(
        rng.normal(size=shape),
        rng.uniform(0.5, 2.0, shape),
        [(k, n, rng.normal(size=(*shape, 3))), (k - 1, n, rng.normal(size=(*shape, 3)))],
        [(n, rng.normal(size=(*shape, SHARED)))],
    )
    mates = Factors(
        rng.normal(size=shape),
        rng.uniform(0.5, 2.0, shape),
        [(k, n, rng.normal(size=(*shape, 3))), (k - 1, 1 - n, rng.normal(size=(*shape, 3)))],
        [(n, rng.normal(size=(*shape, SHARED)))],
    )
    return [ties, mates]


def rows(part: Factors) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as one matrix over all poses and shared numbers, its right side, and its weights."""
    m = part.residual.shape[1]
    matrix = np.zeros((len(part.residual), m, 3 * ROBOTS * TICKS + SHARED * ROBOTS))
    for row in range(len(part.residual)):
        for tick, robot, by in part.poses:
            at = 3 * (ROBOTS * int(tick[row]) + int(robot[row]))
            matrix[row, :, at : at + 3] += by[row]
        for owner, shared in part.shared:
            at = 3 * ROBOTS * TICKS + SHARED * int(owner[row])
            matrix[row, :, at : at + SHARED] += shared[row]
    return matrix.reshape(-1, matrix.shape[2]), part.residual.ravel(), part.weight.ravel()


def test_a_chain_is_least_squares() -> None:
    rng = np.random.default_rng(1)
    some, chain = factors(rng), NormalEquations.of(TICKS, ROBOTS, SHARED)
    for part in some:
        chain.add(part)
    each = range(3 * ROBOTS)
    chain.diagonal[:, each, each] += 1.0
    chain.corner[...] += np.eye(SHARED * ROBOTS)
    solved = chain.solved()
    dense = [rows(part) for part in some]
    matrix = np.eye(dense[0][0].shape[1]) + sum(a.T @ (w[:, None] * a) for a, _, w in dense)
    right = sum(a.T @ (w * r) for a, r, w in dense)
    inverse = np.linalg.inv(matrix)
    answer = np.concatenate([solved.poses.ravel(), solved.shared])
    assert answer == pytest.approx(inverse @ right)
    assert solved.log_determinant == pytest.approx(np.linalg.slogdet(matrix)[1])
    assert solved.covariance == pytest.approx(inverse[-SHARED * ROBOTS :, -SHARED * ROBOTS :])
    for part, (a, _, _) in zip(some, dense, strict=True):
        assert solved.variances(part).ravel() == pytest.approx(np.einsum("ia,ab,ib->i", a, inverse, a))
        poses = slice(0, 3 * ROBOTS * TICKS)
        follows = -np.linalg.solve(matrix[poses, poses], matrix[poses, 3 * ROBOTS * TICKS :])
        expected = a[:, poses] @ follows + a[:, 3 * ROBOTS * TICKS :]
        assert solved.profile(part).reshape(len(a), -1) == pytest.approx(expected)


@pytest.mark.parametrize("which", ["odometry", "sightings"])
def test_derivatives_are_those_of_the_model(which: str) -> None:
    """A small change of any pose or shared number changes what is expected by the derivative times it."""
    rng = np.random.default_rng(2)
    drives = drives_of(team([Robot(), Robot()], 6.0, 1))
    model, noise, robots = Model(drives, 0.26), Noise.usual(2), 2
    poses = np.cumsum(0.1 * rng.normal(size=(len(drives.times), robots, 3)), axis=0)
    shared = np.tile(EXPECTED, (robots, 1)) + 0.05 * rng.normal(size=(robots, EACH))
    measure = getattr(model, which)
    before, small = measure(poses, shared, noise), 1e-6
    step, other = small * rng.normal(size=poses.shape), small * rng.normal(size=shared.shape)
    other[:, LAG] = 0.0  # its derivative is taken over a tick, because commands are steps
    expected = sum(np.einsum("mij,mj->mi", by, step[tick, robot]) for tick, robot, by in before.poses)
    expected = expected + sum(np.einsum("mij,mj->mi", by, other[robot]) for robot, by in before.shared)
    changed = measure(poses + step, shared + other, noise)
    assert before.residual - changed.residual == pytest.approx(expected, abs=2e-9)
