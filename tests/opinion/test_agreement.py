"""Distances, agreement and conflict."""

import math

import numpy as np
import pytest
from hypothesis import given

from blackboard import Grid, cooperative_pool, linear_pool
from blackboard.opinion.agreement import bhattacharyya_coefficient, coefficients, conflict, kullback_leibler
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array
from tests.opinion.stacks import few, make, stacks

LINE = Grid((200,), 0.1)
P, Q = np.array([0.5, 0.25, 0.25, 0.0]), np.array([0.25, 0.25, 0.25, 0.25])


def test_by_hand() -> None:
    assert kullback_leibler(P, Q) == pytest.approx(0.5 * math.log(2))
    assert kullback_leibler(Q, P) == math.inf
    assert bhattacharyya_coefficient(P, Q) == pytest.approx(math.sqrt(0.125) + 0.5)


def test_gaussians_have_their_closed_forms() -> None:
    """Equal widths, d apart: KL = d^2 / 2 sigma^2, Bhattacharyya = d^2 / 8 sigma^2."""
    p, q = gaussian(LINE, (9,), 1).p, gaussian(LINE, (11,), 1).p
    assert kullback_leibler(p, q) == pytest.approx(2.0, abs=1e-6)
    assert -math.log(bhattacharyya_coefficient(p, q)) == pytest.approx(0.5, abs=1e-6)


@few
@given(stacks(least=2, most=2))
def test_every_distance_is_one(opinions: Array) -> None:
    p, q = opinions
    assert kullback_leibler(p, p) == pytest.approx(0.0, abs=1e-12)
    assert bhattacharyya_coefficient(p, p) == pytest.approx(1.0, abs=1e-12)
    assert bhattacharyya_coefficient(p, q) == pytest.approx(bhattacharyya_coefficient(q, p), abs=1e-12)
    # Jensen's inequality: KL is at least twice Bhattacharyya's distance
    assert bhattacharyya_coefficient(p, q) >= math.exp(-kullback_leibler(p, q) / 2) - 1e-9
    expected = [[bhattacharyya_coefficient(a, b) for b in opinions] for a in opinions]
    assert coefficients(opinions) == pytest.approx(np.array(expected), abs=1e-12)


def test_without_a_common_cell() -> None:
    p, q = np.eye(2)
    assert kullback_leibler(p, q) == math.inf
    assert bhattacharyya_coefficient(p, q) == 0


def test_a_divergence_is_never_negative() -> None:
    """Where two beliefs differ by less than rounding, its sum falls below 0 in about half of the cases."""
    chance = np.random.default_rng(1)
    for _ in range(50):
        p = chance.dirichlet(np.ones(50))
        q = p * (1 + 1e-9 * chance.standard_normal(50))
        assert 0 <= kullback_leibler(p, q / q.sum()) < 1e-12


def test_conflict_is_when_somebody_alone_is_surer_than_all_together() -> None:
    near = np.stack([gaussian(LINE, (mean,), 1).p for mean in (9, 10, 11)])
    assert not conflict(near, cooperative_pool(near))
    assert conflict(near, linear_pool(near))
    for seed in range(20):
        same = np.repeat(make("random", 1, (50,), np.random.default_rng(seed)), 3, axis=0)
        assert not conflict(same, linear_pool(same))  # equal but for rounding
