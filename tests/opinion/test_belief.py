"""Grids, the shapes of beliefs, and how mass moves on a grid."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import Grid, entropy
from blackboard.opinion.belief import Belief, blur, gaussian, shift
from blackboard.opinion.grid import Array
from tests import oracles
from tests.opinion.stacks import few, stacks

GRID = Grid((8, 5), 0.5, (-1.0, 2.0), "m")


def test_a_point_is_in_the_cell_whose_centre_is_nearest() -> None:
    for i in range(8):
        for j in range(5):
            x, y = GRID.centre((i, j))
            assert (x, y) == (GRID.centres(0)[i], GRID.centres(1)[j])
            assert GRID.index((x - 0.24, y + 0.24)) == (i, j)
    assert GRID.index((-1.0, 2.0)) == (0, 0)
    assert GRID.index((3.0, 2.0)) is None
    assert GRID.index((-1.01, 2.0)) is None
    assert (GRID.size, GRID.volume, GRID.ndim) == (40, 0.25, 2)


@pytest.mark.parametrize(
    "fields",
    [
        {"shape": ()},
        {"shape": (3, 0)},
        {"shape": (3,), "cell": 0.0},
        {"shape": (3,), "cell": float("nan")},
        {"shape": (3,), "origin": (1.0, 2.0)},
        {"shape": (3,), "origin": (float("inf"),)},
    ],
)
def test_a_grid_that_is_none(fields: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"^grid (shape|cell|origin)"):
        Grid(**fields)  # type: ignore[arg-type]


def test_mean_and_covariance_by_hand() -> None:
    p = np.zeros(GRID.shape)
    p[1, 1], p[3, 2] = 0.25, 0.75
    belief = Belief(GRID, p)
    a, b = GRID.centre((1, 1)), GRID.centre((3, 2))
    mean = 0.25 * a + 0.75 * b
    assert belief.mean() == pytest.approx(mean)
    assert belief.covariance() == pytest.approx(
        0.25 * np.outer(a - mean, a - mean) + 0.75 * np.outer(b - mean, b - mean)
    )


def test_a_gaussian_has_its_mean_and_width() -> None:
    belief = gaussian(Grid((80, 60), 0.5), (18, 16), (3, 2))
    assert belief.mean() == pytest.approx([18, 16], abs=1e-3)
    assert belief.covariance() == pytest.approx(np.diag([9, 4]), abs=1e-2)
    assert belief.p.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("mean", [(900.0, 3.0), (-1.01, 3.0), (0.0, 4.6), (float("nan"), 3.0), (0.0, float("inf"))])
def test_a_gaussian_outside_the_grid_is_an_error_that_names_the_value(mean: tuple[float, float]) -> None:
    axis = 0 if mean[1] == 3.0 else 1
    borders = ("from -1 to 3", "from 2 to 4.5")[axis]
    with pytest.raises(
        ValueError, match=rf"^gaussian: mean {mean[axis]} on axis {axis} is outside the grid, which is {borders}"
    ):
        gaussian(GRID, mean, 1.0)


def test_a_gaussian_between_the_cells_or_on_the_border_keeps_its_mass() -> None:
    assert gaussian(GRID, (0.3, 3.1), 1e-6).p.max() == pytest.approx(1.0)
    assert gaussian(GRID, (3.0, 4.5), 0.01).p[-1, -1] == pytest.approx(1.0)
    with pytest.raises(ValueError, match="sigma"):
        gaussian(GRID, (0.0, 3.0), 0.0)


@few
@given(stacks(most=1), st.floats(0.01, 20))
def test_blur_conserves_mass_and_never_sharpens(opinions: Array, sigma: float) -> None:
    p = opinions[0]
    blurred = blur(p, sigma)
    assert blurred.min() >= 0
    assert blurred.sum() == pytest.approx(1.0, abs=1e-12)
    assert entropy(blurred) >= entropy(p) - 1e-9
    assert blur(np.full(p.shape, 1 / p.size), sigma) == pytest.approx(np.full(p.shape, 1 / p.size), abs=1e-12)


@pytest.mark.parametrize("sigma", [0.1, 1 / 3, 1.0, 4.0])
def test_blur_adds_its_variance_however_small(sigma: float) -> None:
    grid = Grid((81,))
    p = np.zeros(81)
    p[40] = 1.0
    blurred = Belief(grid, blur(p, sigma))
    assert blurred.mean() == pytest.approx([40.5])
    assert blurred.covariance()[0, 0] == pytest.approx(sigma**2, rel=1e-9)


def test_blur_is_a_random_walk_between_walls() -> None:
    for sigma in (0.5, 3.0, 30.0):
        walk = oracles.random_walk(9, sigma**2)
        assert blur(np.eye(9), [sigma, 0.0]) == pytest.approx(walk, abs=1e-5)


def test_blurs_add_up_and_know_their_axis() -> None:
    p = gaussian(Grid((30, 20)), (4, 15), (1, 2)).p
    assert blur(blur(p, 3.0), 4.0) == pytest.approx(blur(p, 5.0), abs=1e-12)
    assert blur(p, 0.0) is p
    along = blur(p, (2.0, 0.0))
    assert along.sum(axis=0) == pytest.approx(p.sum(axis=0))
    assert blur(blur(p, (2.0, 0.0)), (0.0, 1.5)) == pytest.approx(blur(p, (2.0, 1.5)), abs=1e-12)


@few
@given(stacks(("random",), most=1), st.integers(-6, 6), st.integers(-6, 6))
def test_shift_moves_whole_cells_and_piles_up_at_the_border(opinions: Array, dx: int, dy: int) -> None:
    p = opinions[0].reshape(len(opinions[0]), -1)
    expected = np.zeros(p.shape)
    for (i, j), mass in np.ndenumerate(p):
        expected[min(max(i + dx, 0), p.shape[0] - 1), min(max(j + dy, 0), p.shape[1] - 1)] += mass
    assert shift(p, (dx, dy)) == pytest.approx(expected, abs=1e-15)
    assert math.fsum(shift(p, (dx, dy)).ravel()) == pytest.approx(1.0, abs=1e-12)
