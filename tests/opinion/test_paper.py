"""The paper's numbers and claims, with the readings of its formulas that this project takes."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given

from blackboard import Grid, cooperative_pool, entropy, entropy_weights, linear_pool, logarithmic_pool
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.components import log_components
from blackboard.opinion.grid import Array
from tests import oracles
from tests.opinion.stacks import few, weighted

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parent.parent / "golden" / "paper.json").read_text(encoding="utf-8")
)
FIGURES: dict[str, Any] = GOLDEN["figures"]


def line(per_unit: int = 1) -> Grid:
    """100 units of a line, cell i centred at i / per_unit."""
    return Grid((100 * per_unit,), 1 / per_unit, (-0.5 / per_unit,))


def sensors(figure: str, grid: Grid) -> Array:
    return np.stack([gaussian(grid, (mean,), sigma).p for mean, sigma in FIGURES[figure]["sensors"]])


@pytest.mark.parametrize("figure", FIGURES)
def test_the_figures_to_the_printed_digits(figure: str) -> None:
    golden, opinions = FIGURES[figure], sensors(figure, line())
    weights = entropy_weights(opinions, 2.0)
    assert f"{min(entropy(p) for p in opinions):.4f}" == golden["best"]
    fused = {
        "linear": linear_pool(opinions, weights),
        "logarithmic": logarithmic_pool(opinions),
        "cooperative": cooperative_pool(opinions, weights, gamma=0.5),
    }
    for rule, p in fused.items():
        assert [f"{entropy(p):.4f}", p.argmax()] == golden[rule], rule
    assert f"{fused['cooperative'][:40].sum():.4f}" == golden["below 40"]


@pytest.mark.parametrize("per_unit", [1, 2, 4, 10])
def test_with_the_reference_cell_the_answer_is_the_same_on_every_grid(per_unit: int) -> None:
    golden, grid = GOLDEN["reference cell"], line(per_unit)
    opinions = sensors(golden["figure"], grid)
    weights = entropy_weights(opinions, 2.0, cell_ratio=per_unit)
    fused = cooperative_pool(opinions, weights, cell_ratio=per_unit)
    below = golden["mass below 40 by cells per unit, v_ref = 1 unit"][str(per_unit)]
    assert fused[grid.centres(0) < 40 - 1e-9].sum() == pytest.approx(below, abs=1e-5)


@pytest.mark.parametrize(("per_unit", "peak"), GOLDEN["without reference cell"]["peak by cells per unit"].items())
def test_as_printed_the_winner_depends_on_the_grid(per_unit: str, peak: int) -> None:
    grid = line(int(per_unit))
    opinions = sensors("Fig. 5", grid)
    fused = cooperative_pool(opinions, entropy_weights(opinions, 2.0))
    assert grid.centres(0)[fused.argmax()] == pytest.approx(peak, abs=0.5)


def test_the_other_readings_of_the_exponent_are_not_sharp() -> None:
    """Why the exponent is 1 / alpha_q: neither alpha C nor C^alpha does what the paper's text says about Fig. 2."""
    golden = GOLDEN["other readings of the exponent"]
    opinions = sensors(golden["figure"], line())
    alpha = np.array([1, 2, 4, 8, 16])[:, np.newaxis] / 31
    logs = log_components(opinions, entropy_weights(opinions, 2.0))
    for reading, p in {
        "alpha C": (alpha * np.exp(logs)).sum(axis=0),
        "C^alpha": np.exp(alpha * logs).sum(axis=0),
    }.items():
        assert f"{entropy(p / p.sum()):.4f}" == golden[reading]
        assert entropy(p / p.sum()) > min(entropy(o) for o in opinions)


def test_agreeing_opinions_fuse_to_less_entropy_than_the_best() -> None:
    """(III-B.1), and Fig. 1's claim: the product of an agreeing pair is sharper than either, of a disagreeing pair it need not be."""
    opinions = sensors("Fig. 2", line())
    best = min(entropy(p) for p in opinions)
    assert entropy(cooperative_pool(opinions, entropy_weights(opinions, 2.0))) <= best  # (III-B.1)
    assert entropy(logarithmic_pool(opinions)) <= best
    disagreeing = 0.9 * np.eye(100)[[25, 70]] + 0.1 / 100  # each nearly sure of another cell
    assert entropy(logarithmic_pool(disagreeing)) > max(entropy(p) for p in disagreeing)


@few
@given(weighted())
def test_mean_and_variance_of_the_linear_pool(drawn: tuple[Array, Array]) -> None:
    opinions, weights = drawn
    w = weights / weights.sum()
    grid = Grid(opinions.shape[1:], cell=0.5, origin=tuple(range(opinions.ndim - 1)))
    parts = [Belief(grid, p) for p in opinions]
    fused = Belief(grid, linear_pool(opinions, weights))
    means = np.array([part.mean() for part in parts])
    m = w @ means
    assert fused.mean() == pytest.approx(m, abs=1e-12)  # (IV-A.2)
    within = sum(wi * part.covariance() for wi, part in zip(w, parts, strict=True))
    disagreement = sum(wi * np.outer(mi - m, mi - m) for wi, mi in zip(w, means, strict=True))
    assert fused.covariance() == pytest.approx(within + disagreement, abs=1e-12)  # (IV-A.3)


def test_weights_are_the_inverse_entropies() -> None:
    opinions = sensors("Fig. 5", line())
    h = np.array([oracles.entropy(p) for p in opinions])
    for k in (0.0, 0.5, 1.0, 2.0):
        assert entropy_weights(opinions, k) == pytest.approx(h**-k / (h**-k).sum(), rel=1e-12)  # (III-A.1)


def test_a_certain_opinion_gets_a_finite_weight() -> None:
    one_cell, vague = np.eye(50)[7], np.full(50, 0.02)
    weights = entropy_weights(np.stack([one_cell, vague]), 2.0)
    bound = 0.5 * math.log(2 * math.pi * math.e / 12)  # a Gaussian as wide as rounding to a cell
    assert weights[0] / weights[1] == pytest.approx((math.log(50) / bound) ** 2)
    assert entropy_weights(np.stack([one_cell, one_cell]), 10.0) == pytest.approx([0.5, 0.5])


def test_the_reference_cell_makes_weights_independent_of_the_grid() -> None:
    """H + ln(v_cell / v_ref) is the same on a grid four times finer, and bounded from below as H is."""
    coarse, fine = sensors("Fig. 5", line()), sensors("Fig. 5", line(4))
    assert entropy_weights(fine, 2.0, cell_ratio=4.0) == pytest.approx(entropy_weights(coarse, 2.0), abs=1e-4)
    assert entropy_weights(coarse, 2.0, cell_ratio=1e6) == pytest.approx([0.2] * 5)
