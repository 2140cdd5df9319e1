"""Windows: boxes of cells of a grid with two axes, so that work is done only where something is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from blackboard.opinion.grid import Array, Grid


class Window(NamedTuple):
    """The cells (ix, iy) with x0 <= ix < x1 and y0 <= iy < y1; `holds` and `hull` take windows that are not empty."""

    x0: int
    x1: int
    y0: int
    y1: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def slices(self) -> tuple[slice, slice]:
        """To read its cells from an array on the grid."""
        return slice(self.x0, self.x1), slice(self.y0, self.y1)

    def within(self, outer: Window) -> tuple[slice, slice]:
        """To read its cells from an array on a window that holds it."""
        return slice(self.x0 - outer.x0, self.x1 - outer.x0), slice(self.y0 - outer.y0, self.y1 - outer.y0)

    def holds(self, other: Window) -> bool:
        return self.x0 <= other.x0 and other.x1 <= self.x1 and self.y0 <= other.y0 and other.y1 <= self.y1

    def hull(self, other: Window) -> Window:
        """The least window that holds both."""
        return Window(min(self.x0, other.x0), max(self.x1, other.x1), min(self.y0, other.y0), max(self.y1, other.y1))

    def meet(self, other: Window) -> Window:
        """The cells of both; a window of shape 0 where there are none."""
        x0, y0 = max(self.x0, other.x0), max(self.y0, other.y0)
        return Window(x0, max(x0, min(self.x1, other.x1)), y0, max(y0, min(self.y1, other.y1)))

    def grown(self, cells: int, shape: Sequence[int]) -> Window:
        """With `cells` more to each side, as far as a grid of `shape` has them."""
        return Window(
            max(0, self.x0 - cells),
            min(shape[0], self.x1 + cells),
            max(0, self.y0 - cells),
            min(shape[1], self.y1 + cells),
        )


def whole(shape: Sequence[int]) -> Window:
    """All cells of a grid."""
    return Window(0, shape[0], 0, shape[1])


def bounds(held: Array) -> Window:
    """The least window that holds all cells where `held` (bool, shape (nx, ny)) is true; all cells where it is nowhere."""
    x, y = (np.flatnonzero(held.any(axis=axis)) for axis in (1, 0))
    return Window(int(x[0]), int(x[-1]) + 1, int(y[0]), int(y[-1]) + 1) if len(x) else whole(held.shape)


def around(grid: Grid, centre: Sequence[float], reach: Sequence[float]) -> Window:
    """All cells whose centres lie within `reach` (unit, for each axis) of a point, or a cell more; of shape 0 off the grid."""
    ends = []
    for axis in (0, 1):
        at, n = (centre[axis] - grid.origin[axis]) / grid.cell - 0.5, grid.shape[axis]  # the centre of cell 0 is at 0
        for end in (at - reach[axis] / grid.cell, at + reach[axis] / grid.cell + 2):
            ends.append(int(min(max(end, 0.0), n)))
    return Window(*ends)


def embedded(p: Array, inner: Window, outer: Window, fill: float) -> Array:
    """`p` of a window, as an array on a window that holds it, with `fill` in the other cells; `p` itself where both are the same."""
    if inner == outer:
        return p
    out = np.full(outer.shape, fill)
    out[inner.within(outer)] = p
    return out
