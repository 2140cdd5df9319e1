"""The generated trials: what their sources believe, and a case of some sources."""

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.lab.cases import GRID, LIAR_SIGMA, LIE, TRIALS, Case
from blackboard.opinion.belief import Belief
from blackboard.opinion.scores import Score
from tests.lab.trials import drawn


def off(case: Case, source: int) -> float:
    return math.dist(Belief(case.grid, case.opinions[source]).mean(), case.truth)


@pytest.mark.parametrize("trial", TRIALS)
def test_a_trial_is_five_opinions_and_the_truth(trial: str) -> None:
    first, again = drawn(trial, 2), drawn(trial, 2)
    assert all(np.array_equal(a.opinions, b.opinions) and a.truth == b.truth for a, b in zip(first, again, strict=True))
    assert first[0].opinions.shape == (5, *GRID.shape)
    assert first[0].opinions.sum(axis=(1, 2)) == pytest.approx(1.0)
    assert GRID.index(first[0].truth) is not None
    assert not np.array_equal(first[0].opinions, first[1].opinions)


@pytest.mark.parametrize("trial", ["independent", "correlated"])
def test_honest_sources_are_each_as_good_as_they_say(trial: str) -> None:
    score = Score()
    for case in drawn(trial, 200, seed=3):
        for p in case.opinions:
            score.add(Belief(case.grid, p), case.truth)
    assert score.summary()["coverage"]["90"] == pytest.approx(0.9, abs=0.04)
    assert score.summary()["coverage"]["50"] == pytest.approx(0.5, abs=0.08)


def test_correlated_sources_err_together() -> None:
    def agreement(trial: str) -> float:
        errors = [[Belief(c.grid, p).mean()[0] - c.truth[0] for p in c.opinions[:2]] for c in drawn(trial, 100)]
        return float(np.corrcoef(np.array(errors).T)[0, 1])

    assert abs(agreement("independent")) < 0.25
    assert agreement("correlated") > 0.55


def test_liars_and_echoes_are_what_they_are_called() -> None:
    echoed = drawn("echoes", 1)[0]
    assert all(np.array_equal(echoed.opinions[0], p) for p in echoed.opinions[1:4])
    assert not np.array_equal(echoed.opinions[0], echoed.opinions[4])
    assert echoed.common is not None
    assert len(echoed.common) == 3
    for trial, liars in (("one liar", 1), ("two collude", 2)):
        case = drawn(trial, 1)[0]
        assert [off(case, i) for i in range(liars)] == pytest.approx([LIE] * liars, abs=0.3)
        sharp = Belief(GRID, case.opinions[0]).covariance()[0, 0]
        assert sharp == pytest.approx(LIAR_SIGMA**2, rel=0.1)
    assert np.array_equal(case.opinions[0], case.opinions[1])


def test_the_opinions_of_a_case_are_its_sources_on_its_grid() -> None:
    case = drawn("independent", 1)[0]
    with pytest.raises(ValueError, match=r"case of 5 sources on a grid of \(50, 50\): opinions of shape \(4, 50, 50\)"):
        replace(case, opinions=case.opinions[:4])


def test_a_mean_beyond_the_border_stays_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of 4 sigma, in one run of many thousands, leads over the border and must not end the lab."""
    monkeypatch.setattr("blackboard.lab.cases.SIGMA", (40.0, 41.0))
    for trial in TRIALS:
        assert drawn(trial, 1)[0].opinions.sum(axis=(1, 2)) == pytest.approx(1.0)


def test_a_case_of_some_sources() -> None:
    case = drawn("independent", 1)[0]
    part = case.of(["s4", "s2", "nobody"])
    assert part.sources == ("s2", "s4")
    assert np.array_equal(part.opinions, case.opinions[[1, 3]])
