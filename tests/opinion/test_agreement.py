"""Distances, agreement and conflict."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

from blackboard import Grid, cooperative_pool, linear_pool
from blackboard.opinion.agreement import (
    agree,
    bhattacharyya,
    bhattacharyya_coefficient,
    coefficients,
    conflict,
    jensen_shannon,
    kullback_leibler,
)
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array
from tests.opinion.stacks import few, make, stacks

LINE = Grid((200,), 0.1)
P, Q = np.array([0.5, 0.25, 0.25, 0.0]), np.array([0.25, 0.25, 0.25, 0.25])


def test_by_hand() -> None:
    assert kullback_leibler(P, Q) == pytest.approx(0.5 * math.log(2))
    assert kullback_leibler(Q, P) == math.inf
    assert bhattacharyya_coefficient(P, Q) == pytest.approx(math.sqrt(0.125) + 0.5)
    assert bhattacharyya(P, Q) == pytest.approx(-math.log(math.sqrt(0.125) + 0.5))
    middle = 0.5 * (kullback_leibler(P, (P + Q) / 2) + kullback_leibler(Q, (P + Q) / 2))
    assert jensen_shannon(P, Q) == pytest.approx(middle)


def test_gaussians_have_their_closed_forms() -> None:
    """Equal widths, d apart: KL = d^2 / 2 sigma^2, Bhattacharyya = d^2 / 8 sigma^2."""
    p, q = gaussian(LINE, (9,), 1).p, gaussian(LINE, (11,), 1).p
    assert kullback_leibler(p, q) == pytest.approx(2.0, abs=1e-6)
    assert bhattacharyya(p, q) == pytest.approx(0.5, abs=1e-6)


@few
@given(stacks(least=2, most=2))
def test_every_distance_is_one(opinions: Array) -> None:
    p, q = opinions
    for distance in (kullback_leibler, bhattacharyya, jensen_shannon):
        assert distance(p, p) == pytest.approx(0.0, abs=1e-12)
        assert distance(p, q) >= 0
    assert bhattacharyya(p, q) == pytest.approx(bhattacharyya(q, p), abs=1e-12)
    assert jensen_shannon(p, q) == pytest.approx(jensen_shannon(q, p), abs=1e-12)
    assert jensen_shannon(p, q) <= math.log(2)
    assert kullback_leibler(p, q) >= 2 * bhattacharyya(p, q) - 1e-9  # Jensen's inequality
    expected = [[bhattacharyya_coefficient(a, b) for b in opinions] for a in opinions]
    assert coefficients(opinions) == pytest.approx(np.array(expected), abs=1e-12)


def test_without_a_common_cell() -> None:
    p, q = np.eye(2)
    assert kullback_leibler(p, q) == bhattacharyya(p, q) == math.inf
    assert bhattacharyya_coefficient(p, q) == 0
    assert jensen_shannon(p, q) == pytest.approx(math.log(2))
    assert not agree(p, q, 1e9)


def test_agreement_is_a_distance_of_at_most_xi() -> None:
    p, q = gaussian(LINE, (9,), 1).p, gaussian(LINE, (11,), 1).p
    for distance in (kullback_leibler, bhattacharyya, jensen_shannon):
        d = distance(p, q)
        assert agree(p, q, d, distance)
        assert not agree(p, q, 0.999 * d, distance)
    assert agree(p, q, 0.51)  # Bhattacharyya, unless told
    assert not agree(p, q, 0.49)


def test_conflict_is_when_somebody_alone_is_surer_than_all_together() -> None:
    near = np.stack([gaussian(LINE, (mean,), 1).p for mean in (9, 10, 11)])
    assert not conflict(near, cooperative_pool(near))
    assert conflict(near, linear_pool(near))
    for seed in range(20):
        same = np.repeat(make("random", 1, (50,), np.random.default_rng(seed)), 3, axis=0)
        assert not conflict(same, linear_pool(same))  # equal but for rounding
