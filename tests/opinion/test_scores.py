"""Scores: by hand, against the slow version, and honest about honest beliefs."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import Grid, entropy
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import (
    LEAST_PROBABILITY,
    LEVELS,
    Score,
    border_mass,
    errors,
    hdr_level,
    held,
    log_score,
    region_area,
)
from tests import oracles
from tests.opinion.stacks import stacks

GRID = Grid((4, 2), 0.5, (10.0, 20.0), "m")
P = np.array([[0.1, 0.2], [0.3, 0.05], [0.05, 0.1], [0.15, 0.05]])


@given(stacks(("random", "sparse"), most=1), st.sampled_from(LEVELS))
def test_a_cell_is_in_a_region_when_its_level_is_below(opinions: Array, level: int) -> None:
    p = opinions[0]
    inside = set(oracles.densest_region(p, level / 100))
    for cell in range(p.size):
        index = tuple(int(i) for i in np.unravel_index(cell, p.shape))
        assert (hdr_level(p, index) < level / 100) == (cell in inside)


@given(stacks(("random", "sparse"), most=1), st.floats(0.0, 1.0))
def test_a_region_holds_a_truth_drawn_from_the_belief_as_often_as_it_claims(opinions: Array, share: float) -> None:
    p = opinions[0]
    cells = [tuple(int(i) for i in np.unravel_index(cell, p.shape)) for cell in range(p.size)]
    parts = held([hdr_level(p, c) for c in cells], [border_mass(p, c) for c in cells], share)
    assert ((parts >= 0) & (parts <= 1)).all()
    assert float(parts @ p.ravel()) == pytest.approx(share, abs=1e-9)


def test_a_belief_of_one_cell_claims_half_of_it_in_its_50_percent_region() -> None:
    assert held([0.0], [1.0], 0.5).tolist() == [0.5]
    assert held([1.0, 0.4], [0.0, 0.0], 0.5).tolist() == [0.0, 1.0]  # a cell that was ruled out has no mass to divide


@given(stacks(("random", "sparse"), most=1), st.sampled_from(LEVELS))
def test_the_area_is_that_of_the_cells_in_the_region(opinions: Array, level: int) -> None:
    belief = Belief(Grid(opinions[0].shape, 0.5), opinions[0])
    areas = [len(set(oracles.densest_region(belief.p, level / 100 + by))) * belief.grid.volume for by in (-1e-9, 1e-9)]
    assert areas[0] <= region_area(belief, level / 100) <= areas[1]  # but for rounding these are one


def test_log_score_has_a_floor() -> None:
    assert log_score(P, (1, 0)) == pytest.approx(math.log(0.3))
    assert log_score(np.array([1.0, 0.0]), (1,)) == math.log(LEAST_PROBABILITY) == pytest.approx(-27.6, abs=0.04)


def test_errors_by_hand() -> None:
    scored = errors([0.0, 1.0, 2.0, 3.0, 4.0])
    assert scored == {"rmse": pytest.approx(math.sqrt(6)), "mean": 2.0, "p95": pytest.approx(3.8), "max": 4.0}


def test_the_summary_is_the_scorecards_block() -> None:
    score, belief = Score(), Belief(GRID, P)
    for truth in ((10.6, 20.1), (10.1, 20.9), (11.9, 20.9), (99.0, 0.0)):  # levels 0, 0.3, 0.85 and outside the grid
        score.add(belief, truth)
    distances = [math.dist(belief.mean(), truth) for truth in ((10.6, 20.1), (10.1, 20.9), (11.9, 20.9), (99.0, 0.0))]
    logs = [math.log(0.3), math.log(0.2), math.log(0.05), math.log(LEAST_PROBABILITY)]
    summary = score.summary()
    assert list(summary) == ["n", "rmse", "mean", "p95", "max", "entropy", "log_score", "coverage"]
    assert summary == {
        "n": 4,
        **errors(distances),
        "entropy": pytest.approx(entropy(P)),
        "log_score": pytest.approx(np.mean(logs)),
        "coverage": {"50": 0.5, "90": pytest.approx(7 / 12), "95": pytest.approx(8 / 12)},  # 0.05 and 0.1 of 0.15
    }
    json.dumps(summary, allow_nan=False)


def test_an_empty_score_says_so() -> None:
    summary = Score().summary()
    assert summary["n"] == 0
    assert summary["rmse"] is None
    assert summary["coverage"] == {"50": None, "90": None, "95": None}


def test_scores_can_be_merged() -> None:
    first, second, both = Score(), Score(), Score()
    for i, truth in enumerate([(10.1, 20.1), (11.2, 20.3), (11.7, 20.6)]):
        (first if i else second).add(Belief(GRID, P), truth)
        both.add(Belief(GRID, P), truth)
    assert second.merge(first).summary() == both.summary()
    assert (len(first.errors), len(second.errors)) == (2, 1)


def test_an_honest_belief_is_covered_as_often_as_it_claims() -> None:
    grid, rng = Grid((30, 30)), np.random.default_rng(6)
    score, squares = Score(), []
    for _ in range(400):
        truth = rng.uniform(10, 20, 2)
        belief = gaussian(grid, truth + rng.normal(0, 1.5, 2), 1.5)
        score.add(belief, tuple(truth))
        away = truth - belief.mean()
        covariance = belief.covariance() + np.eye(2) / 12  # with the width of a cell
        squares.append(away @ np.linalg.solve(covariance, away) / 2)
    coverage = score.summary()["coverage"]
    for level in LEVELS:
        assert coverage[str(level)] == pytest.approx(level / 100, abs=3 * math.sqrt(0.25 / 400))
    assert np.mean(squares) == pytest.approx(1.0, abs=3 / math.sqrt(400))
    assert score.summary()["log_score"] == pytest.approx(-score.summary()["entropy"], abs=3 / math.sqrt(400))
