"""Intervals: by the books, against slow versions, and whether they hold the truth as often as they say."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.judge.intervals import (
    MAX_AUTOCORRELATION,
    Estimate,
    Z,
    effective_samples,
    mean_of_blocks,
    means,
    share_of_blocks,
    shown,
    student,
    wilson,
)
from tests.present import present


def holds(interval: Estimate, truth: float) -> bool:
    return present(interval.low) <= truth <= present(interval.high)


# --- by the books ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "n", "low", "high"),
    [
        (1.0, 10, 0.7225, 1.0),  # Wilson 1927, as R's prop.test without correction prints them
        (0.5, 10, 0.2366, 0.7634),
        (0.5, 20, 0.2993, 0.7007),  # Newcombe, Statistics in Medicine 17 (1998), method 3
    ],
)
def test_wilsons_interval_by_the_book(share: float, n: int, low: float, high: float) -> None:
    assert asdict(wilson(share, n)) == pytest.approx({"value": share, "low": low, "high": high}, abs=1e-4)


@given(st.integers(0, 40), st.integers(1, 40))
def test_wilsons_interval_ends_where_the_share_is_z_deviations_away(hits: int, n: int) -> None:
    share = min(hits, n) / n
    interval = wilson(share, n)
    assert interval.within(0.0, 1.0) == interval
    assert holds(Estimate(share, interval.low and interval.low - 1e-12, interval.high and interval.high + 1e-12), share)
    for end in (interval.low, interval.high):
        if end is not None and 1e-9 < end < 1 - 1e-9:  # (share - p)^2 = Z^2 p (1 - p) / n, the interval's definition
            assert (share - end) ** 2 == pytest.approx(Z**2 * end * (1 - end) / n, abs=1e-12)


def test_students_t_is_that_of_the_tables() -> None:
    """Two-sided 95 % for 3, 4, 7, 19 and 38 degrees of freedom (Abramowitz and Stegun 1964, table 26.10)."""
    assert [student(n) for n in (3, 4, 7, 19, 38)] == pytest.approx([3.182, 2.776, 2.365, 2.093, 2.024], rel=0.01)


def test_an_interval_is_above_or_below_a_limit_as_a_whole_or_not_at_all() -> None:
    estimate = Estimate(0.5, 0.4, 0.6)
    assert [(estimate.is_above(limit), estimate.is_below(limit)) for limit in (0.3, 0.4, 0.5, 0.6, 0.7)] == [
        (True, False), (False, False), (False, False), (False, False), (False, True),
    ]  # fmt: skip
    assert not Estimate(0.5).is_above(0.0)
    assert not Estimate(0.5).is_below(1.0)


def test_an_estimate_is_shown_with_its_interval() -> None:
    estimate = asdict(Estimate(0.51239, -0.4, 0.6))
    assert (shown(estimate), shown(estimate, 1, sign="+")) == ("0.512 [-0.400, 0.600]", "+0.5 [-0.4, +0.6]")
    assert shown(asdict(Estimate(0.5)), without=" [-]") == "0.500 [-]"
    assert shown({"value": None, "low": None, "high": None}) == "-"


# --- over blocks -----------------------------------------------------------------------------------------------------


def in_blocks(hits: Sequence[float], blocks: Sequence[int]) -> tuple[list[float], list[float]]:
    """The sum of hits, and the number of samples, of each block in order."""
    names = sorted(set(blocks))
    of = {name: [float(hit) for hit, block in zip(hits, blocks, strict=True) if block == name] for name in names}
    return [sum(of[name]) for name in names], [float(len(of[name])) for name in names]


def slow_effective_samples(hits: Sequence[bool], blocks: Sequence[int]) -> float:
    sums, counts = in_blocks(hits, blocks)
    n = len(hits)
    share = sum(hits) / n
    if len(counts) == 1 or share in (0, 1):
        return len(counts)
    away = [of_block - share * count for of_block, count in zip(sums, counts, strict=True)]
    alike = slow_autocorrelation(away)
    total = sum(off**2 for off in away) * (1 + alike) / (1 - alike)
    variance = len(counts) / (len(counts) - 1) * total / n**2
    return min(n, share * (1 - share) / variance) if variance > 1e-30 else n


def slow_autocorrelation(away: Sequence[float]) -> float:
    correlation = sum(a * b for a, b in itertools.pairwise(away)) / (sum(a * a for a in away) or 1.0)
    return min(MAX_AUTOCORRELATION, max(0.0, correlation))


BLOCKS = st.lists(st.tuples(st.booleans(), st.integers(0, 5)), min_size=1, max_size=60)


@given(BLOCKS)
def test_effective_samples_are_the_slow_ones(pairs: list[tuple[bool, int]]) -> None:
    hits, blocks = zip(*pairs, strict=True)
    assert effective_samples(*in_blocks(hits, blocks)) == pytest.approx(slow_effective_samples(hits, blocks))


@given(st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=2, max_size=12))
def test_equal_blocks_that_are_not_alike_count_for_one_each_at_least_and_for_their_samples_at_most(
    parts: list[list[bool]],
) -> None:
    hits = [sum(part) for part in parts]
    samples = effective_samples(hits, [4.0] * len(parts))
    alike = slow_autocorrelation([of_part - sum(hits) / len(parts) for of_part in hits])
    assert (len(parts) - 1) * (1 - alike) / (1 + alike) - 1e-9 <= samples <= 4 * len(parts)


@given(BLOCKS, st.integers(2, 5))
def test_more_of_the_same_within_a_block_is_no_information(pairs: list[tuple[bool, int]], times: int) -> None:
    hits, blocks = zip(*pairs, strict=True)
    samples = effective_samples(*in_blocks(hits * times, blocks * times))
    assert min(samples, len(hits)) == pytest.approx(effective_samples(*in_blocks(hits, blocks)))


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.7])
def test_an_interval_holds_the_share_also_where_neighbouring_blocks_are_correlated(correlation: float) -> None:
    """As where the error of an object that hardly moves lasts longer than a block; taken as independent, 0.7 held it in 58 %."""
    rng, held, blocks, runs = np.random.default_rng(7), 0, 44, 400
    for _ in range(runs):
        course = [rng.normal()]
        for _ in range(blocks - 1):
            course.append(correlation * course[-1] + math.sqrt(1 - correlation**2) * rng.normal())
        hits = 50.0 * np.clip(0.5 + 0.15 * np.array(course), 0, 1)
        held += holds(share_of_blocks(hits, np.full(blocks, 50.0), student(blocks - 1)), 0.5)
    assert held / runs >= 0.85


def test_the_mean_of_equal_blocks_has_the_interval_of_batch_means() -> None:
    batches = np.random.default_rng(1).normal(0.5, 0.1, 10)
    half = 2.262 * batches.std(ddof=1) / math.sqrt(10)  # Student's t of 9 degrees of freedom
    estimate = mean_of_blocks(7 * batches, np.full(10, 7))
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx(
        (batches.mean(), batches.mean() - half, batches.mean() + half), rel=1e-4
    )


def test_the_mean_of_blocks_of_unequal_length_is_held_as_often_as_it_says() -> None:
    """1000 runs of 10 blocks, each with a level of its own: the nominal 95 % are 91 to 97 %."""
    rng, held = np.random.default_rng(3), 0
    for _ in range(1000):
        n = rng.integers(5, 15, 10)
        held += holds(mean_of_blocks(n * rng.normal(1.0, 0.3, 10) + np.sqrt(n) * rng.normal(0.0, 0.2, 10), n), 1.0)
    assert 910 <= held <= 970


# --- over runs -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("runs", [4, 5, 8, 12, 20, 39, 40])
def test_intervals_hold_the_truth_about_as_often_as_they_say(runs: int) -> None:
    """1000 times so many runs, each with a level of its own: the nominal 95 % are 92 to 97 %, also over few runs."""
    rng = np.random.default_rng(5)
    estimates = means(rng.standard_normal((runs, 1000)), rng)
    assert 0.92 <= np.mean([holds(interval, 0.0) for interval in estimates]) <= 0.97


def test_an_interval_over_runs_ends_where_its_number_must() -> None:
    estimate = means(np.array([[0.0], [1.0], [1.0], [1.0]]), np.random.default_rng(1), 0.0, 1.0)[0]
    assert (estimate.value, estimate.high) == (0.75, 1.0)
    assert holds(estimate, 0.75)
