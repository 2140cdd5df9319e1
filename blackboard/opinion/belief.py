"""A belief: a probability grid, the shapes that priors and tests are made of, and how mass moves and spreads on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, wraps
from inspect import signature
from typing import Concatenate, ParamSpec

import numpy as np

from blackboard.opinion import given
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.region import Mask, least_inside, polygons

P = ParamSpec("P")


def _making(masses: Callable[Concatenate[Grid, P], Array]) -> staticmethod[Concatenate[Grid, P], Belief]:
    """A static method that makes a belief, by a function that gives the masses of the cells."""

    @wraps(masses)
    def make(grid: Grid, *args: P.args, **keywords: P.kwargs) -> Belief:
        return Belief(grid, masses(grid, *args, **keywords))

    make.__signature__ = signature(masses).replace(return_annotation="Belief")  # type: ignore[attr-defined]
    return staticmethod(make)


@dataclass(frozen=True, eq=False)
class Belief:
    """Probability mass on a grid: `p` has the grid's shape, is non-negative and sums to 1. ValueError for another shape."""

    grid: Grid
    p: Array

    def __post_init__(self) -> None:
        if np.shape(self.p) != self.grid.shape:
            raise ValueError(
                f"belief of shape {np.shape(self.p)} on a grid of {self.grid.shape}; give one value a cell"
            )

    def mean(self) -> Array:
        """Expected position in the grid's unit, shape (ndim,)."""
        axes = range(self.grid.ndim)
        return np.array(
            [
                self.p.sum(axis=tuple(a for a in axes if a != axis)) @ centres.ravel()
                for axis, centres in zip(axes, self.grid.mesh(), strict=True)
            ]
        )

    def covariance(self) -> Array:
        """Covariance of the position between cells in unit**2, shape (ndim, ndim); add cell**2 / 12 for the width of a cell."""
        return self.moments()[1]

    def moments(self) -> tuple[Array, Array]:
        """`mean` and `covariance`."""
        mean = self.mean()
        away = [x - m for x, m in zip(self.grid.mesh(), mean, strict=True)]
        covariance = np.empty((len(away), len(away)))
        for i, a in enumerate(away):
            weighted = self.p * a
            for j, b in enumerate(away[: i + 1]):
                covariance[i, j] = covariance[j, i] = float((weighted * b).sum())
        return mean, covariance

    def mode(self) -> Array:
        """The centre of the likeliest cell in the grid's unit, shape (ndim,); of several the first."""
        return self.grid.centre([int(i) for i in np.unravel_index(int(self.p.argmax()), self.grid.shape)])

    def region(self, share: float = 0.95) -> Mask:
        """The cells of the smallest region that holds at least `share` of the mass (0 to 1), in the grid's shape.

        Cells of equal density are in it together, so an even belief's region is the whole grid. ValueError: a share outside (0, 1].
        """
        if not 0.0 < share <= 1.0:
            raise ValueError(f"region: share {share}; give one above 0 and at most 1")
        return np.asarray(self.p >= least_inside(self.p, share))

    def polygons(self, share: float = 0.95) -> list[Array]:
        """The borders of `region` on a grid of 2 axes (`blackboard.opinion.region.polygons`). ValueError: other axes."""
        return polygons(self.grid, self.region(share))

    def samples(self, n: int, rng: np.random.Generator) -> Array:
        """Points drawn from it, shape (n, ndim) in the grid's unit: a cell by its mass, then anywhere in it."""
        grid, flat = self.grid, self.p.ravel()
        cells = np.stack(np.unravel_index(rng.choice(flat.size, size=n, p=flat / flat.sum()), grid.shape), axis=-1)
        return np.asarray(np.asarray(grid.origin) + (cells + rng.random((n, grid.ndim))) * grid.cell)

    def resampled(self, grid: Grid, lost: float = 0.01) -> Belief:
        """The same on another grid (`blackboard.opinion.given.resampled`)."""
        return Belief(grid, given.resampled(self.grid, self.p, grid, lost))

    from_gaussian = _making(given.from_gaussian)
    from_mixture = _making(given.from_mixture)
    from_particles = _making(given.from_particles)
    from_range_bearing = _making(given.from_range_bearing)
    from_occupancy = _making(given.from_occupancy)


