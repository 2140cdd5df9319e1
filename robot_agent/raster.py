"""Operations on 2-D arrays of cells that both localizers use: moving mass, reading between cells, ratios of beliefs."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from blackboard.opinion.belief import Belief, shift_along, uniform
from blackboard.opinion.grid import Array, Grid

#: Two beliefs with less mass in common than this contradict each other, and are not multiplied.
LEAST_COMMON_MASS = 1e-3

#: Share of a positive lower bound of the result that a cell keeps where an interpolation rings below it.
LEAST_SHARE = 0.02

#: Both ends of both axes of an array are borders.
ALL_WALLS = (True, True), (True, True)

#: Floor of both beliefs in `log_ratio`, relative to the larger peak, so that tails that were left out on the wire do not matter.
TAIL = 1e-6


def shifted(p: Array, dx: float, dy: float) -> Array:
    """Mass moved by (dx, dy) cells, a fraction split between neighbours (bilinear); the border keeps what would leave."""
    return _shifted_along(_shifted_along(p, dx, 0), dy, 1)


def _shifted_along(p: Array, cells: float, axis: int) -> Array:
    whole = math.floor(cells)
    part = cells - whole
    moved = shift_along(p, whole, axis)
    return moved if part == 0 else (1 - part) * moved + part * shift_along(moved, 1, axis)


def reach_of(variance: float) -> int:
    """How many cells the heat kernel of a variance (cells ** 2) reaches along an axis: beyond is less than 1e-15 of its mass."""
    return math.ceil(8.0 * math.sqrt(variance)) + 5


def diffused(p: Array, covariance: Array, walls: Sequence[Sequence[bool]] = ALL_WALLS) -> Array:
    """Mass spread by a Gaussian of a covariance (cells ** 2, shape (2, 2)), in any direction; the border reflects it.

    `p` has shape (nx, ny), and so has the result. `walls[axis]` says whether the first and the last row of an axis are at a
    border that reflects. Where one is not, `p` must hold no mass within `reach_of` cells of it: what leaves there comes in
    again at the other end.

    The heat kernel of the grid with a mixed difference, a product in the Fourier domain. Its symbol is smooth across the
    highest frequency. The plain quadratic form jumps there, and rings through the whole grid. What it still rings nearby is cut
    off: no cell falls below LEAST_SHARE of what it had, so that no zero appears, which would rule the cell out for good.
    """
    (xx, xy), (_, yy) = covariance
    # on a whole grid, six standard deviations: beyond arrives less than 1e-6
    reach = math.ceil(6.0 * math.sqrt(max(xx, yy))) + 1 if walls == ALL_WALLS else reach_of(max(xx, yy))
    reach = min(reach, *p.shape)
    size = tuple(8 * math.ceil((n + reach * sum(ends)) / 8) for n, ends in zip(p.shape, walls, strict=True))
    dx, dy, sx, sy = _differences(*size)
    kernel = np.exp(xx * dx + yy * dy - xy * sx * sy)
    wide = np.maximum(np.fft.irfft2(np.fft.rfft2(p, size) * kernel, size), 0.0)
    wide[: p.shape[0], : p.shape[1]] = np.maximum(wide[: p.shape[0], : p.shape[1]], LEAST_SHARE * p)
    for axis, (first, last) in enumerate(walls):
        n = p.shape[axis]
        rows = wide if axis == 0 else wide.T
        kept = rows[:n].copy() if first or last else rows[:n]
        if last:
            kept[n - reach :] += rows[n : n + reach][::-1]
        if first:
            kept[:reach] += rows[-reach:][::-1]  # indices below 0 come out at the other end
        wide = kept if axis == 0 else kept.T
    return np.asarray(wide * (p.sum() / wide.sum()))


def resampled(p: Array, dx: float, dy: float) -> Array:
    """Mass moved by (dx, dy) cells, each at most one cell, without widening it; the border keeps what would leave.

    Cubic convolution (Keys, IEEE Trans. ASSP 29(6), 1981, a = -1/2) keeps mean and variance, where the bilinear `shifted` adds
    the variance f (1 - f) for a fraction f. It rings where the belief is steep: no cell falls below LEAST_SHARE of the bilinear
    value, so that no zero appears.
    """
    return np.maximum(_resampled_along(_resampled_along(p, dx, 0), dy, 1), LEAST_SHARE * shifted(p, dx, dy))


def _resampled_along(p: Array, cells: float, axis: int) -> Array:
    whole = math.floor(cells)
    f = cells - whole
    if f == 0:
        return shift_along(p, whole, axis)
    weights = (  # of the cells that lie -1, 0, 1, 2 further
        0.5 * (-f + 2 * f**2 - f**3),
        0.5 * (2 - 5 * f**2 + 3 * f**3),
        0.5 * (f + 4 * f**2 - 3 * f**3),
        0.5 * (-(f**2) + f**3),
    )
    shares = (w * shift_along(p, whole + step, axis) for step, w in zip((-1, 0, 1, 2), weights, strict=True))
    return np.asarray(sum(shares))


@lru_cache(maxsize=256)
def _quick(n: int) -> int:
    """The next size that the FFT is quick with: one without a prime factor above 11."""
    rest = n
    for prime in (2, 3, 5, 7, 11):
        while rest % prime == 0:
            rest //= prime
    return n if rest == 1 else _quick(n + 1)


def convolved(p: Array, kernel: Array, first: Sequence[int], shape: Sequence[int]) -> Array:
    """`p` convolved with `kernel`, on a grid of `shape`: p[0, 0] kernel[0, 0] belongs to its cell `first`, which may lie off it.

    By FFT, of a size with which what wraps around falls off the grid. Negative values, which are rounding, become 0.
    """
    lengths = [n + k - 1 for n, k in zip(p.shape, kernel.shape, strict=True)]
    kept = [slice(max(0, -at), min(n, m - at)) for n, at, m in zip(lengths, first, shape, strict=True)]
    size = [_quick(max(n - on.start, on.stop)) for n, on in zip(lengths, kept, strict=True)]
    full = np.fft.irfft2(np.fft.rfft2(p, size) * np.fft.rfft2(kernel, size), size)
    out = np.zeros(shape)
    out[tuple(slice(at + on.start, at + on.stop) for at, on in zip(first, kept, strict=True))] = np.maximum(
        full[kept[0], kept[1]], 0.0
    )
    return out


@lru_cache(maxsize=64)
def _differences(nx: int, ny: int) -> tuple[Array, Array, Array, Array]:
    """Half the second difference along x and y, cos f - 1, and the first, sin f, at the frequencies f of `np.fft.rfft2`."""
    fx, fy = 2 * math.pi * np.fft.fftfreq(nx)[:, None], 2 * math.pi * np.fft.rfftfreq(ny)[None, :]
    return np.cos(fx) - 1, np.cos(fy) - 1, np.sin(fx), np.sin(fy)


def sampled(values: Array, dx: float, dy: float) -> Array:
    """`values` read (dx, dy) cells beside each cell centre, at most one cell away: bilinear, constant beyond the border."""
    return _sampled_along(_sampled_along(values, dx, 0), dy, 1)


def _sampled_along(values: Array, part: float, axis: int) -> Array:
    if part == 0:
        return values
    n = values.shape[axis]
    beside = np.clip(np.arange(n) + (1 if part > 0 else -1), 0, n - 1)
    return (1 - abs(part)) * values + abs(part) * np.take(values, beside, axis=axis)


def squared_distance(dx: Array, dy: Array, covariance: Array) -> Array:
    """The squared Mahalanobis distance d^T C^-1 d of displacements (dx, dy) for one covariance C, shape (2, 2)."""
    inverse = np.linalg.inv(covariance)
    return np.asarray(inverse[0, 0] * dx * dx + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy * dy)


def log_ratio(agreed: Belief, reported: Belief) -> Array | None:
    """Ln(agreed / reported) in each cell, the log likelihood of Jeffrey's rule: zero where both are equal.

    None where the two have less than LEAST_COMMON_MASS in common: then the ratio would only reweight tails.
    """
    floor = common_floor(agreed, reported)
    return None if floor is None else np.asarray(np.log((agreed.p + floor) / (reported.p + floor)))


def common_floor(agreed: Belief, reported: Belief) -> float | None:
    """The mass that `log_ratio` adds to each cell of both; None where they contradict each other."""
    if np.minimum(agreed.p, reported.p).sum() < LEAST_COMMON_MASS:
        return None
    return float(TAIL * max(agreed.p.max(), reported.p.max()))


def with_outlier(p: Array, grid: Grid, outlier: float) -> Belief:
    """`p` normalised and mixed with a uniform share `outlier`, for sightings of something else; uniform where `p` is empty."""
    total = p.sum()
    if not total > 0:
        return uniform(grid)
    return Belief(grid, (1 - outlier) * p / total + outlier / grid.size)
