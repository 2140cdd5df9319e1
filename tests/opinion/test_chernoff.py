"""The geometric mean with the weights of least entropy: two opinions, and many."""

import math

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
    forward, backward = chernoff(first, second)[0], chernoff(second, first)[0]
    assert entropy(forward) == pytest.approx(entropy(backward), abs=1e-3)


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


def test_of_opinions_that_contradict_each_other_it_believes_the_sharpest() -> None:
    """Its known flaw (theory.md): one sure liar against four."""
    honest = [gaussian(GRID, (15 + i, 20), 3).p for i in range(4)]
    liar = gaussian(GRID, (32, 20), 1).p
    assert POOLS["chernoff"](np.stack([*honest, liar])) == pytest.approx(liar, abs=1e-6)


# --- against exhaustive searches ---------------------------------------------------------------------------------------------

#: Its centre is the point (0, 0).
CENTRED = Grid((40, 40), 0.5, (-10.0, -10.0))

#: Sigmas of two Gaussians whose best mean lies at many weights between 0 and 1, and at the ends.
PAIRS = [((0.5 + 0.25 * i, 3.0), (3.0 - 0.2 * j, 0.5 + 0.15 * i)) for i in range(6) for j in range(6)]


def finest(first: Array, second: Array, low: float = 0.0, high: float = 1.0) -> tuple[float, float]:
    """The least entropy of the mean of two, and its weight to 1e-4, by looking everywhere, then closer."""
    finest_pair = min((entropy(mean(first, second, w)), w) for w in np.linspace(low, high, 21))
    width = (high - low) / 20
    if width < 1e-4:
        return finest_pair
    return finest(first, second, max(0.0, finest_pair[1] - width), min(1.0, finest_pair[1] + width))


@pytest.mark.parametrize("sigmas", PAIRS)
def test_the_weight_of_least_entropy_is_found_to_its_stated_precision(
    sigmas: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    """Within 2 * 0.2 * golden^7 = 0.014 of the best, and within 1e-3 nats of the least entropy."""
    first, second = (gaussian(CENTRED, (x, 0.3), s).p for x, s in zip((-0.2, 0.4), sigmas, strict=True))
    least, best = finest(first, second)
    fused, w = chernoff(first, second)
    assert w == pytest.approx(best, abs=0.0139)
    assert chernoff(second, first)[1] == pytest.approx(1 - best, abs=0.0139)
    assert fused == pytest.approx(mean(first, second, w), abs=1e-12)
    assert entropy(fused) <= least + 1e-3


def test_cells_far_below_what_matters_change_nothing() -> None:
    """The search leaves faint cells out; the result is the same as with them."""
    first, second = gaussian(CENTRED, (-6, 0), (1.5, 0.6)).p, gaussian(CENTRED, (-6, 0), (0.6, 1.5)).p
    floored = [0.999999 * p + 1e-6 / CENTRED.size for p in (first, second)]
    assert chernoff(first, second)[1] == pytest.approx(chernoff(floored[0], floored[1])[1], abs=0.02)


def test_a_mean_hardly_sharper_than_an_opinion_is_not_worth_it() -> None:
    """Of beliefs equal to rounding the first stands as it is, whichever has less entropy by less than a millionth of a nat."""
    p = gaussian(CENTRED, (0, 0), 2).p
    q = p * (1 + 1e-9 * np.sin(np.arange(p.size)).reshape(p.shape))
    q = q / q.sum()
    for first, second in ((p, q), (q, p)):
        fused, w = chernoff(first, second)
        assert w == 1.0
        assert fused is first


def test_the_pool_of_many_finds_the_weights_of_least_entropy() -> None:
    """Against all weights in steps of 1/20, of four opinions that each know one direction best."""
    shapes = ((4.0, 0.7), (0.7, 4.0), (2.0, 2.0), (5.0, 5.0))
    stack = np.stack([gaussian(CENTRED, (0.3 * i, -0.2 * i), s).p for i, s in enumerate(shapes)])
    fused = entropy(POOLS["chernoff"](stack))
    logs = np.log(stack).reshape(4, -1)
    least = math.inf
    for i in range(21):
        for j in range(21 - i):
            for k in range(21 - i - j):
                mixed = np.array([i, j, k, 20 - i - j - k]) / 20 @ logs
                q = np.exp(mixed - mixed.max())
                least = min(least, entropy(q / q.sum()))
    assert fused <= least + 1e-3


def test_a_pool_of_many_that_gains_nothing_is_the_sharpest_opinion_itself() -> None:
    sharp, vague = gaussian(CENTRED, (0, 0), 1).p, gaussian(CENTRED, (0, 0), 3).p
    assert np.array_equal(POOLS["chernoff"](np.stack([vague, sharp, vague])), sharp / sharp.sum())