def uniform(grid: Grid) -> Belief:
    """The same mass in each of the m cells, 1 / m: no information."""
    return Belief(grid, np.full(grid.shape, 1.0 / grid.size))


def gaussian(grid: Grid, mean: Sequence[float], sigma: float | Sequence[float]) -> Belief:
    """An axis-parallel Gaussian at the cell centres, normalised on the grid; `mean` and `sigma` in the grid's unit.

    A sigma far below a cell would leave no mass on any centre, so the exponent is taken relative to its best cell.
    Raises ValueError for a mean outside the grid, whose border belongs to it, and for a sigma that is not positive.
    """
    for axis, m in enumerate(mean):
        low, high = grid.origin[axis], grid.origin[axis] + grid.shape[axis] * grid.cell
        if not low <= m <= high:  # a NaN is on no grid either
            raise ValueError(
                f"gaussian: mean {m} on axis {axis} is outside the grid, which is from {low:g} to {high:g}"
            )
    sigmas = np.broadcast_to(np.asarray(sigma, dtype=float), (grid.ndim,))
    if not (np.all(np.isfinite(sigmas)) and np.all(sigmas > 0)):
        raise ValueError(f"gaussian: sigma {sigma} must be positive")
    exponent: Array = np.zeros(grid.shape)
    for x, m, s in zip(grid.mesh(), mean, sigmas, strict=True):
        exponent = exponent - 0.5 * ((x - m) / s) ** 2
    p = np.exp(exponent - exponent.max())  # exp(-((x - m) / s)^2 / 2) in each cell, relative to the largest
    return Belief(grid, p / math.fsum(p.ravel()))


def blur(p: Array, sigma: float | Sequence[float]) -> Array:
    """Diffuse mass by `sigma` cells, one for all axes or one for each: the Gaussian blur of a grid.

    The heat kernel of the grid: a random walk of variance sigma^2, however small sigma is. So blurs add up: sigma 3, then 4, is
    sigma 5. A sampled Gaussian would lose nearly all of the variance below half a cell. Mass that would leave the grid is
    turned back at the border: mass is conserved, a uniform belief stays uniform, and entropy never falls.
    """
    sigmas = (
        [sigma] * p.ndim if isinstance(sigma, float) else np.broadcast_to(np.asarray(sigma, dtype=float), (p.ndim,))
    )
    for axis, cells in enumerate(sigmas):
        if cells > 0:
            rows = p.swapaxes(0, axis)
            spread = _heat(p.shape[axis], float(cells)) @ rows.reshape(len(rows), -1)
            p = spread.reshape(rows.shape).swapaxes(0, axis)
    return p


def shift(p: Array, cells: Sequence[int]) -> Array:
    """Move mass by whole cells, one number for each axis; mass that would leave the grid stays in its border cells."""
    for axis, by in enumerate(cells):
        p = shift_along(p, by, axis)
    return p


def shift_along(p: Array, cells: int, axis: int) -> Array:
    """As `shift`, along one axis; `p` itself for 0 cells."""
    if cells == 0:
        return p
    n = p.shape[axis]
    cells = max(-n, min(n, cells))
    out = np.zeros_like(p)
    a, b = p.swapaxes(0, axis), out.swapaxes(0, axis)
    if cells > 0:
        b[cells:] = a[: n - cells]
        b[-1] += a[n - cells :].sum(axis=0)
    else:
        b[: n + cells] = a[-cells:]
        b[0] += a[:-cells].sum(axis=0)
    return out


@lru_cache(maxsize=32)
def _heat(n: int, sigma: float) -> Array:
    """exp(sigma^2 / 2 times the Laplacian of n cells between walls), shape (n, n): column j says where cell j's mass goes."""
    waves = _waves(n)
    decay = np.exp(-(sigma**2) * (1.0 - np.cos(np.pi * np.arange(n) / n)))
    kernel = (waves * decay) @ waves.T
    kernel[kernel < 1e-15] = 0.0  # rounding
    return np.asarray(kernel / kernel.sum(axis=0))


@lru_cache(maxsize=8)
def _waves(n: int) -> Array:
    """The Laplacian's orthonormal eigenvectors (the discrete cosine transform), shape (n, n), one in each column."""
    waves = np.cos(np.pi / n * np.outer(np.arange(n) + 0.5, np.arange(n)))
    return np.asarray(waves / np.sqrt((waves**2).sum(axis=0)))
