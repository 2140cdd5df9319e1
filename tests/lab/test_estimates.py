"""Scores of many cases and their intervals, which are over runs."""

import math

import numpy as np
import pytest

from blackboard.judge.intervals import Estimate, means, wilson
from blackboard.lab.estimates import COLUMNS, RuleScores, difference, estimates
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import Score
from tests.present import present


def scored(errors: Array, runs: list[int]) -> RuleScores:
    n = len(errors)
    score = Score(
        errors.tolist(), [1.0] * n, (-errors).tolist(), [0.97 if i % 4 == 0 else 0.3 for i in range(n)], [0.01] * n
    )
    return RuleScores(score, runs, [0.001] * n)


def test_estimates_are_the_scores_of_all_cases() -> None:
    errors = np.random.default_rng(1).exponential(2.0, 41)
    shown = estimates(scored(errors, [i // 2 for i in range(41)]), np.random.default_rng(2))
    assert set(shown) == set(COLUMNS)
    assert shown["rmse"].value == pytest.approx(math.sqrt((errors**2).mean()))
    assert shown["median"].value == np.median(errors)
    assert shown["log_score"].value == pytest.approx(-errors.mean())
    assert shown["coverage_95"].value == pytest.approx(1 - 11 / 41)
    assert shown["ms"].value == pytest.approx(1.0)
    assert all(held(e, e.value) for e in shown.values())


def test_intervals_are_over_runs_and_not_over_cases() -> None:
    """Forty copies of each of ten cases know no more than the ten."""
    errors = np.random.default_rng(1).exponential(2.0, 10)
    once = estimates(scored(errors, list(range(10))), np.random.default_rng(2))["rmse"]
    copied = estimates(scored(np.repeat(errors, 40), [i // 40 for i in range(400)]), np.random.default_rng(2))["rmse"]
    assert (copied.low, copied.high) == pytest.approx((once.low, once.high), rel=1e-9)


def held(interval: Estimate, truth: float) -> bool:
    return present(interval.low) <= truth <= present(interval.high)


@pytest.mark.parametrize("runs", [4, 10])
def test_so_do_those_of_what_is_not_a_mean(runs: int) -> None:
    """RMSE, median and log score of runs of unequal length that differ, as seeds do: 100 times, 88 to 99 %."""
    rng = np.random.default_rng(7)
    truths = {"rmse": 2.0 * math.sqrt(1 + 0.3**2), "log_score": -2.0 * math.sqrt(2 / math.pi)}
    counts = dict.fromkeys(truths, 0)
    for _ in range(100):
        levels = 1 + 0.3 * rng.choice((-1.0, 1.0), runs)
        lengths = rng.integers(10, 20, runs)
        of_case = np.repeat(np.arange(runs), lengths)
        shown = estimates(
            scored(2.0 * levels[of_case] * np.abs(rng.standard_normal(len(of_case))), of_case.tolist()), rng
        )
        for name, truth in truths.items():
            counts[name] += held(shown[name], truth)
    assert all(0.88 <= count / 100 <= 0.99 for count in counts.values()), counts


def test_fewer_than_four_runs_give_no_interval() -> None:
    errors = np.random.default_rng(1).exponential(2.0, 30)
    first, second = (scored(errors + away, [i % 3 for i in range(30)]) for away in (0.0, 0.1))
    intervals = [
        *estimates(first, np.random.default_rng(2)).values(),
        difference(first, second, np.random.default_rng(2)),
    ]
    intervals += means(errors.reshape(3, 10), np.random.default_rng(2))
    assert all(e.low is None and e.high is None and not e.is_above(0.0) for e in intervals)


@pytest.mark.parametrize("runs", [5, 30])
def test_a_share_of_all_cases_is_not_certain(runs: int) -> None:
    """Each of some runs covers all of its cases: how runs differ is not known, so a run counts as one case of Wilson's."""
    scores = scored(np.ones(runs * 10), [i // 10 for i in range(runs * 10)])
    scores.score.levels = [0.3] * len(scores.runs)
    coverage = estimates(scores, np.random.default_rng(1))["coverage_95"]
    assert (coverage.value, coverage.low, coverage.high) == (1.0, wilson(1.0, runs).low, 1.0)


def test_the_difference_of_two_scores_is_paired() -> None:
    errors = np.random.default_rng(1).exponential(5.0, 30)
    gained = difference(
        scored(errors, list(range(30))), scored(errors + 0.1, list(range(30))), np.random.default_rng(1)
    )
    assert (gained.value, gained.low, gained.high) == pytest.approx((0.1, 0.1, 0.1))
