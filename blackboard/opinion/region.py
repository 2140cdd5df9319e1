"""Highest-density regions: which cells are in one, and the polygons around them."""

import numpy as np
import numpy.typing as npt

from blackboard.opinion.grid import Array, Grid

Mask = npt.NDArray[np.bool_]
Corner = tuple[int, int]  # a corner of cells: (0, 0) is the lower corner of the grid


def least_inside(p: Array, share: float) -> float:
    """The least probability of a cell in the highest-density region of `share` of the mass (0 to 1).

    The region is every cell of which the strictly denser ones hold less than `share` (`blackboard.opinion.scores.hdr_level`).
    """
    densest = np.sort(p, axis=None)[::-1]
    sums = np.cumsum(densest)
    last = int(np.searchsorted(sums, share * sums[-1] * (1.0 - 1e-12)))
    return float(densest[min(last, len(densest) - 1)])


def polygons(grid: Grid, inside: Mask) -> list[Array]:
    """The borders of some cells of a grid of 2 axes, along their edges: closed rings in the grid's unit, shape (M, 2).

    The first point comes again as the last. Rings around cells run counter-clockwise, those around holes clockwise. Cells that
    touch in a corner alone are in different rings. ValueError: the grid has not 2 axes.
    """
    if grid.ndim != 2:
        raise ValueError(f"polygons: a grid of {grid.ndim} axes; only those of 2 have polygons")
    after = _edges(inside)
    rings = []
    while after:
        start = min(after)
        corner, way = start, after[start][0]
        ring = [start]
        while True:
            after[corner].remove(way)
            if not after[corner]:
                del after[corner]
            corner = (corner[0] + way[0], corner[1] + way[1])
            if corner == start:
                break
            turn = _sharpest(way, after[corner])
            if turn != way:
                ring.append(corner)
            way = turn
        rings.append(np.array([*ring, start]) * grid.cell + np.asarray(grid.origin))
    return rings


def _edges(inside: Mask) -> dict[Corner, list[Corner]]:
    """Corner -> the directions in which borders leave it; each border has the inside on its left."""
    full = np.pad(inside, 1)
    after: dict[Corner, list[Corner]] = {}
    # the outside neighbour of a cell, the corner at which the edge between them begins, and its direction
    for (dx, dy), (cx, cy), way in (
        ((0, -1), (0, 0), (1, 0)),
        ((1, 0), (1, 0), (0, 1)),
        ((0, 1), (1, 1), (-1, 0)),
        ((-1, 0), (0, 1), (0, -1)),
    ):
        border = inside & ~full[1 + dx : full.shape[0] - 1 + dx, 1 + dy : full.shape[1] - 1 + dy]
        for i, j in np.argwhere(border):
            after.setdefault((int(i) + cx, int(j) + cy), []).append(way)
    return after


def _sharpest(way: Corner, ways: list[Corner]) -> Corner:
    """Of the directions that leave a corner the one furthest to the left, so that cells that touch in a corner stay apart."""
    return max(ways, key=lambda w: way[0] * w[1] - way[1] * w[0])
