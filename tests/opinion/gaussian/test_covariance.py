"""A large covariance whose changes wait is the one that is changed at once."""

import numpy as np
import pytest

from blackboard.opinion.gaussian.covariance import LARGE, Covariance
from blackboard.opinion.grid import Array

BLOCK = 12  # states, of which the first two lean on the third


class AtOnce:
    """The same by whole products."""

    def __init__(self, matrix: Array) -> None:
        self.matrix = matrix

    def subtract(self, rows: Array) -> None:
        self.matrix = self.matrix - rows.T @ rows

    def shear(self, to: Array, by: Array, factors: Array) -> None:
        turn = np.eye(len(self.matrix))
        turn[to, by] = factors
        self.matrix = turn @ self.matrix @ turn.T


def of_size(states: int, chance: np.random.Generator) -> Array:
    root = chance.normal(size=(states, states + 5))
    return np.asarray(root @ root.T / states + np.eye(states))


def change(matrix: Covariance | AtOnce, blocks: int, seed: int) -> None:
    """Many changes of both kinds."""
    chance = np.random.default_rng(seed)
    for _ in range(60):
        rows = chance.normal(scale=0.01, size=(chance.integers(1, 4), blocks * BLOCK))
        matrix.subtract(rows)
        heading = BLOCK * chance.permutation(blocks)[: blocks // 2] + 2
        to, by = np.concatenate([heading - 2, heading - 1]), np.concatenate([heading, heading])
        matrix.shear(to, by, chance.normal(scale=0.1, size=len(to)))


@pytest.mark.parametrize("blocks", [3, LARGE // BLOCK + 2], ids=["small", "large"])
@pytest.mark.parametrize("seed", range(4))
def test_what_waits_counts_at_once(blocks: int, seed: int) -> None:
    matrix = of_size(blocks * BLOCK, np.random.default_rng(seed))
    covariance, plain = Covariance(matrix.copy()), AtOnce(matrix)
    for changed in (covariance, plain):
        change(changed, blocks, seed)
    some = [slice(BLOCK * k, BLOCK * (k + 1)) for k in (2, 0)]
    index = np.concatenate([np.arange(place.start, place.stop) for place in some])
    parts = [np.random.default_rng(seed).normal(size=(2, BLOCK)) for _ in some]
    expected = sum(part @ plain.matrix[place] for place, part in zip(some, parts, strict=True))
    close = {"rtol": 1e-9, "atol": 1e-9 * np.abs(plain.matrix).max()}
    assert np.allclose(covariance.among(index), plain.matrix[np.ix_(index, index)], **close)
    assert np.allclose(covariance.rows(list(zip(some, parts, strict=True))), expected, **close)
    assert np.allclose(covariance.diagonal(), plain.matrix.diagonal(), **close)
    assert np.allclose(covariance.matrix, plain.matrix, **close)
    assert np.array_equal(covariance.matrix, covariance.matrix.T)


def test_equal_changes_give_equal_bits_whatever_is_asked_for_in_between() -> None:
    blocks = LARGE // BLOCK + 2
    matrix = of_size(blocks * BLOCK, np.random.default_rng(1))
    first, second = Covariance(matrix.copy()), Covariance(matrix.copy())
    for seed in (3, 4):
        second.diagonal(), second.among(np.arange(BLOCK)), second.rows([(slice(0, BLOCK), np.eye(BLOCK))])
        change(first, blocks, seed), change(second, blocks, seed)
    assert np.array_equal(first.matrix, second.matrix)


@pytest.mark.parametrize("blocks", [3, LARGE // BLOCK + 2], ids=["small", "large"])
def test_what_would_cancel_a_variance_is_refused_and_changes_nothing(blocks: int) -> None:
    covariance = Covariance(np.eye(blocks * BLOCK))
    rows = np.zeros((1, blocks * BLOCK))
    rows[0, 5] = 1.0
    assert not covariance.subtract(rows)
    assert np.array_equal(covariance.matrix, np.eye(blocks * BLOCK))
    assert covariance.subtract(0.9 * rows)
    assert covariance.diagonal()[5] == pytest.approx(0.19)
