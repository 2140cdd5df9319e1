"""How good the searches are, against exhaustive ones: a step in the wrong direction is noticed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from blackboard import POOLS, Grid, OpinionError, entropy
from blackboard.errors import RuleError
from blackboard.opinion.agreement import kullback_leibler
from blackboard.opinion.belief import gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.grid import Array
from blackboard.opinion.rules import find, read_rule

GRID = Grid((40, 40), 0.5, (-10.0, -10.0))

#: Sigmas of two Gaussians whose best mean lies at many weights between 0 and 1, and at the ends.
PAIRS = [((0.5 + 0.25 * i, 3.0), (3.0 - 0.2 * j, 0.5 + 0.15 * i)) for i in range(6) for j in range(6)]


def mean(first: Array, second: Array, w: float) -> Array:
    """first^w second^(1-w), normalised."""
    logs = w * np.log(first) + (1 - w) * np.log(second)
    p = np.exp(logs - logs.max())
    return np.asarray(p / p.sum())


def finest(first: Array, second: Array, low: float = 0.0, high: float = 1.0) -> tuple[float, float]:
    """The least entropy of the mean of two, and its weight to 1e-4, by looking everywhere, then closer."""
    found = min((entropy(mean(first, second, w)), w) for w in np.linspace(low, high, 21))
    width = (high - low) / 20
    if width < 1e-4:
        return found
    return finest(first, second, max(0.0, found[1] - width), min(1.0, found[1] + width))


@pytest.mark.parametrize("sigmas", PAIRS)
def test_the_weight_of_least_entropy_is_found_to_its_stated_precision(
    sigmas: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    """Within 2 * 0.2 * golden^7 = 0.014 of the best, and within 1e-3 nats of the least entropy."""
    first, second = (gaussian(GRID, (x, 0.3), s).p for x, s in zip((-0.2, 0.4), sigmas, strict=True))
    least, best = finest(first, second)
    fused, w = chernoff(first, second)
    assert w == pytest.approx(best, abs=0.0139)
    assert fused == pytest.approx(mean(first, second, w), abs=1e-12)
    assert entropy(fused) <= least + 1e-3


def test_cells_far_below_what_matters_change_nothing() -> None:
    """The search leaves faint cells out; the result is the same as with them."""
    first, second = gaussian(GRID, (-6, 0), (1.5, 0.6)).p, gaussian(GRID, (-6, 0), (0.6, 1.5)).p
    floored = [0.999999 * p + 1e-6 / GRID.size for p in (first, second)]
    assert chernoff(first, second)[1] == pytest.approx(chernoff(floored[0], floored[1])[1], abs=0.02)


@pytest.mark.parametrize("kept", [0.0, 1e-3])
def test_a_mean_hardly_sharper_than_an_opinion_is_not_worth_it(kept: float) -> None:
    """Of beliefs equal to rounding the first stands as it is, whichever has less entropy by less than a millionth of a nat."""
    p = gaussian(GRID, (0, 0), 2).p
    q = p * (1 + 1e-9 * np.sin(np.arange(p.size)).reshape(p.shape))
    q = q / q.sum()
    for first, second in ((p, q), (q, p)):
        fused, w = chernoff(first, second)
        assert w == 1.0
        assert fused is first


def test_the_pool_of_many_finds_the_weights_of_least_entropy() -> None:
    """Against all weights in steps of 1/20, of four opinions that each know one direction best."""
    shapes = ((4.0, 0.7), (0.7, 4.0), (2.0, 2.0), (5.0, 5.0))
    stack = np.stack([gaussian(GRID, (0.3 * i, -0.2 * i), s).p for i, s in enumerate(shapes)])
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
    sharp, vague = gaussian(GRID, (0, 0), 1).p, gaussian(GRID, (0, 0), 3).p
    assert np.array_equal(POOLS["chernoff"](np.stack([vague, sharp, vague])), sharp / sharp.sum())


def test_weights_that_are_given_are_not_optimised() -> None:
    stack = np.stack([gaussian(GRID, (0, 0), s).p for s in ((2.0, 0.8), (0.8, 2.0))])
    assert POOLS["chernoff"](stack, [0.9, 0.1]) == pytest.approx(mean(stack[0], stack[1], 0.9), abs=1e-12)


def test_huge_and_tiny_weights_are_shares_of_their_sum() -> None:
    stack = np.stack([gaussian(GRID, (x, 0), 2).p for x in (-1, 2)])
    for scale in (1e-200, 1e200):
        assert POOLS["linear"](stack, [scale, 3 * scale]) == pytest.approx(0.25 * stack[0] + 0.75 * stack[1])


def test_two_opinions_nearly_alike_have_a_geometric_median_between_them() -> None:
    p, q = (gaussian(GRID, (x, 0), 2).p for x in (0.0, 1e-9))
    far = gaussian(GRID, (5, 5), 1).p
    pooled = POOLS["geometric-median"](np.stack([p, q, far]))
    assert np.abs(pooled - p).max() < 1e-6


@pytest.mark.parametrize("rule", ["logarithmic", "geometric", "hoelder", "linear"])
def test_an_opinion_of_weight_zero_has_no_veto(rule: str) -> None:
    vetoing, other = np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.3, 0.5])
    assert POOLS[rule](np.stack([vetoing, other]), [0.0, 1.0]) == pytest.approx(other)


@pytest.mark.parametrize("weight", [-0.5, -1e-12])
def test_no_weight_is_negative(weight: float) -> None:
    with pytest.raises(OpinionError, match="weight 1: "):
        POOLS["linear"](np.full((2, 3), 1 / 3), [1.0, weight])


# --- the parameters of the rules ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "key", "within", "beyond"),
    [
        ("cooperative", "k", (0, 10), (-0.01, 10.01)),
        ("cooperative", "reference_cell", (0.01, 1e6), (0, -0.01)),
        ("cooperative", "gamma", (0.01, 1), (0, 1.01)),
        ("calibrated", "gamma", (0.01, 1), (0, 1.01)),
        ("calibrated", "power", (0.01, 1e6), (0, -0.01)),
        ("coalition", "gamma", (0.01, 1), (0, 1.01)),
        ("coalition", "gate", (0.01, 1e6), (0, -0.01)),
        ("coalition", "independence", (0, 1), (-0.01, 1.01)),
        ("hoelder", "a", (-20, 20), (-20.01, 20.01)),
        ("clique", "xi", (0.01, 1e6), (0, -0.01)),
    ],
)
def test_a_parameter_is_taken_up_to_its_bounds_and_refused_beyond(
    rule: str, key: str, within: tuple[float, float], beyond: tuple[float, float]
) -> None:
    for value in within:
        assert read_rule({"rule": rule, key: value}).in_force()[key] == value
    for value in beyond:
        with pytest.raises(RuleError, match=key):
            read_rule({"rule": rule, key: value})


def test_the_rules_have_these_defaults() -> None:
    names = ("linear", "hoelder", "cooperative", "calibrated", "coalition", "clique")
    assert [find(name)().in_force() for name in names] == [
        {"rule": "linear", "k": 2.0},
        {"rule": "hoelder", "a": 0.5},
        {"rule": "cooperative", "k": 2.0, "gamma": 0.5},
        {"rule": "calibrated", "k": 2.0, "gamma": 0.5},
        {"rule": "coalition", "k": 2.0, "gate": 4.0, "independence": "learn"},
        {"rule": "clique", "inner": "logarithmic", "xi": 2.0},
    ]


@pytest.mark.parametrize("name", POOLS)
def test_what_tune_tries_is_within_the_bounds_and_rises(name: str) -> None:
    for it in dataclasses.fields(find(name)):  # type: ignore[arg-type]
        tried = it.metadata.get("tried", ())
        assert list(tried) == sorted(set(tried))
        assert [read_rule({"rule": name, it.name: value}).in_force()[it.name] for value in tried] == list(tried)


@pytest.mark.parametrize("name", POOLS)
def test_where_no_ratio_of_cells_is_given_the_cells_are_the_grids_own(name: str) -> None:
    rule, stack = find(name)(), np.random.default_rng(1).dirichlet(np.ones(8), 3)
    weights = np.array([0.5, 0.3, 0.2])
    assert np.array_equal(rule.pool(stack, weights).p, rule.pool(stack, weights, cell_ratio=1.0).p)


def test_a_divergence_is_never_negative() -> None:
    """Where two beliefs differ by less than rounding, its sum falls below 0 in about half of the cases."""
    chance = np.random.default_rng(1)
    for _ in range(50):
        p = chance.dirichlet(np.ones(50))
        q = p * (1 + 1e-9 * chance.standard_normal(50))
        assert 0 <= kullback_leibler(p, q / q.sum()) < 1e-12
