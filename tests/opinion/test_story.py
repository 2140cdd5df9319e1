"""What a rule says that each opinion contributed: its weight in this very rule, by hand and against the slow version."""

import numpy as np
import pytest
from hypothesis import given

from blackboard import POOLS, Grid, entropy_weights
from blackboard.opinion.belief import gaussian
from blackboard.opinion.components import alphas, log_components, memberships
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import fuse
from blackboard.opinion.rules import Pooled, read_rule
from tests import oracles
from tests.opinion.stacks import KINDS, few, make, stacks, weighted

LINE = Grid((60,))
AGREE = np.stack([gaussian(LINE, (x,), s).p for x, s in ((20, 2), (21, 3), (22, 2.5))])
FAR = gaussian(LINE, (50,), 1.5).p
ONE_ODD = np.concatenate([AGREE, FAR[np.newaxis]])


def pooled_by(rule: str, opinions: Array, **own: object) -> Pooled:
    return fuse(read_rule({"rule": rule, **own}), opinions, Grid(opinions.shape[1:]))


def test_the_weights_depend_on_the_rule() -> None:
    """Fault 1: the same two opinions had the same weights and components under every rule."""
    two = np.stack([AGREE[0], gaussian(LINE, (26,), 6).p])
    weights = {rule: tuple(pooled_by(rule, two).weights.round(6)) for rule in POOLS}
    assert weights["linear"] == tuple(entropy_weights(two, 2.0).round(6))
    assert weights["logarithmic"] == weights["channel-filter"] == (1.0, 1.0)
    assert weights["geometric"] == weights["harmonic"] == weights["hoelder"] == (0.5, 0.5)
    assert weights["clique"] == (1.0, 1.0)
    assert weights["chernoff"] == (1.0, 0.0)
    assert len({weights[rule] for rule in ("linear", "logarithmic", "geometric", "cooperative", "coalition")}) == 5, (
        weights
    )
    with_components = {rule for rule in POOLS if len(pooled_by(rule, two).components)}
    assert with_components == {"cooperative", "calibrated", "coalition"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_memberships_are_the_sum_over_all_subsets(kind: str, n: int) -> None:
    rng = np.random.default_rng(n)
    opinions, weights = make(kind, n, (5,), rng), rng.random(n)
    terms = log_components(opinions, weights) / alphas(n)[:, np.newaxis]
    mass = np.exp(terms - terms.max())
    mass /= mass.sum()
    assert memberships(opinions, weights, mass) == pytest.approx(
        oracles.memberships(opinions, weights.tolist(), mass), abs=1e-8
    )


def test_memberships_where_products_are_below_the_smallest_float() -> None:
    rng = np.random.default_rng(11)
    opinions = 1e-60 * rng.random((8, 16))
    for i, opinion in enumerate(opinions):
        opinion[2 * i : 2 * i + 2] = 0.4 + 0.2 * rng.random(2)
    opinions /= opinions.sum(axis=1, keepdims=True)
    mass = rng.random(opinions.shape)
    mass /= mass.sum()
    expected = oracles.memberships(opinions, [1.0] * 8, mass)
    assert memberships(opinions, None, mass) == pytest.approx(expected, abs=1e-8)


@few
@given(weighted(most=4))
def test_memberships_add_up_to_the_size_of_the_coalitions(drawn: tuple[Array, Array]) -> None:
    opinions, weights = drawn
    for rule in ("cooperative", "calibrated", "coalition"):
        pooled = read_rule({"rule": rule}).pool(opinions, weights)
        sizes = np.arange(1, len(opinions) + 1)
        assert pooled.weights.sum() == pytest.approx(pooled.components @ sizes, abs=1e-6), rule
        assert pooled.weights.max() <= 1 + 1e-9


def test_who_disagrees_is_in_no_coalition() -> None:
    for rule in ("cooperative", "calibrated", "coalition"):
        weights = pooled_by(rule, ONE_ODD).weights
        assert weights[:3] == pytest.approx([1, 1, 1], abs=0.02), rule
        assert weights[3] < 0.01, rule


def test_who_is_not_in_the_clique_has_no_weight() -> None:
    assert pooled_by("clique", ONE_ODD).weights.tolist() == [1, 1, 1, 0]
    camps = np.stack([AGREE[0], AGREE[1], FAR, FAR])
    assert pooled_by("clique", camps).weights.tolist() == [0.5] * 4  # two cliques, equally large
    behind = pooled_by("clique", ONE_ODD, inner="cooperative")
    assert behind.components == pytest.approx(pooled_by("cooperative", AGREE).components)


def test_the_median_says_how_often_an_opinion_was_it() -> None:
    opinions = np.array([[0.1, 0.2, 0.7], [0.2, 0.5, 0.3], [0.3, 0.6, 0.1]])
    pooled = pooled_by("median-log", opinions)
    assert pooled.p == pytest.approx([0.2, 0.5, 0.3])  # the second opinion in every cell
    assert pooled.weights == pytest.approx([0, 1, 0])
    pair = pooled_by("median-log", opinions[:2])
    assert pair.weights == pytest.approx([0.5, 0.5])
    twins = pooled_by("median-log", np.stack([opinions[0]] * 2))
    assert twins.weights == pytest.approx([0.5, 0.5])


def test_the_geometric_median_of_a_majority_is_one_of_them() -> None:
    assert pooled_by("geometric-median", np.stack([FAR, AGREE[0], AGREE[0]])).weights[0] == 0.0


@few
@given(stacks(("random", "near-zero"), least=2, most=4))
def test_chernoff_s_weights_are_the_ones_that_were_found(opinions: Array) -> None:
    pooled = pooled_by("chernoff", opinions)
    assert pooled.weights.sum() == pytest.approx(1.0)
    assert POOLS["geometric"](opinions, pooled.weights) == pytest.approx(pooled.p, abs=1e-9)


def test_a_veto_is_told_and_answered_by_the_linear_pool() -> None:
    """Fault 2: after a veto a board pooled linearly and named the rule that had not."""
    apart = np.eye(4)[:2]
    for rule in ("logarithmic", "geometric", "harmonic", "median-log", "channel-filter"):
        pooled = pooled_by(rule, apart)
        assert pooled.outcome == "veto: linear", rule
        assert pooled.p == pytest.approx([0.5, 0.5, 0, 0])
        assert pooled.weights == pytest.approx([0.5, 0.5])
    assert all(
        pooled_by(rule, apart).outcome == "pooled" for rule in ("linear", "chernoff", "coalition", "clique", "hoelder")
    )


def test_only_a_cautious_rule_claims_less_than_its_opinions_would_together() -> None:
    for rule in POOLS:
        pooled = pooled_by(rule, AGREE)
        assert np.array_equal(pooled.claim(), pooled.p) == (rule != "coalition"), rule
    assert np.array_equal(pooled_by("coalition", AGREE).claim(), pooled_by("coalition", AGREE, independence=1).p)
    behind = pooled_by("clique", ONE_ODD, inner="coalition")
    assert behind.claim() == pytest.approx(pooled_by("coalition", AGREE, independence=1).p, abs=1e-12)
