"""What is left out of the Cooperative Opinion Pool on large grids is less than rounding, and what is alike is counted as often as it is."""

import numpy as np
import pytest

from blackboard import Grid
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.components import alphas, log_components
from blackboard.opinion.considered import SMALL, bounds, unlike
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import fuse, fuse_belief
from blackboard.opinion.rules import Rule, read_rule
from blackboard.wire.arrays import pack, unpack
from tests import oracles

GRID = Grid((70, 60))  # above SMALL
RULES = [
    {"rule": "cooperative"},
    {"rule": "cooperative", "gamma": 0.9, "reference_cell": 0.5},
    {"rule": "calibrated"},
    {"rule": "calibrated", "power": 0.05},
    {"rule": "coalition"},
    {"rule": "coalition", "independence": 1.0},
    {"rule": "coalition", "gate": 30.0, "independence": 0.0},
    {"rule": "coalition", "gamma": 0.5},
]


def stack(kind: str, n: int) -> Array:
    rng = np.random.default_rng(n)
    around = rng.normal(30, 3, (n, 2)) if kind in ("near", "sent") else rng.uniform(5, 55, (n, 2))
    beliefs = [gaussian(GRID, tuple(c), s) for c, s in zip(around, rng.uniform(1, 2.5, n), strict=True)]
    if kind in ("sent", "sent apart"):
        beliefs = [unpack(pack(belief)) for belief in beliefs]
    p = np.stack([belief.p for belief in beliefs])
    if kind == "dense":
        p = rng.random(p.shape)
    if kind == "flat but one":
        p[1:] = 1.0
    if kind == "sparse":
        p = rng.random(p.shape) * (rng.random(p.shape) < 0.1)
    return np.asarray(p / p.sum(axis=(1, 2), keepdims=True))


KINDS = ("near", "apart", "sent", "sent apart", "dense", "flat but one", "sparse")


def whole(rule: Rule, opinions: Array, monkeypatch: pytest.MonkeyPatch) -> tuple[Array, ...]:
    """Pooled with every cell and every component."""
    with monkeypatch.context() as patch:
        patch.setattr("blackboard.opinion.considered.SMALL", 10**9)
        pooled = fuse(rule, opinions, GRID)
        return pooled.p, pooled.weights, pooled.components, pooled.claim()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_leaving_out_what_cannot_matter_changes_nothing(kind: str, n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert GRID.size > SMALL
    opinions = stack(kind, n)
    for table in RULES:
        rule = read_rule(table)
        p, weights, components, claim = whole(rule, opinions, monkeypatch)
        pooled = fuse(rule, opinions, GRID)
        assert np.abs(pooled.p - p).max() <= 1e-13 * p.max(), table
        assert np.abs(pooled.claim() - claim).max() <= 1e-13 * claim.max(), table
        assert pooled.components == pytest.approx(components, abs=1e-13), table
        assert pooled.weights == pytest.approx(weights, abs=1e-9), table
        assert np.array_equal(fuse_belief(rule, opinions, GRID), pooled.p), table


@pytest.mark.parametrize("n", [2, 3, 6, 11])
@pytest.mark.parametrize("decades", [0, 10, 100, 300])
def test_the_last_components_alone_are_those_of_the_whole_recursion(n: int, decades: int) -> None:
    rng = np.random.default_rng(n + decades)
    p = 10.0 ** (-decades * rng.random((n, 500))) * rng.random((n, 500))
    p[rng.random(p.shape) < 0.1] = 0.0
    weights = rng.random(n) + 0.01
    every = log_components(p, weights)
    for first in range(1, n + 1):
        components = log_components(p, weights, first=first)
        assert np.array_equal(np.isneginf(components), np.isneginf(every[first - 1 :]))
        np.testing.assert_allclose(
            np.exp(components - np.where(np.isneginf(components), 0.0, every[first - 1 :])),
            np.isfinite(components),
            rtol=1e-11,
        )


def test_the_belief_is_the_sum_over_all_subsets_on_a_large_grid() -> None:
    opinions = stack("sent", 4)
    slow, shares = oracles.cooperative(oracles.cooperative_terms(opinions, [1.0] * 4, alphas(4).tolist()))
    pooled = read_rule({"rule": "cooperative"}).pool(opinions)
    assert np.abs(pooled.p.ravel() - slow).max() <= 1e-12
    assert pooled.components == pytest.approx(shares, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_no_component_is_above_its_bound_and_few_cells_are_left_where_all_agree(kind: str) -> None:
    p = stack(kind, 6).reshape(6, -1)
    bound = bounds(p, None, alphas(6))
    with np.errstate(divide="ignore"):
        most = bound.subsets[:, np.newaxis] + np.arange(1, 7)[:, np.newaxis] * np.log(bound.top)
    logs = log_components(p, None)
    assert (logs <= most + 1e-9).all()
    assert (bound.reached <= logs.max(axis=1) + 1e-9).all()
    chosen = bound.top >= bound.heavy()
    assert chosen.any()
    if kind in ("near", "sent"):
        assert np.count_nonzero(chosen) < 0.3 * GRID.size
    cells = unlike(p)
    top = cells.of(bound.top[np.newaxis])[0]
    for some in (cells, cells.only(np.flatnonzero(top >= 0)), cells.only(np.flatnonzero(top < bound.heavy()))):
        values = some.of(p)[2]
        where = np.arange(GRID.size) if some.where is None else some.where
        there = np.isin(np.arange(GRID.size), np.append(where, some.others))
        assert np.array_equal(some.spread(values), np.where(there, p[2], 0.0))
        assert some.counted(values[np.newaxis]).sum() == pytest.approx(p[2][there].sum())
        if values.any():
            assert some.normalised(values) * p[2][there].sum() == pytest.approx(values)
    assert (len(cells.others) > 0.4 * GRID.size) == (kind in ("sent", "sent apart", "sparse"))


def test_a_board_gets_the_linear_pool_after_a_veto_also_without_the_story() -> None:
    apart = np.eye(4)[:2]
    rule, grid = read_rule({"rule": "logarithmic"}), Grid((4,))
    assert np.array_equal(fuse_belief(rule, apart, grid), fuse(rule, apart, grid).p)
    assert Belief(grid, fuse_belief(rule, apart, grid)).p[:2] == pytest.approx([0.5, 0.5])
