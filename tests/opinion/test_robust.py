"""The rules that a lying minority cannot capture, and the clique that leaves it out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import POOLS, Grid
from blackboard.opinion.agreement import bhattacharyya_coefficient
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Array
from blackboard.opinion.robust import largest_cliques
from blackboard.opinion.rules import read_rule
from tests import oracles
from tests.opinion.stacks import few, stacks, weighted

GRID = Grid((40, 40))
HONEST = [gaussian(GRID, (14 + i, 20 - i), 3).p for i in range(4)]
LIAR = gaussian(GRID, (30, 25), 1).p


@few
@given(stacks(("random", "near-zero", "identical")))
def test_the_median_of_equals_is_the_median_of_logarithms(opinions: Array) -> None:
    logs = np.median(np.log(opinions), axis=0)
    p = np.exp(logs - logs.max())
    assert POOLS["median-log"](opinions) == pytest.approx(p / p.sum(), abs=1e-12)


@few
@given(stacks(("random",)), st.lists(st.integers(1, 3), min_size=5, max_size=5))
def test_a_weight_of_two_is_saying_it_twice(opinions: Array, counts: list[int]) -> None:
    counts = counts[: len(opinions)]
    repeated = np.repeat(opinions, counts, axis=0)
    assert POOLS["median-log"](opinions, counts) == pytest.approx(POOLS["median-log"](repeated), abs=1e-12)
    assert POOLS["geometric-median"](opinions, counts) == pytest.approx(POOLS["geometric-median"](repeated), abs=1e-9)


@few
@given(weighted(("random", "sparse", "mixed")), st.integers(0, 1000))
def test_no_direction_leads_nearer_to_all_roots(drawn: tuple[Array, Array], seed: int) -> None:
    """The geometric median minimises the weighted sum of distances between roots, before its root is put on the sphere again."""
    opinions, weights = drawn
    roots = np.sqrt(opinions).reshape(len(opinions), -1)

    def total(mix: Array) -> float:
        return float(weights @ np.linalg.norm(mix @ roots - roots, axis=1))

    centre = np.sqrt(POOLS["geometric-median"](opinions, weights)).ravel()
    mix, *_ = np.linalg.lstsq(roots.T, centre, rcond=None)  # proportional to the weights of the roots
    mix = mix / mix.sum()
    rng = np.random.default_rng(seed)
    others = mix + 0.05 * rng.normal(size=(20, len(mix)))
    assert total(mix) <= min(total(other / other.sum()) for other in others) + 1e-6


def test_more_than_half_of_the_weight_is_the_geometric_median() -> None:
    """The iteration alone would crawl there: after s steps (0.495 / 0.505)^s of the way is left."""
    p, q = HONEST[0], LIAR
    assert POOLS["geometric-median"](np.stack([p, q]), [0.505, 0.495]) == pytest.approx(p, abs=1e-15)
    assert POOLS["geometric-median"](np.stack([q, p, q, p, q]), [1, 1, 1, 1, 1]) == pytest.approx(q, abs=1e-15)


@pytest.mark.parametrize("rule", ["median-log", "geometric-median", "clique", "cooperative", "coalition"])
def test_one_liar_of_five_does_not_capture(rule: str) -> None:
    fused = Belief(GRID, POOLS[rule](np.stack([*HONEST, LIAR])))
    assert math.dist(fused.mean(), (15.5, 18.5)) < 2.0


@pytest.mark.parametrize("rule", ["median-log", "geometric-median", "clique"])
def test_nor_do_two_that_collude(rule: str) -> None:
    fused = Belief(GRID, POOLS[rule](np.stack([*HONEST[:3], LIAR, LIAR])))
    assert math.dist(fused.mean(), (15, 19)) < 3.5


@few
@given(st.integers(1, 8), st.integers(0, 2**28 - 1))
def test_the_largest_cliques_are_all_found(n: int, edges: int) -> None:
    """Any graph of agreement: opinions that share a cell with exactly those they agree with."""
    pairs = [(i, j) for i in range(n) for j in range(i)]
    near = np.eye(n, dtype=bool)
    p = np.eye(n, n + len(pairs))
    for bit, (i, j) in enumerate(pairs):
        if edges >> bit & 1:
            near[i, j] = near[j, i] = True
            p[[i, j], n + bit] = 1.0
    p /= p.sum(axis=1, keepdims=True)
    assert largest_cliques(p, 5.0) == oracles.cliques(near)


def test_agreement_ends_at_the_threshold_xi() -> None:
    p, q = gaussian(GRID, (10, 20), 2).p, gaussian(GRID, (18, 20), 2).p
    distance = -math.log(bhattacharyya_coefficient(p, q))
    assert distance == pytest.approx(2.0, abs=1e-3)  # equal widths, 4 sigma apart
    assert largest_cliques(np.stack([p, q]), distance) == [(0, 1)]
    assert largest_cliques(np.stack([p, q]), distance * (1 - 1e-6)) == [(0,), (1,)]


def test_any_rule_can_pool_the_largest_clique() -> None:
    everybody, honest = np.stack([LIAR, *HONEST]), np.stack(HONEST)
    weights = np.array([50.0, 1.0, 2.0, 3.0, 4.0])
    for rule in set(POOLS) - {"clique"}:
        behind = POOLS["clique"](everybody, inner=rule)
        assert behind == pytest.approx(POOLS["clique"](honest, inner=rule), abs=1e-12)
        given = POOLS["clique"](everybody, weights, inner=rule)
        own = {key: value for key, value in read_rule({"rule": rule}).in_force().items() if key not in ("rule", "k")}
        assert given == pytest.approx(POOLS[rule](honest, weights[1:], **own), abs=1e-12)


def test_where_nothing_says_which_clique_is_right_all_are_kept() -> None:
    two_camps = np.stack([HONEST[0], HONEST[1], LIAR, LIAR])
    halves = [POOLS["logarithmic"](two_camps[:2]), POOLS["logarithmic"](two_camps[2:])]
    assert POOLS["clique"](two_camps) == pytest.approx(np.mean(halves, axis=0), abs=1e-12)
    assert POOLS["clique"](np.eye(4)) == pytest.approx([0.25] * 4)


def test_the_channel_filter_takes_out_what_both_knew() -> None:
    """Two robots update one prior with readings of their own: the product counts the prior twice, the filter once."""
    prior = gaussian(GRID, (20, 20), 5).p
    readings = [gaussian(GRID, (18, 21), 4).p, gaussian(GRID, (22, 19), 3).p]
    posteriors = [POOLS["logarithmic"](np.stack([prior, reading])) for reading in readings]
    exact = POOLS["logarithmic"](np.stack([prior, *readings]))
    assert POOLS["channel-filter"](np.stack(posteriors), common=prior[np.newaxis]) == pytest.approx(exact, abs=1e-12)
    assert np.abs(POOLS["logarithmic"](np.stack(posteriors)) - exact).max() > 1e-3


def test_the_channel_filter_revives_no_cell() -> None:
    prior, posteriors = np.array([0.0, 0.5, 0.5]), np.array([[0.0, 0.8, 0.2], [0.0, 0.4, 0.6]])
    assert POOLS["channel-filter"](posteriors, common=[prior]) == pytest.approx([0, 0.32 / 0.44, 0.12 / 0.44])
    assert POOLS["channel-filter"](posteriors + np.array([0.1, -0.1, 0.0]), common=[prior])[0] == 0.0


def test_two_opinions_nearly_alike_have_a_geometric_median_between_them() -> None:
    centred = Grid((40, 40), 0.5, (-10.0, -10.0))
    p, q = (gaussian(centred, (x, 0), 2).p for x in (0.0, 1e-9))
    far = gaussian(centred, (5, 5), 1).p
    pooled = POOLS["geometric-median"](np.stack([p, q, far]))
    assert np.abs(pooled - p).max() < 1e-6
