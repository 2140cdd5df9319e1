"""A Gaussian drawn on the team's grid, and back."""

import math

import numpy as np

from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Array, Grid

FINEST = 8  # parts of a cell's edge, at most
REACH = 6.0  # sigmas that are drawn


def draw(grid: Grid, moments: Moments) -> Belief:
    """The mass of a Gaussian over (x, y) in each cell of a grid, normalised on it; uniform where none of it is inside.

    A cell is cut into parts of at most half a sigma (and an eighth of its edge), whose width is added to the covariance.
    """
    axes = np.sqrt(np.linalg.eigvalsh(moments.covariance).clip(0.0))
    parts = min(FINEST, max(1, math.ceil(2 * grid.cell / max(float(axes[0]), 1e-9))))
    step = grid.cell / parts
    covariance = moments.covariance + np.eye(2) * step**2 / 12
    box = [_box(grid, axis, moments.mean[axis], REACH * math.sqrt(covariance[axis, axis])) for axis in (0, 1)]
    if any(first >= last for first, last in box):
        return uniform(grid)
    x, y = (
        grid.origin[i] + first * grid.cell + (np.arange((last - first) * parts) + 0.5) * step - moments.mean[i]
        for i, (first, last) in enumerate(box)
    )
    (a, b), (_, c) = np.linalg.inv(covariance)
    exponent: Array = -0.5 * (a * x[:, None] ** 2 + 2 * b * x[:, None] * y[None, :] + c * y[None, :] ** 2)
    fine = np.exp(exponent - exponent.max())
    (x0, x1), (y0, y1) = box
    p = np.zeros(grid.shape)
    p[x0:x1, y0:y1] = fine.reshape(x1 - x0, parts, y1 - y0, parts).sum(axis=(1, 3))
    return Belief(grid, p / p.sum())


def _box(grid: Grid, axis: int, mean: float, reach: float) -> tuple[int, int]:
    """The first cell and the one behind the last along an axis that are within reach of the mean; none: equal."""
    low, high = ((mean + sign * reach - grid.origin[axis]) / grid.cell for sign in (-1, 1))
    n = grid.shape[axis]
    return max(0, min(n, math.floor(low))), max(0, min(n, math.ceil(high)))
