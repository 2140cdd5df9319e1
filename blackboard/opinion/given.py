"""Beliefs of what people have, as masses: a covariance matrix, particles, a mixture, a range and a bearing, an occupancy grid.

Positions are in the grid's unit, angles in radians. Whatever cannot become a belief is a ValueError that names the value and
where it is. Where errors alone lead across the border of the grid, the part on the grid counts. Densities are integrated over
each cell by Gauss-Legendre quadrature. A grid cannot represent anything narrower than a quarter of a cell, so a smaller
standard deviation is taken as that.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt

from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.opinion.grid import Array, Grid

NARROWEST = 0.25  # cells: the least standard deviation
NEGLIGIBLE = 60.0  # nats below the largest centre of a cell, from which on the centre stands for the cell
CHUNK = 1 << 20  # points that are evaluated together
WRONG = 1e-6  # by which a covariance may miss symmetry, relative to its largest entry
PARTICLES = 256  # that are added up together
FURTHEST = 5.0  # sigmas, and a cell, by which a place that is not known exactly may be outside the grid
REACH = 8.0  # sigmas that the table of the normal distribution covers on each side


def from_gaussian(grid: Grid, mean: npt.ArrayLike, covariance: npt.ArrayLike) -> Array:
    """A Gaussian with any covariance in unit**2, shape (ndim, ndim): mean near the grid; an eigenvalue of 0 is taken as NARROWEST."""
    spread = _covariance(grid, "from_gaussian: covariance", covariance)
    return _gaussian(grid, _place(grid, "from_gaussian: mean", mean, np.sqrt(np.diag(spread))), spread)


def from_mixture(
    grid: Grid,
    means: Sequence[npt.ArrayLike],
    covariances: Sequence[npt.ArrayLike],
    weights: npt.ArrayLike | None = None,
) -> Array:
    """A mixture of Gaussians, shapes (N, ndim), (N, ndim, ndim) and (N,); weights [default: equal] in any scale."""
    n = len(means)
    if not n or len(covariances) != n:
        raise ValueError(
            f"from_mixture: {n} means and {len(covariances)} covariances; give one of each for every component"
        )
    share = _weights("from_mixture", n, weights)
    p = np.zeros(grid.shape)
    for i in range(n):
        spread = _covariance(grid, f"from_mixture: covariance {i}", covariances[i])
        place = _place(grid, f"from_mixture: mean {i}", means[i], np.sqrt(np.diag(spread)))
        p += share[i] * _gaussian(grid, place, spread)
    return _normalised(p)


def from_particles(
    grid: Grid,
    xy: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    bandwidth: float | Sequence[float] | None = None,
) -> Array:
    """Particles, shape (N, ndim), each spread by a Gaussian of `bandwidth` (unit; one, or one for each axis) within the grid.

    Without a bandwidth Scott's rule chooses it: the standard deviation times n ** (-1 / (ndim + 4)) along each axis, n being the
    effective number of particles, 1 / sum of squared weights. `weights` [default: equal] in any scale. Particles outside the grid are
    left out, unless all are.
    """
    points = np.asarray(xy, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != grid.ndim or not len(points):
        raise ValueError(f"from_particles: particles of shape {points.shape}; give (N, {grid.ndim}) with N above 0")
    share = _weights("from_particles", len(points), weights)
    inside = _inside(grid, points)
    if not (share[inside] > 0).any() or not np.isfinite(points).all():
        _check_inside(grid, "from_particles: particle", points)
    points, share = points[inside], share[inside] / share[inside].sum()
    if bandwidth is None:
        spread = np.sqrt(share @ (points - share @ points) ** 2)
        sigmas = spread * float(1.0 / (share @ share)) ** (-1.0 / (grid.ndim + 4))
    else:
        sigmas = np.broadcast_to(np.asarray(bandwidth, dtype=np.float64), (grid.ndim,))
        if not (np.isfinite(sigmas).all() and (sigmas > 0).all()):
            raise ValueError(f"from_particles: bandwidth {bandwidth} must be positive")
    sigmas = np.maximum(sigmas, NARROWEST * grid.cell)
    p = np.zeros((grid.shape[0], grid.size // grid.shape[0]))
    for first in range(0, len(points), PARTICLES):
        some = slice(first, first + PARTICLES)
        axes = [_spread(grid, axis, points[some, axis], float(sigmas[axis])) for axis in range(grid.ndim)]
        rest = np.ones((len(axes[0]), 1))
        for other in axes[1:]:
            rest = (rest[:, :, None] * other[:, None, :]).reshape(len(other), -1)
        p += (axes[0] * share[some, None]).T @ rest
    return _normalised(p.reshape(grid.shape))


def from_range_bearing(
    grid: Grid,
    position: npt.ArrayLike,
    heading: float,
    *,
    distance: float | None = None,
    bearing: float | None = None,
    distance_sigma: float = 0.0,
    bearing_sigma: float = 0.0,
    heading_sigma: float = 0.0,
    position_sigma: float = 0.0,
) -> Array:
    """Where something is that a robot at `position` with `heading` sees at a distance and a bearing (0: ahead), on a grid of 2 axes.

    Without a bearing it is a ring, without a distance a ray. Before, every place was as likely as another, so the mass is in
    proportion to the likelihood. The errors are independent and Gaussian; that of the robot's own position is equal on both
    axes. Where the subject is seen outside the grid, the mass is everywhere the same.
    """
    here = _place(grid, "from_range_bearing: position", position, np.full(2, position_sigma))
    if grid.ndim != 2:
        raise ValueError(f"from_range_bearing: a grid of {grid.ndim} axes; it needs 2")
    if distance is None and bearing is None:
        raise ValueError("from_range_bearing: neither distance nor bearing; give one at least")
    _check_given(
        heading=heading, distance=distance, bearing=bearing, distance_sigma=distance_sigma, bearing_sigma=bearing_sigma,
        heading_sigma=heading_sigma, position_sigma=position_sigma,
    )  # fmt: skip
    least = NARROWEST * grid.cell
    along = max(math.hypot(distance_sigma, position_sigma), least)

    def log_density(x: Array) -> Array:
        dx, dy = x[..., 0] - here[0], x[..., 1] - here[1]
        far = np.hypot(dx, dy)
        density = np.zeros(far.shape)
        if distance is not None:
            density = density - 0.5 * ((far - distance) / along) ** 2  # ln N(z; |x - x_r|, sigma)
        if bearing is not None:
            off = wrap(np.arctan2(dy, dx) - heading - bearing)
            across = np.maximum(far, least)  # a bearing is less exact than a cell near the robot
            sigma = np.sqrt(bearing_sigma**2 + heading_sigma**2 + (max(position_sigma, least) / across) ** 2)
            density = density - 0.5 * (off / sigma) ** 2 - np.log(sigma)
        return np.asarray(density)

    if distance is not None:
        direction = None if bearing is None else heading + bearing
        if not _reaches(grid, here, distance, direction, along, math.hypot(bearing_sigma, heading_sigma)):
            return np.full(grid.shape, 1.0 / grid.size)
    return _normalised(_integrated(grid, log_density, least))


def _check_given(**told: float | None) -> None:
    for name, value in told.items():
        if value is not None and (not math.isfinite(value) or (value < 0 and name not in ("heading", "bearing"))):
            raise ValueError(
                f"from_range_bearing: {name} {value}; give a finite number" + " of at least 0" * (value < 0)
            )


def _reaches(
    grid: Grid, here: Array, distance: float, direction: float | None, along: float, angle_sigma: float
) -> bool:
    """Whether anything of the grid is at a distance, and where it is known in a direction (radians), within FURTHEST sigmas.

    `along` is the sigma of the distance, in unit.
    """
    x, y = grid.mesh()
    if direction is None:
        reach, off = along, float(np.abs(np.hypot(x - here[0], y - here[1]) - distance).min())
    else:
        seen = here + distance * np.array([math.cos(direction), math.sin(direction)])
        reach, off = max(along, distance * angle_sigma), float(np.hypot(x - seen[0], y - seen[1]).min())
    return off <= FURTHEST * reach + grid.cell


def from_occupancy(
    grid: Grid, values: npt.ArrayLike, *, source: Grid | None = None, unknown: float = 50.0, free: bool = False
) -> Array:
    """The mass of each cell in proportion to its occupancy, 0 to 100, or with `free` to 100 less it; -1 counts as `unknown`.

    As in nav_msgs/OccupancyGrid, but indexed [ix, iy]: `np.reshape(data, (height, width)).T`. `source` is its own grid where that
    is another one than `grid`.
    """
    own = source or grid
    cells = np.asarray(values, dtype=np.float64)
    if cells.shape != own.shape:
        raise ValueError(
            f"from_occupancy: values of shape {cells.shape} on a grid of {own.shape}; give one for each cell"
        )
    wrong = ~((cells == -1) | ((cells >= 0) & (cells <= 100)))
    if wrong.any():
        cell = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise ValueError(
            f"from_occupancy: cell {cell} holds {cells[cell]:g}; give 0 to 100, or -1 where it is not known"
        )
    known = np.where(cells == -1, unknown, cells)
    p = _normalised(100.0 - known if free else known)
    return p if own is grid else resampled(own, p, grid)


def resampled(old: Grid, p: Array, grid: Grid, lost: float = 0.01) -> Array:
    """A belief on another grid of the same frame and unit: each cell's mass goes to those that it overlaps, evenly over its volume.

    ValueError where more than the share `lost` of the mass is outside the other grid; of less, the rest is normalised.
    """
    if (old.ndim, old.unit) != (grid.ndim, grid.unit):
        raise ValueError(f"resampled: from {old.ndim} axes in {old.unit} to {grid.ndim} in {grid.unit}")
    if old.frame and grid.frame and old.frame != grid.frame:
        raise ValueError(f"resampled: from frame {old.frame!r} to {grid.frame!r}; transform it first")
    before = math.fsum(p.ravel())
    for axis in range(old.ndim):
        edges = [g.origin[axis] + np.arange(g.shape[axis] + 1) * g.cell for g in (grid, old)]
        low = np.maximum(edges[0][:-1, None], edges[1][None, :-1])
        high = np.minimum(edges[0][1:, None], edges[1][None, 1:])
        share = np.clip(high - low, 0.0, None) / old.cell  # of each old cell in each new one
        p = np.moveaxis(np.tensordot(share, p, axes=(1, axis)), 0, axis)
    outside = 1.0 - math.fsum(p.ravel()) / before
    if outside > lost:
        raise ValueError(
            f"resampled: {outside:.1%} of the mass is outside the grid, which is {_extent(grid)}; at most {lost:.1%} may be"
        )
    return _normalised(p)


# --- integrals over cells --------------------------------------------------------------------------------------------------


def _gaussian(grid: Grid, mean: Array, covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    sigmas = np.maximum(np.sqrt(np.clip(values, 0.0, None)), NARROWEST * grid.cell)
    whiten = vectors / sigmas

    def log_density(x: Array) -> Array:
        return np.asarray(-0.5 * (((x - mean) @ whiten) ** 2).sum(axis=-1))

    return _normalised(_integrated(grid, log_density, float(sigmas.min())))


def _integrated(grid: Grid, log_density: Callable[[Array], Array], finest: float) -> Array:
    """The integral over each cell of exp(log_density), relative to some number; `finest` is the smallest width to resolve, in unit.

    `log_density` takes points of shape (..., ndim).
    """
    centres = np.stack(np.broadcast_arrays(*grid.mesh()), axis=-1).reshape(-1, grid.ndim)
    log = log_density(centres)
    top = log.max()
    cells: Array = np.exp(log - top)
    nodes, weights = _rule(grid.ndim, int(np.clip(math.ceil(2 * grid.cell / finest), 3, 8)))
    near = np.flatnonzero(log > top - NEGLIGIBLE)
    step = max(1, CHUNK // len(nodes))
    for first in range(0, len(near), step):
        some = near[first : first + step]
        points = centres[some, None, :] + nodes * grid.cell
        cells[some] = np.exp(log_density(points) - top) @ weights
    return cells.reshape(grid.shape)


@lru_cache(maxsize=16)
def _rule(ndim: int, n: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes of a cell of edge 1 around 0, shape (n ** ndim, ndim), and their weights, which sum to 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    return np.array(list(product(x / 2, repeat=ndim))), np.array([math.prod(ws) for ws in product(w / 2, repeat=ndim)])


def _spread(grid: Grid, axis: int, x: Array, sigma: float) -> Array:
    """How much of a Gaussian around each x falls into each cell of an axis, shape (N, shape[axis]); rows sum to 1."""
    edges = grid.origin[axis] + np.arange(grid.shape[axis] + 1) * grid.cell
    at, below = _normal()
    share = np.diff(np.interp((edges[None, :] - x[:, None]) / sigma, at, below), axis=1)
    return np.asarray(share / share.sum(axis=1, keepdims=True))


@lru_cache(maxsize=1)
def _normal() -> tuple[Array, Array]:
    """The normal distribution function as a table; between two entries a straight line is off by less than 1e-7."""
    at = np.linspace(-REACH, REACH, 16001)
    return at, np.array([0.5 * math.erfc(-z / math.sqrt(2)) for z in at])


# --- what is wrong with what was given --------------------------------------------------------------------------------------


def _place(grid: Grid, what: str, given: npt.ArrayLike, sigmas: Array) -> Array:
    place = np.asarray(given, dtype=np.float64)
    if place.shape != (grid.ndim,):
        raise ValueError(f"{what} of shape {place.shape}; give {grid.ndim} coordinates")
    _check_inside(grid, what, place[None], np.where(sigmas > 0, FURTHEST * sigmas + grid.cell, 0.0), number=False)
    return place


def _inside(grid: Grid, points: Array, beyond: npt.ArrayLike = 0.0) -> npt.NDArray[np.bool_]:
    """Which points are on the grid, or `beyond` its border by so much along each axis at most; a NaN is on no grid."""
    low, high = np.transpose(_borders(grid))
    return np.asarray(((points >= low - beyond) & (points <= high + beyond)).all(axis=1))


def _check_inside(grid: Grid, what: str, points: Array, beyond: npt.ArrayLike = 0.0, *, number: bool = True) -> None:
    inside = _inside(grid, points, beyond)
    if not inside.all():
        i = int(np.argmin(inside))
        name = f"{what} {i} at" if number else what
        raise ValueError(f"{name} {_shown(points[i])} is outside the grid, which is {_extent(grid)}")


def _covariance(grid: Grid, what: str, given: npt.ArrayLike) -> Array:
    c = np.asarray(given, dtype=np.float64)
    if c.shape != (grid.ndim, grid.ndim):
        raise ValueError(f"{what} of shape {c.shape}; give ({grid.ndim}, {grid.ndim})")
    if not np.isfinite(c).all():
        i, j = np.argwhere(~np.isfinite(c))[0]
        raise ValueError(f"{what}: entry ({i}, {j}) is {c[i, j]}; give finite numbers")
    largest = np.abs(c).max()
    if np.abs(c - c.T).max() > WRONG * largest:
        i, j = np.unravel_index(int(np.abs(c - c.T).argmax()), c.shape)
        raise ValueError(f"{what} is not symmetric: ({i}, {j}) is {c[i, j]:g}, ({j}, {i}) is {c[j, i]:g}")
    least = float(np.linalg.eigvalsh((c + c.T) / 2).min())
    if least < -WRONG * largest:
        raise ValueError(f"{what} has the negative eigenvalue {least:g}; no direction can have a negative variance")
    return np.asarray((c + c.T) / 2)


def _weights(what: str, n: int, given: npt.ArrayLike | None) -> Array:
    w = np.ones(n) if given is None else np.asarray(given, dtype=np.float64)
    if w.shape != (n,):
        raise ValueError(f"{what}: weights of shape {w.shape}; give ({n},)")
    wrong = ~(np.isfinite(w) & (w >= 0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ValueError(f"{what}: weight {i} is {w[i]}; give finite numbers of at least 0")
    if not w.max() > 0:
        raise ValueError(f"{what}: all weights are 0")
    w = w / w.max()
    return np.asarray(w / w.sum())


def _normalised(p: Array) -> Array:
    total = math.fsum(p.ravel())
    if not total > 0:
        raise ValueError("no cell holds any mass")
    return np.asarray(p / total)


def _borders(grid: Grid) -> list[tuple[float, float]]:
    return [(low, low + n * grid.cell) for low, n in zip(grid.origin, grid.shape, strict=True)]


def _extent(grid: Grid) -> str:
    return " by ".join(f"{low:g} to {high:g}" for low, high in _borders(grid))


def _shown(place: Array) -> str:
    return f"({', '.join(f'{x:g}' for x in place)})"
