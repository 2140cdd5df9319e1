"""The geometric mean with the weights of least entropy: two opinions, and many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from blackboard import POOLS, Grid, entropy
from blackboard.opinion.belief import gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.grid import Array
from tests.opinion.stacks import few, stacks

GRID = Grid((40, 40))


def mean(first: Array, second: Array, w: float) -> Array:
    """first^w second^(1-w), normalised; 0^0 = 1."""
    p = first**w * second ** (1 - w)
    return np.asarray(p / p.sum())


@few
@given(stacks(least=2, most=2))
def test_no_weight_gives_less_entropy(opinions: Array) -> None:
    first, second = opinions
    fused, w = chernoff(first, second)
    assert fused.sum() == pytest.approx(1.0, abs=1e-6)
    assert 0 <= w <= 1
    assert fused == pytest.approx(mean(first, second, w), abs=1e-9)
    scanned = min(
        entropy(mean(first, second, v)) for v in np.linspace(0, 1, 21) if (first * second).any() or v in (0, 1)
    )
    assert entropy(fused) <= scanned + 0.01
    assert entropy(fused) <= min(entropy(first), entropy(second)) + 1e-6


@few
@given(stacks(("random", "near-zero"), least=2, most=2))
def test_the_two_may_change_places(opinions: Array) -> None:
    first, second = opinions
    one, other = chernoff(first, second)[0], chernoff(second, first)[0]
    assert entropy(one) == pytest.approx(entropy(other), abs=1e-3)


def test_crossed_gaussians_are_sharper_together() -> None:
    """Covariance intersection's textbook case: each is sharp where the other is not. The least is at w = 1/2, by symmetry."""
    long, tall = gaussian(GRID, (20, 20), (8, 1.5)).p, gaussian(GRID, (20, 20), (1.5, 8)).p
    fused, w = chernoff(long, tall)
    assert w == pytest.approx(0.5, abs=0.02)
    assert entropy(fused) < entropy(long) - 0.5
    assert chernoff(tall, long)[0] == pytest.approx(fused, abs=1e-3)


@pytest.mark.parametrize("first", [(7.0, 1.5), (5.0, 2.0), (4.0, 1.5), (6.0, 2.2)])
@pytest.mark.parametrize("second", [(1.6, 6.0), (2.0, 3.5), (2.5, 7.0), (1.5, 2.5)])
def test_the_weight_of_crossed_gaussians_has_its_closed_form(
    first: tuple[float, float], second: tuple[float, float]
) -> None:
    """The information a_x a_y of w P + (1 - w) Q is greatest at w = -(b_x d_y + b_y d_x) / 2 d_x d_y, b that of Q, d = a - b."""
    grid = Grid((60, 60))
    p, q = (gaussian(grid, (30, 30), sigma).p for sigma in (first, second))
    (a_x, a_y), (b_x, b_y) = ([s**-2 for s in sigmas] for sigmas in (first, second))
    d_x, d_y = a_x - b_x, a_y - b_y
    best = min(1.0, max(0.0, -(b_x * d_y + b_y * d_x) / (2 * d_x * d_y)))
    assert chernoff(p, q)[1] == pytest.approx(best, abs=0.015)  # 0.2 golden^7 = 0.007 to either side, and the border
    assert chernoff(q, p)[1] == pytest.approx(1 - best, abs=0.015)


def test_an_echo_changes_nothing() -> None:
    p = gaussian(GRID, (12, 20), 3).p
    for echo in (p.copy(), 0.9 * p + 0.1 / GRID.size):
        fused, w = chernoff(p, echo)
        assert w == 1.0
        assert np.array_equal(fused, p)
        assert chernoff(echo, p)[0] == pytest.approx(p, abs=1e-12)


def test_without_a_common_cell_the_sharper_one_stands() -> None:
    vague, sure = np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.0, 1.0])
    assert chernoff(vague, sure) == (pytest.approx(sure), 0.0)
    assert chernoff(sure, vague) == (pytest.approx(sure), 1.0)
    assert POOLS["chernoff"](np.stack([vague, sure])) == pytest.approx(sure)


@few
@given(stacks(("random", "near-zero", "mixed"), least=2, most=4))
def test_the_pool_of_many_is_no_vaguer_than_any_mean(opinions: Array) -> None:
    fused = entropy(POOLS["chernoff"](opinions))
    assert fused <= min(entropy(p) for p in opinions) + 1e-6
    if (opinions > 0).all(axis=0).any():
        assert fused <= entropy(POOLS["geometric"](opinions)) + 1e-6


def test_the_pool_of_three_gaussians_finds_the_best_weights() -> None:
    sources = [gaussian(GRID, (20, 20), s).p for s in ((8, 1.5), (1.5, 8), (6, 6))]
    stack = np.stack(sources)
    fused = POOLS["chernoff"](stack)
    weights = [(i, j, 20 - i - j) for i in range(21) for j in range(21 - i)]
    assert entropy(fused) <= min(entropy(POOLS["geometric"](stack, w)) for w in weights) + 1e-3


def test_of_opinions_that_contradict_each_other_it_believes_the_sharpest() -> None:
    """Its known flaw (theory.md): one sure liar against four."""
    honest = [gaussian(GRID, (15 + i, 20), 3).p for i in range(4)]
    liar = gaussian(GRID, (32, 20), 1).p
    assert POOLS["chernoff"](np.stack([*honest, liar])) == pytest.approx(liar, abs=1e-6)
