"""The posterior over assignments against all of them, one by one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from blackboard.opinion.gaussian.assignment import MAX_CLUSTER, Rate, posterior
from blackboard.opinion.grid import Array

WEIGHTS = st.one_of(st.just(0.0), st.floats(1e-3, 1e6))


def one_by_one(weights: Array) -> Array:
    """Every way to give each row a column of its own, or none."""
    rows, columns = weights.shape
    total, found = 0.0, np.zeros_like(weights)
    for given_to in itertools.product([None, *range(columns)], repeat=rows):
        taken = [column for column in given_to if column is not None]
        if len(set(taken)) < len(taken):
            continue
        pairs = [(row, column) for row, column in enumerate(given_to) if column is not None]
        weight = float(np.prod([weights[pair] for pair in pairs]))
        total += weight
        for pair in pairs:
            found[pair] += weight
    return found / total


@given(st.tuples(st.integers(0, 4), st.integers(0, 5)).flatmap(lambda shape: arrays(float, shape, elements=WEIGHTS)))
@settings(max_examples=200, deadline=None)
def test_it_is_what_all_assignments_together_say(weights: Array) -> None:
    assert posterior(weights) == pytest.approx(one_by_one(weights), rel=1e-9, abs=1e-12)


def test_two_sightings_are_not_of_one_thing() -> None:
    found = posterior(np.array([[1e6, 1e3], [1e6, 0.0]]))
    assert found[0] == pytest.approx([0.0, 1.0], abs=0.002)
    assert found[1, 0] > 0.99


def test_of_a_crowd_that_is_too_large_nothing_is_said_and_of_others_all_the_same() -> None:
    weights = np.zeros((MAX_CLUSTER + 2, MAX_CLUSTER + 2))
    weights[:-1, :-1], weights[-1, -1] = 5.0, 99.0
    found = posterior(weights)
    assert np.isnan(found[:-1, :-1]).all()
    assert found[-1, -1] == pytest.approx(0.99)


def test_how_often_strangers_are_seen_is_found_out() -> None:
    few = many = Rate()
    for _ in range(500):
        few, many = few.plus(0.0), many.plus(2.0)
    assert few.rate < 0.001
    assert many.rate == pytest.approx(2.0, rel=0.01)
