"""Raster operations against the slow and obvious."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.belief import Belief, gaussian, shift, uniform
from blackboard.opinion.grid import Grid
from robot_agent.raster import LEAST_COMMON_MASS, log_ratio, sampled, shifted, squared_distance, with_outlier
from tests.present import present

GRID = Grid((9, 7))
P = np.random.default_rng(1).dirichlet(np.ones(63)).reshape(9, 7)


@given(dx=st.floats(-3, 3), dy=st.floats(-3, 3))
def test_a_fraction_is_split_between_the_neighbours(dx: float, dy: float) -> None:
    ix, iy = math.floor(dx), math.floor(dy)
    fx, fy = dx - ix, dy - iy
    expected = sum(
        wx * wy * shift(shift(P, (ix, iy)), (a, b))
        for a, wx in ((0, 1 - fx), (1, fx))
        for b, wy in ((0, 1 - fy), (1, fy))
    )
    assert shifted(P, dx, dy) == pytest.approx(expected, abs=1e-15)


@given(dx=st.floats(-1, 1), dy=st.floats(-1, 1))
def test_values_between_cells_are_bilinear_and_constant_beyond_the_border(dx: float, dy: float) -> None:
    values = sampled(P, dx, dy)
    for ix in range(9):
        for iy in range(7):
            x, y = min(max(ix + dx, 0.0), 8.0), min(max(iy + dy, 0.0), 6.0)
            a, b = min(int(x), 7), min(int(y), 5)
            fx, fy = x - a, y - b
            corners = P[a : a + 2, b : b + 2]
            expected = np.array([1 - fx, fx]) @ corners @ np.array([1 - fy, fy])
            assert values[ix, iy] == pytest.approx(expected, abs=1e-12)


def test_the_squared_distance_is_the_quadratic_form_of_the_inverse() -> None:
    covariance = np.array([[2.0, 0.7], [0.7, 0.5]])
    dx, dy = np.array([[1.0, -2.0, 0.3]]), np.array([[0.5], [3.0]])
    distances = squared_distance(dx, dy, covariance)
    for i, y in enumerate(dy[:, 0]):
        for j, x in enumerate(dx[0]):
            d = np.array([x, y])
            assert distances[i, j] == pytest.approx(d @ np.linalg.solve(covariance, d))


def test_the_log_ratio_is_zero_where_both_are_equal_and_finite_where_one_is_empty() -> None:
    here = gaussian(GRID, (4, 3), 1.0)
    assert log_ratio(here, here) is not None
    assert not np.any(log_ratio(here, here))
    other = gaussian(GRID, (5, 3), 1.0)
    logs = present(log_ratio(other, here))
    held = np.minimum(here.p, other.p) > 1e-3
    assert logs[held] == pytest.approx(np.log(other.p / here.p)[held], abs=0.001)
    half = here.p * (np.arange(9) < 5)[:, None]
    cut = present(log_ratio(Belief(GRID, half / half.sum()), here))
    assert np.isfinite(cut).all()
    assert cut[8, 3] < -3


@pytest.mark.parametrize(("share", "meets"), [(0.9, False), (1.1, True)])
def test_beliefs_with_little_mass_in_common_have_no_ratio(share: float, meets: bool) -> None:
    first, second = np.zeros(GRID.shape), np.zeros(GRID.shape)
    common = share * LEAST_COMMON_MASS
    first[0, 0], first[4, 4] = 1 - common, common
    second[8, 6], second[4, 4] = 1 - common, common
    assert (log_ratio(Belief(GRID, first), Belief(GRID, second)) is not None) == meets


def test_an_outlier_is_a_uniform_share() -> None:
    mixed = with_outlier(3 * P, GRID, 0.1).p
    assert mixed == pytest.approx(0.9 * P + 0.1 / 63)
    assert with_outlier(np.zeros(GRID.shape), GRID, 0.1).p == pytest.approx(uniform(GRID).p)
