"""Running sums give the same numbers as the entries themselves."""

import numpy as np
import pytest

from blackboard.judge.distances import KEPT, Distances
from blackboard.judge.tally import Tally
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score, errors
from tests.holdings import holdings

GRID = Grid((8, 8))


def scores(n: int) -> list[Score]:
    """Scores of one entry each, of beliefs and truths at random."""
    rng, entries = np.random.default_rng(n), []
    for _ in range(n):
        p = rng.random(GRID.shape)
        score = Score()
        score.add(Belief(GRID, p / p.sum()), tuple(rng.uniform(0, 8, 2)))
        entries.append(score)
    return entries


def tally(entries: list[Score]) -> Tally:
    whole = Tally()
    for entry in entries:
        whole.add(entry)
    return whole


def test_a_tally_says_what_all_its_entries_say() -> None:
    ones, twos = scores(40), scores(3)
    merged = Tally.merged([tally(ones), tally(twos)]).summary()
    kept = Score()
    for entry in [*ones, *twos]:
        kept = kept.merge(entry)
    asked = kept.summary()
    assert merged["coverage"] == pytest.approx(asked["coverage"], rel=1e-13)
    for name in ("n", "rmse", "mean", "p95", "max"):
        assert merged[name] == asked[name]
    for name in ("entropy", "log_score"):
        assert merged[name] == pytest.approx(asked[name], rel=1e-13)


def test_of_nothing_there_are_no_numbers() -> None:
    assert Tally.merged([]).summary() == Score().summary()


def test_many_entries_take_no_more_room_and_their_quantile_is_off_by_a_thousandth_at_most() -> None:
    rng = np.random.default_rng(7)
    distances, bins = rng.gamma(2.0, 1.5, 3 * KEPT), Distances()
    for distance in distances[:KEPT]:
        bins.add(distance)
    assert bins.summary() == errors(distances[:KEPT])
    for distance in distances[KEPT : 2 * KEPT]:
        bins.add(distance)
    half = holdings(bins, "it")
    for distance in distances[2 * KEPT :]:
        bins.add(distance)
    assert holdings(bins, "it") == half
    assert len(bins) == 3 * KEPT
    summary, asked = bins.summary(), errors(distances)
    assert summary["p95"] == pytest.approx(asked["p95"], rel=0.0011)
    assert summary["max"] == asked["max"]
    assert {name: summary[name] for name in ("rmse", "mean")} == pytest.approx(
        {name: asked[name] for name in ("rmse", "mean")}, rel=1e-12
    )


@pytest.mark.parametrize("sizes", [(10, KEPT), (KEPT, 10), (KEPT + 5, 10), (10, KEPT + 5), (2 * KEPT, 2 * KEPT)])
def test_what_is_kept_and_what_is_counted_are_taken_together(sizes: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    parts = [rng.gamma(2.0, 1.5, size) for size in sizes]
    whole = Distances()
    for part in parts:
        bins = Distances()
        for distance in part:
            bins.add(distance)
        whole.add_all(bins)
    assert len(whole) == sum(sizes)
    assert whole.summary() == pytest.approx(errors(np.concatenate(parts)), rel=0.0011)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 1e9])
def test_distances_beyond_the_bins_are_counted_too(distance: float) -> None:
    bins = Distances()
    for _ in range(KEPT + 1):
        bins.add(distance)
    assert bins.summary()["mean"] == pytest.approx(distance)
    assert bins.summary()["p95"] <= max(distance, 1.1e4)
