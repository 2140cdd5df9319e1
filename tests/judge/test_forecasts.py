"""Probabilities against what happened: exact numbers."""

import numpy as np
import pytest

from blackboard.judge.forecasts import Forecasts


def of(*pairs: tuple[float, bool]) -> Forecasts:
    forecasts = Forecasts()
    for probability, happened in pairs:
        forecasts.add(probability, happened)
    return forecasts


def test_the_numbers_are_those_of_the_textbook() -> None:
    summary = of((0.9, True), (0.1, False), (0.4, False), (0.4, True)).summary()
    assert (summary["n"], summary["share"], summary["told"]) == (4, 0.5, pytest.approx(0.45))
    assert summary["brier"] == pytest.approx((0.01 + 0.01 + 0.16 + 0.36) / 4)
    assert summary["auroc"] == pytest.approx((2 + 1.5) / 4)  # of the pairs one is a draw


def test_the_auroc_is_that_of_all_pairs() -> None:
    rng = np.random.default_rng(1)
    happened = rng.random(400) < 0.2
    probabilities = np.round(np.clip(rng.normal(0.3 + 0.3 * happened, 0.2), 0.0, 1.0) * 100) / 100 * 0.99 + 0.001
    above = [float(a > b) + 0.5 * float(a == b) for a in probabilities[happened] for b in probabilities[~happened]]
    summary = of(*zip(probabilities.tolist(), happened.tolist(), strict=True)).summary()
    assert summary["auroc"] == pytest.approx(np.mean(above), abs=1e-3)


def test_the_table_holds_what_was_told_against_what_happened() -> None:
    table = of(*[(0.15, k < 2) for k in range(10)], (1.0, True)).summary()["calibration"]
    assert table == [
        {"from": 0.1, "to": 0.2, "n": 10, "told": pytest.approx(0.15), "share": 0.2},
        {"from": 0.8, "to": 1.0, "n": 1, "told": 1.0, "share": 1.0},
    ]


def test_several_together_are_those_of_all() -> None:
    first, second = of((0.9, True), (0.2, False)), of((0.3, True))
    assert Forecasts.merged([first, second]).summary() == of((0.9, True), (0.2, False), (0.3, True)).summary()


def test_without_both_kinds_there_is_no_order_and_without_any_there_is_nothing() -> None:
    assert of((0.1, False)).summary()["auroc"] is None
    assert Forecasts().summary() == {}
