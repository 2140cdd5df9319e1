"""Scores of many cases and their intervals, which are over runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from blackboard.lab.estimates import COLUMNS, RuleScores, difference, estimates, means, wilson
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import Score


def test_wilsons_interval_is_right_at_its_ends() -> None:
    """10 of 10: 0.7225 to 1; 5 of 10: 0.2366 to 0.7634 (Wilson 1927, as R's prop.test without correction prints them)."""
    assert (wilson(1.0, 10).low, wilson(1.0, 10).high) == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert (wilson(0.5, 10).low, wilson(0.5, 10).high) == pytest.approx((0.2366, 0.7634), abs=1e-4)


def scored(errors: Array, runs: list[int]) -> RuleScores:
    n = len(errors)
    score = Score(errors.tolist(), [1.0] * n, (-errors).tolist(), [0.97 if i % 4 == 0 else 0.3 for i in range(n)])
    return RuleScores(score, runs, [0.001] * n)


def test_estimates_are_the_scores_of_all_cases() -> None:
    errors = np.random.default_rng(1).exponential(2.0, 41)
    found = estimates(scored(errors, [i // 2 for i in range(41)]), np.random.default_rng(2))
    assert set(found) == set(COLUMNS)
    assert found["rmse"].value == pytest.approx(math.sqrt((errors**2).mean()))
    assert found["median"].value == np.median(errors)
    assert found["log_score"].value == pytest.approx(-errors.mean())
    assert found["coverage_95"].value == pytest.approx(1 - 11 / 41)
    assert found["ms"].value == pytest.approx(1.0)
    assert all(e.low <= e.value <= e.high for e in found.values())


def test_intervals_are_over_runs_and_not_over_cases() -> None:
    """Forty copies of each of ten cases know no more than the ten."""
    errors = np.random.default_rng(1).exponential(2.0, 10)
    once = estimates(scored(errors, list(range(10))), np.random.default_rng(2))["rmse"]
    copied = estimates(scored(np.repeat(errors, 40), [i // 40 for i in range(400)]), np.random.default_rng(2))["rmse"]
    assert (copied.low, copied.high) == pytest.approx((once.low, once.high), rel=1e-9)


def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(200):
        (interval,) = means(rng.standard_normal((40, 1)), rng)
        held += interval.low <= 0.0 <= interval.high
    assert 0.88 <= held / 200 <= 0.99


def test_the_difference_of_two_scores_is_paired() -> None:
    errors = np.random.default_rng(1).exponential(5.0, 30)
    gained = difference(
        scored(errors, list(range(30))), scored(errors + 0.1, list(range(30))), np.random.default_rng(1)
    )
    assert (gained.value, gained.low, gained.high) == pytest.approx((0.1, 0.1, 0.1))
