"""Where opinions live: a regular grid of equal cells.

Axis i of an array is coordinate i of the world: a 2-D belief is `p[ix, iy]`. Cell 0 of an axis covers
[origin, origin + cell); the centre of cell i is origin + (i + 1/2) cell.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]  # of float64, unless said otherwise


@dataclass(frozen=True)
class Anchor:
    """Where a frame is on Earth: the place (degrees, WGS 84) of its point (0, 0), and the bearing of its x axis.

    The bearing is in degrees clockwise from true north: 0 where x points north, 90 where it points east.
    """

    latitude: float
    longitude: float
    bearing: float


@dataclass(frozen=True)
class Grid:
    """A regular grid: `shape` in cells, edge length `cell` and lower corner `origin` in `unit` ("cell" or "m").

    `frame` names the frame of its coordinates, as in ROS ("map"); empty: it has no name. `anchor` says where that frame is on
    Earth.
    """

    shape: tuple[int, ...]
    cell: float = 1.0
    origin: tuple[float, ...] = field(default=())
    unit: str = "cell"
    frame: str = ""
    anchor: Anchor | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        shape = tuple(int(n) for n in self.shape)
        origin = tuple(float(x) for x in self.origin) or (0.0,) * len(shape)
        if not shape or min(shape) < 1:
            raise ValueError(f"grid shape {self.shape}: every axis needs at least one cell")
        if not (math.isfinite(self.cell) and self.cell > 0):
            raise ValueError(f"grid cell {self.cell}: the edge of a cell must be positive")
        if len(origin) != len(shape) or not all(math.isfinite(x) for x in origin):
            raise ValueError(f"grid origin {self.origin}: needs one finite coordinate for each of {len(shape)} axes")
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "cell", float(self.cell))

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of cells, the paper's m."""
        return math.prod(self.shape)

    @property
    def volume(self) -> float:
        """Length, area or volume of one cell (v_cell), in unit ** ndim."""
        return self.cell**self.ndim

    def centres(self, axis: int) -> Array:
        """Coordinates of the cell centres along one axis, shape (shape[axis],)."""
        return self.origin[axis] + (np.arange(self.shape[axis]) + 0.5) * self.cell

    def mesh(self) -> tuple[Array, ...]:
        """The centres of all axes, shaped to broadcast against an array on this grid; read-only, because they are kept."""
        return _mesh(self)

    def index(self, point: Sequence[float]) -> tuple[int, ...] | None:
        """The cell that holds a point, or None outside the grid."""
        cells = tuple(math.floor((x - o) / self.cell) for x, o in zip(point, self.origin, strict=True))
        return cells if all(0 <= i < n for i, n in zip(cells, self.shape, strict=True)) else None

    def centre(self, index: Sequence[int]) -> Array:
        """The centre of a cell, shape (ndim,)."""
        return np.asarray(self.origin) + (np.asarray(index) + 0.5) * self.cell


@lru_cache(maxsize=64)
def _mesh(grid: Grid) -> tuple[Array, ...]:
    axes = np.meshgrid(*(grid.centres(axis) for axis in range(grid.ndim)), indexing="ij", sparse=True)
    for centres in axes:
        centres.flags.writeable = False
    return tuple(axes)
