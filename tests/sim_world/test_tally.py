"""Running sums give the same numbers as the entries themselves."""

from __future__ import annotations

import numpy as np
import pytest

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.opinion.scores import Score
from sim_world.tally import Tally

GRID = Grid((8, 8))


def scores(n: int) -> list[Score]:
    """Scores of one entry each, of beliefs and truths at random."""
    rng, found = np.random.default_rng(n), []
    for _ in range(n):
        p = rng.random(GRID.shape)
        one = Score()
        one.add(Belief(GRID, p / p.sum()), tuple(rng.uniform(0, 8, 2)))
        found.append(one)
    return found


def tally(entries: list[Score]) -> Tally:
    found = Tally()
    for one in entries:
        found.add(one)
    return found


def test_a_tally_says_what_all_its_entries_say() -> None:
    ones, twos = scores(40), scores(3)
    merged = Tally.merged([tally(ones), tally(twos)]).summary()
    kept = Score()
    for one in [*ones, *twos]:
        kept = kept.merge(one)
    asked = kept.summary()
    assert merged["coverage"] == pytest.approx(asked["coverage"], rel=1e-13)
    for name in ("n", "rmse", "mean", "p95", "max"):
        assert merged[name] == asked[name]
    for name in ("entropy", "log_score"):
        assert merged[name] == pytest.approx(asked[name], rel=1e-13)


def test_of_nothing_there_are_no_numbers() -> None:
    assert Tally.merged([]).summary() == Score().summary()


def test_an_entry_takes_eight_bytes() -> None:
    """A run of 1000 ticks of a robot and an object takes 16 kB at each level, not the objects of lists."""
    import pickle

    one = scores(1)[0]
    few, many = tally([one] * 1000), tally([one] * 3000)
    assert len(pickle.dumps(many)) - len(pickle.dumps(few)) < 2000 * 9
