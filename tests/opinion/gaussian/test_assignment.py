"""The posterior over assignments against all of them, one by one."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from blackboard.opinion.gaussian import assignment
from blackboard.opinion.gaussian.assignment import MAX_CLUSTER, MOST, Rate, posterior
from blackboard.opinion.grid import Array

WEIGHTS = st.one_of(st.just(0.0), st.floats(1e-3, 1e6))


def one_by_one(weights: Array) -> Array:
    """Every way to give each row a column of its own, or none."""
    rows, columns = weights.shape
    total, odds = 0.0, np.zeros_like(weights)
    for given_to in itertools.product([None, *range(columns)], repeat=rows):
        taken = [column for column in given_to if column is not None]
        if len(set(taken)) < len(taken):
            continue
        pairs = [(row, column) for row, column in enumerate(given_to) if column is not None]
        weight = float(np.prod([weights[pair] for pair in pairs]))
        total += weight
        for pair in pairs:
            odds[pair] += weight
    return odds / total


@given(st.tuples(st.integers(0, 4), st.integers(0, 5)).flatmap(lambda shape: arrays(float, shape, elements=WEIGHTS)))
@settings(max_examples=200, deadline=None)
def test_it_is_what_all_assignments_together_say(weights: Array) -> None:
    assert posterior(weights) == pytest.approx(one_by_one(weights), rel=1e-9, abs=1e-12)


def test_two_sightings_are_not_of_one_thing() -> None:
    odds = posterior(np.array([[1e6, 1e3], [1e6, 0.0]]))
    assert odds[0] == pytest.approx([0.0, 1.0], abs=0.002)
    assert odds[1, 0] > 0.99


def crowd(rows: int, columns: int, seed: int = 1) -> Array:
    """Weights of a crowd in which most pairs are possible."""
    chance = np.random.default_rng(seed)
    weights = np.exp(chance.normal(0, 3, (rows, columns))) * (chance.random((rows, columns)) < 0.6)
    weights[:, 0] += 1e-3
    return np.asarray(weights)


def test_in_a_crowd_the_odds_are_nearly_those_of_all_assignments(monkeypatch: pytest.MonkeyPatch) -> None:
    crowds = [crowd(7, 7, seed) for seed in range(30)]
    exact = [posterior(weights) for weights in crowds]
    monkeypatch.setattr(assignment, "MAX_CLUSTER", 0)
    errors = np.array([np.abs(posterior(weights) - right) for weights, right in zip(crowds, exact, strict=True)])
    assert errors.max() < 0.2
    assert errors.mean() < 0.02


@pytest.mark.parametrize("weights", [crowd(16, 64), np.full((16, 64), MOST), np.eye(16) * MOST + 1.0])
def test_a_crowd_of_any_size_has_odds_and_no_sighting_counts_twice(weights: Array) -> None:
    odds = posterior(weights)
    assert ((odds >= 0) & (odds <= 1)).all()
    assert odds.sum(axis=1).max() <= 1 + 1e-9


def test_what_is_clear_is_clear_in_a_crowd_too_and_what_is_apart_is_not_in_it() -> None:
    weights = np.full((MAX_CLUSTER + 3, MAX_CLUSTER + 3), 0.01)
    np.fill_diagonal(weights, 1e6)
    weights[-1], weights[:, -1], weights[-1, -1] = 0.0, 0.0, 99.0
    odds = posterior(weights)
    assert np.diag(odds)[:-1].min() > 0.99
    assert odds[-1, -1] == pytest.approx(0.99)


def test_how_often_strangers_are_seen_is_found_out() -> None:
    few = many = Rate()
    for _ in range(500):
        few, many = few.plus(0.0), many.plus(2.0)
    assert few.rate < 0.001
    assert many.rate == pytest.approx(2.0, rel=0.01)
