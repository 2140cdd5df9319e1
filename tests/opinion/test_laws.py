"""The laws that every rule obeys, and those that tell the rules apart."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import POOLS, OpinionError, entropy_weights
from blackboard.opinion import laws
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import fuse
from blackboard.opinion.rules import EntropyWeighted, Rule, read_rule
from tests import oracles
from tests.opinion.stacks import SHAPES, few, make, stacks, weighted

#: Each rule with its defaults, and with other values where they make it another rule.
RULES: dict[str, tuple[str, dict[str, object]]] = {
    **{name: (name, {}) for name in POOLS},
    "hoelder-2": ("hoelder", {"a": -2.0}),
    "hoelder+3": ("hoelder", {"a": 3.0}),
    "coalition-1": ("coalition", {"independence": 1.0}),
    "coalition-0": ("coalition", {"independence": 0.0}),
    "coalition-gamma": ("coalition", {"gamma": 0.5, "independence": 0.0}),
    "clique-cooperative": ("clique", {"inner": "cooperative", "xi": 1.0}),
}
IDEMPOTENT = {
    "linear", "geometric", "chernoff", "hoelder", "hoelder-2", "hoelder+3", "harmonic", "median-log", "geometric-median",
}  # fmt: skip
#: One zero rules a cell out.
VETO = {"logarithmic", "geometric", "chernoff", "hoelder-2", "harmonic", "channel-filter", "clique"}
#: Whatever the opinions, some cell survives.
NEVER_EMPTY = {
    "linear", "chernoff", "hoelder", "hoelder+3", "cooperative", "calibrated", "coalition", "coalition-1", "coalition-0",
    "coalition-gamma",
    "geometric-median", "clique-cooperative",
}  # fmt: skip
#: Weights count relative to each other.
RELATIVE = set(RULES) - {"logarithmic", "channel-filter", "clique"}
each = pytest.mark.parametrize("name", RULES)


def pool(name: str, opinions: Array, weights: Array | None = None) -> Array:
    rule, own = RULES[name]
    return POOLS[rule](opinions, weights, **own)


def model(name: str) -> Rule:
    rule, own = RULES[name]
    return read_rule({"rule": rule, **own})


@few
@given(stacks(), st.integers(0, 1000))
def test_every_rule_keeps_the_laws_that_a_plug_in_is_put_to(opinions: Array, seed: int) -> None:
    for name in RULES:
        for law in set(laws.LAWS) - laws.ON_RANDOM_OPINIONS:
            law(model(name), opinions, np.random.default_rng(seed))


@few
@given(stacks(("random",)), st.integers(0, 1000))
def test_every_rule_keeps_the_laws_of_order(opinions: Array, seed: int) -> None:
    for name in RULES:
        for law in laws.ON_RANDOM_OPINIONS:
            law(model(name), opinions, np.random.default_rng(seed))


@few
@given(stacks())
def test_the_result_is_a_probability_vector_and_the_input_stays(opinions: Array) -> None:
    before = opinions.copy()
    opinions.flags.writeable = False
    for name in RULES:
        try:
            p = pool(name, opinions)
        except OpinionError as error:
            assert name not in NEVER_EMPTY
            assert "no cell is left" in str(error)
            assert not (opinions > 0).all(axis=0).any()
            continue
        assert p.shape == opinions.shape[1:], name
        assert p.min() >= 0, name
        assert p.sum() == pytest.approx(1.0, abs=1e-12), name
        assert np.array_equal(opinions, before), name


@few
@given(weighted(("random",)), st.integers(0, 1000))
def test_the_order_of_weighted_opinions_does_not_matter(drawn: tuple[Array, Array], seed: int) -> None:
    opinions, weights = drawn
    order = np.random.default_rng(seed).permutation(len(opinions))
    for name in RULES:
        assert pool(name, opinions[order], weights[order]) == pytest.approx(pool(name, opinions, weights), abs=1e-10), (
            name
        )


@few
@given(stacks(most=1), st.integers(2, 6))
def test_echoes_gain_nothing_where_a_rule_is_idempotent(opinions: Array, copies: int) -> None:
    for name in IDEMPOTENT:
        assert pool(name, np.repeat(opinions, copies, axis=0)) == pytest.approx(opinions[0], abs=1e-10), name


@pytest.mark.parametrize("name", sorted(set(RULES) - IDEMPOTENT))
def test_echoes_do_gain_where_it_is_not(name: str) -> None:
    p = np.array([0.1, 0.2, 0.4, 0.3])
    gained = pool(name, np.stack([p, p]))[2] - p[2]
    # "yes in practice" (theory.md)
    assert abs(gained) < 0.01 if name in ("coalition-0", "coalition-gamma") else gained > 0.01


@each
def test_a_zero_is_a_veto_where_theory_says_so(name: str) -> None:
    opinions = np.array([[0.0, 0.5, 0.3, 0.2], [0.4, 0.1, 0.2, 0.3], [0.4, 0.2, 0.1, 0.3]])
    assert (pool(name, opinions)[0] == 0.0) == (name in VETO)


@few
@given(stacks(("random", "near-zero")))
def test_a_uniform_opinion_says_nothing_to_a_product(opinions: Array) -> None:
    uniform = np.full((1, *opinions.shape[1:]), 1 / opinions[0].size)
    for name in ("logarithmic", "channel-filter"):
        assert pool(name, np.concatenate([opinions, uniform])) == pytest.approx(pool(name, opinions), abs=1e-12)


@few
@given(weighted(("random",)), st.floats(1e-3, 1e3))
def test_only_the_ratio_of_weights_counts(drawn: tuple[Array, Array], scale: float) -> None:
    opinions, weights = drawn
    for name in RELATIVE:
        assert pool(name, opinions, scale * weights) == pytest.approx(pool(name, opinions, weights), abs=1e-9), name


@pytest.mark.parametrize("name", sorted(RELATIVE - {"chernoff", "clique-cooperative"}))
def test_no_weights_means_equal_weights(name: str) -> None:
    opinions = make("random", 4, (3, 4), np.random.default_rng(1))
    assert pool(name, opinions) == pytest.approx(pool(name, opinions, np.full(4, 7.0)), abs=1e-12)


@few
@given(weighted(("random", "near-zero")))
def test_the_product_is_the_product(drawn: tuple[Array, Array]) -> None:
    opinions, weights = drawn
    expected = oracles.product(opinions, weights.tolist())
    assert POOLS["logarithmic"](opinions, weights) == pytest.approx(expected, abs=1e-11)
    mean = oracles.product(opinions, (weights / weights.sum()).tolist())
    assert POOLS["geometric"](opinions, weights) == pytest.approx(mean, abs=1e-11)
    assert POOLS["chernoff"](opinions, weights) == pytest.approx(mean, abs=1e-11)


@few
@given(weighted(("random", "sparse")))
def test_power_means_between_harmonic_and_linear(drawn: tuple[Array, Array]) -> None:
    opinions, weights = drawn
    hoelder = POOLS["hoelder"]
    assert hoelder(opinions, weights, a=1.0) == pytest.approx(POOLS["linear"](opinions, weights), abs=1e-12)
    floored = 0.99 * opinions + 0.01 / opinions[0].size
    assert hoelder(floored, weights, a=1e-7) == pytest.approx(POOLS["geometric"](floored, weights), abs=1e-5)
    assert hoelder(floored, weights, a=0.0) == pytest.approx(POOLS["geometric"](floored, weights), abs=1e-12)
    w = (weights / weights.sum()).reshape(-1, *(1,) * (opinions.ndim - 1))
    harmonic = 1 / (w / floored).sum(axis=0)
    assert POOLS["harmonic"](floored, weights) == pytest.approx(harmonic / harmonic.sum(), abs=1e-12)


@each
def test_a_board_pools_with_entropy_weights_where_the_rule_does(name: str) -> None:
    rule, _ = RULES[name]
    opinions = make("random", 4, SHAPES[1], np.random.default_rng(2))
    grid = Grid(SHAPES[1], 2.0)
    board, weighted_by = {"k": 3.0, "reference_cell": 1.0}, 0.25  # (1 / 2)^2 cells
    pooling = model(name)
    if name == "clique-cooperative":
        assert np.array_equal(fuse(pooling, opinions, grid).p, pool(name, opinions))
    elif isinstance(pooling, EntropyWeighted):
        pooling = read_rule({**pooling.in_force(), **board})
        arguments = {key: value for key, value in pooling.in_force().items() if key not in ("rule", *board)}
        ratio = {} if rule == "linear" else {"cell_ratio": weighted_by}
        weights = entropy_weights(opinions, 3.0, cell_ratio=weighted_by)
        assert np.array_equal(fuse(pooling, opinions, grid).p, POOLS[rule](opinions, weights, **arguments, **ratio))
    else:
        assert np.array_equal(fuse(pooling, opinions, grid).p, pool(name, opinions))


def test_every_rule_of_the_table_is_under_the_laws() -> None:
    assert {rule for rule, _ in RULES.values()} == set(POOLS)
    assert all(name == rule for name, (rule, own) in itertools.islice(RULES.items(), len(POOLS)))


@pytest.mark.parametrize("rule", ["logarithmic", "geometric", "hoelder", "linear"])
def test_an_opinion_of_weight_zero_has_no_veto(rule: str) -> None:
    vetoing, other = np.array([1.0, 0.0, 0.0]), np.array([0.2, 0.3, 0.5])
    assert POOLS[rule](np.stack([vetoing, other]), [0.0, 1.0]) == pytest.approx(other)


def test_huge_and_tiny_weights_are_shares_of_their_sum() -> None:
    stack = np.stack([gaussian(Grid((40, 40), 0.5, (-10.0, -10.0)), (x, 0), 2).p for x in (-1, 2)])
    for scale in (1e-200, 1e200):
        assert POOLS["linear"](stack, [scale, 3 * scale]) == pytest.approx(0.25 * stack[0] + 0.75 * stack[1])
