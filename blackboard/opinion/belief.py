"""A belief: a probability grid in one head, with the few shapes that priors and tests are made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from blackboard.opinion.grid import Array, Grid


@dataclass(frozen=True, eq=False)
class Belief:
    """Probability mass on a grid: `p` has the grid's shape, is non-negative and sums to 1."""

    grid: Grid
    p: Array

    def mean(self) -> Array:
        """Expected position in the grid's unit, shape (ndim,)."""
        axes = range(self.grid.ndim)
        return np.array(
            [self.p.sum(axis=tuple(a for a in axes if a != axis)) @ self.grid.centres(axis) for axis in axes]
        )

    def covariance(self) -> Array:
        """Covariance of the position between cells in unit**2, shape (ndim, ndim); add cell**2 / 12 for the width of a cell."""
        away = [x - m for x, m in zip(self.grid.mesh(), self.mean(), strict=True)]
        return np.array([[float((self.p * a * b).sum()) for b in away] for a in away])


def uniform(grid: Grid) -> Belief:
    """Nothing is known: 1 / m in every cell."""
    return Belief(grid, np.full(grid.shape, 1.0 / grid.size))


def gaussian(grid: Grid, mean: Sequence[float], sigma: float | Sequence[float]) -> Belief:
    """An axis-parallel Gaussian at the cell centres, normalised on the grid; `mean` and `sigma` in the grid's unit.

    A sigma far below a cell, or a mean far outside, would leave no mass on any centre, so the exponent is taken
    relative to its best cell.
    """
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=float), (grid.ndim,))
    if not (np.all(np.isfinite(sigmas)) and np.all(sigmas > 0)):
        raise ValueError(f"gaussian: sigma {sigma} must be positive")
    exponent: Array = np.zeros(grid.shape)
    for x, m, s in zip(grid.mesh(), mean, sigmas, strict=True):
        exponent = exponent - 0.5 * ((x - m) / s) ** 2
    p = np.exp(exponent - exponent.max())
    return Belief(grid, p / math.fsum(p.ravel()))


def blur(p: Array, sigma: float | Sequence[float]) -> Array:
    """A Gaussian blur of `sigma` cells (per axis or one for all); mass that would leave the grid stays in its border cell's reach.

    Separable, cut off at 4 sigma. At the border the kernel is renormalised, so that total mass is conserved exactly.
    """
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=float), (p.ndim,))
    out = p
    for axis, s in enumerate(sigmas):
        if s > 0:
            kernel = _kernel(float(s), p.shape[axis])
            out = np.moveaxis(np.tensordot(kernel, out, axes=(1, axis)), 0, axis)
    return out


@lru_cache(maxsize=256)
def _kernel(sigma: float, n: int) -> Array:
    """The blur of one axis as an (n, n) matrix whose columns sum to 1: column j says where the mass of cell j goes."""
    i = np.arange(n)
    k = np.exp(-0.5 * ((i[:, None] - i[None, :]) / sigma) ** 2)
    k[np.abs(i[:, None] - i[None, :]) > max(1.0, 4 * sigma)] = 0.0
    return np.asarray(k / k.sum(axis=0))
