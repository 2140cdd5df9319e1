"""The exact recursion against the sum over all subsets, its special cases, and its size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import POOLS, Grid, OpinionError, cooperative_pool, linear_pool, logarithmic_pool
from blackboard.opinion.belief import gaussian
from blackboard.opinion.components import alphas, log_components
from blackboard.opinion.cooperative import Coalition, Cooperative
from blackboard.opinion.grid import Array
from tests import oracles
from tests.opinion.stacks import KINDS, few, make, weighted


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 10])
def test_it_is_the_sum_over_all_subsets(kind: str, n: int) -> None:
    rng = np.random.default_rng(n)
    opinions, weights = make(kind, n, (5,), rng), rng.random(n)
    terms = oracles.cooperative_terms(opinions, weights.tolist(), alphas(n).tolist())
    pool, shares = oracles.cooperative(terms)
    assert np.abs(cooperative_pool(opinions, weights) - pool).max() <= 1e-12
    assert np.abs(Cooperative().pool(opinions, weights).components - shares).max() <= 1e-12


@few
@given(weighted(most=4), st.floats(0.05, 1.0), st.floats(0.05, 2.0))
def test_it_is_the_sum_over_all_subsets_with_any_parameters(
    drawn: tuple[Array, Array], gamma: float, cell_ratio: float
) -> None:
    opinions, weights = drawn
    alpha = alphas(len(opinions), gamma)
    terms = oracles.cooperative_terms(opinions, weights.tolist(), alpha.tolist(), cell_ratio)
    pool, shares = oracles.cooperative(terms)
    rounding = max(1e-12, 1e-15 * 700 / alpha[0])  # |ln C_1| / alpha_1 times the precision
    assert (
        np.abs(cooperative_pool(opinions, weights, gamma=gamma, cell_ratio=cell_ratio).ravel() - pool).max() <= rounding
    )
    components = Cooperative(gamma=gamma).pool(opinions, weights, cell_ratio=cell_ratio).components
    assert np.abs(components - shares).max() <= rounding


def test_products_far_below_the_smallest_float_still_decide() -> None:
    """Ten opinions, two cells each, 1e-40 elsewhere: C_10 is 1e-352 everywhere, and wins, for C_1^1023 is far less."""
    rng = np.random.default_rng(11)
    opinions = 1e-40 * rng.random((10, 20))
    for i, opinion in enumerate(opinions):
        opinion[2 * i : 2 * i + 2] = 0.4 + 0.2 * rng.random(2)
    opinions /= opinions.sum(axis=1, keepdims=True)
    pool, shares = oracles.cooperative(oracles.cooperative_terms(opinions, [1.0] * 10, alphas(10).tolist()))
    assert shares[-1] > 0.99
    assert np.abs(cooperative_pool(opinions) - pool).max() <= 1e-12
    assert np.abs(Cooperative().pool(opinions).components - shares).max() <= 1e-12


def test_alphas_rise_by_the_same_ratio_and_sum_to_one() -> None:
    for n in (1, 2, 7, 30, 64):
        for gamma in (0.3, 0.5, 1.0):
            alpha = alphas(n, gamma)
            assert alpha.sum() == pytest.approx(1.0, abs=1e-12)
            assert alpha[:-1] == pytest.approx(gamma * alpha[1:])  # (V-C)
    assert 1 / alphas(30)[0] == pytest.approx(2**30 - 1)
    assert np.isfinite(1 / alphas(64, 1e-9)).all()


@few
@given(weighted(("random", "sparse", "mixed")))
def test_alpha_1_alone_is_the_linear_pool(drawn: tuple[Array, Array]) -> None:
    opinions, weights = drawn
    first = log_components(opinions, weights)[0]
    assert np.exp(first) == pytest.approx(linear_pool(opinions, weights).ravel(), abs=1e-14)


@few
@given(weighted(("random", "identical")))
def test_alpha_n_alone_is_the_product(drawn: tuple[Array, Array]) -> None:
    """The smaller gamma, the nearer alpha_N is to 1 and the others to 0: then C_N is all that is left."""
    opinions, weights = drawn
    product = logarithmic_pool(opinions)
    last = np.exp(log_components(opinions, weights)[-1])
    assert last / last.sum() == pytest.approx(product.ravel(), abs=1e-12)
    assert cooperative_pool(opinions, weights, gamma=1e-4) == pytest.approx(product, abs=0.01)


def test_agreement_and_conflict_show_in_the_components() -> None:
    rng = np.random.default_rng(3)
    alike = make("random", 1, (20,), rng)[0]
    assert Cooperative().pool(np.stack([alike] * 4)).components.argmax() == 3
    apart = np.eye(20)[:4]
    assert Cooperative().pool(apart).components == pytest.approx([1, 0, 0, 0])
    line = Grid((80,))
    three_of_four = np.stack([gaussian(line, (mean,), 4).p for mean in (24, 25, 26, 60)])
    assert Cooperative().pool(three_of_four).components.argmax() == 2
    assert cooperative_pool(three_of_four)[:40].sum() > 0.99


def test_thirty_opinions_on_200_by_200_cells() -> None:
    rng = np.random.default_rng(4)
    x, y = np.mgrid[:200, :200]
    centres, widths = rng.uniform(20, 180, (30, 2)), rng.uniform(1, 20, 30)
    raw = np.stack(
        [np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * s * s)) for (a, b), s in zip(centres, widths, strict=True)]
    )
    opinions = raw / raw.sum(axis=(1, 2), keepdims=True)
    fused = cooperative_pool(opinions, rng.random(30))
    assert np.isfinite(fused).all()
    assert fused.min() >= 0
    assert fused.sum() == pytest.approx(1.0, abs=1e-12)


@few
@given(weighted(("random", "sparse", "identical", "mixed")))
def test_calibrated_is_cop_to_a_power(drawn: tuple[Array, Array]) -> None:
    (opinions, weights), calibrated = drawn, POOLS["calibrated"]
    cop = cooperative_pool(opinions, weights)
    assert calibrated(opinions, weights, power=1.0) == pytest.approx(cop, abs=1e-12)
    powered = cop**0.8
    assert calibrated(opinions, weights, power=0.8) == pytest.approx(powered / powered.sum(), abs=1e-9)
    default = calibrated(opinions, weights, power=float(alphas(len(opinions))[-1]))
    assert np.array_equal(calibrated(opinions, weights), default)


@pytest.mark.parametrize("n", [2, 3, 5, 8])
@pytest.mark.parametrize("gate", [3.0, 10.0, 30.0])
@pytest.mark.parametrize("peak", [0.5, 0.01])
def test_the_gate_leaves_out_who_disagrees_by_more_than_it_says(n: int, gate: float, peak: float) -> None:
    """All but one are sure of cell 0. The odd one has its peak beside it and cell 0 `below` nats lower; how sharp it is does
    not count. Weights and the number of subsets blur the border: that is the slack.
    """
    slack = 2 * np.log(2 * n)
    for below in (gate - slack, gate + slack):
        if below > 0:
            opinions = np.zeros((n, 2002))
            opinions[:, 0] = 1.0
            opinions[-1, :2] = peak * np.exp(-below), peak
            opinions[-1, 2:] = (1 - opinions[-1, :2].sum()) / 2000
            *_, without, all_of_them = Coalition(gate=gate).pool(opinions).components
            assert (all_of_them > without) == (below < gate)


@pytest.mark.parametrize("independence", [0.0, 0.3, 1.0])
def test_coalition_mixes_the_components_by_their_mass_in_cop(independence: float) -> None:
    rng = np.random.default_rng(5)
    opinions, weights = make("random", 4, (3, 4), rng), rng.random(4)
    masses = Cooperative().pool(opinions, weights).components
    components = np.exp(log_components(opinions, weights))
    expected = np.zeros(12)
    for q, (mass, component) in enumerate(zip(masses, components, strict=True), start=1):
        part = component ** (1.0 / q) if independence == 0 else component ** (q ** -(1 - independence))
        expected += mass * part / part.sum()
    mixed = POOLS["coalition"](opinions, weights, gamma=0.5, independence=independence)
    assert mixed.ravel() == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("rule", "parameter", "value"),
    [
        ("coalition", "gate", 0.0),
        ("coalition", "gate", float("nan")),
        ("coalition", "independence", 1.5),
        ("coalition", "independence", float("nan")),
        ("calibrated", "power", 0.0),
        ("calibrated", "power", float("inf")),
        *(("cooperative", "gamma", gamma) for gamma in (0.0, -0.5, 1.5, float("nan"))),
        ("cooperative", "cell_ratio", -1.0),
        ("cooperative", "cell_ratio", float("nan")),
    ],
)
def test_parameters_out_of_bounds_are_named(rule: str, parameter: str, value: float) -> None:
    with pytest.raises(OpinionError, match=f"{parameter} {value}: give"):
        POOLS[rule](np.full((2, 3), 1 / 3), **{parameter: value})
