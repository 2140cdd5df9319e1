"""The grid of a recording, which holds all that was recorded."""

import math
from typing import Any

from blackboard.opinion.grid import Array, Grid

MARGIN = 2.0  # around all places, in their unit (m)
CELLS = 120  # of the grid along its longer edge


def grid_around(places: Array) -> dict[str, Any]:
    """Shape, cell and origin of a grid that holds some places, shape (n, 2), with a margin: for the table [grid]."""
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    cell = float((high - low).max()) / CELLS
    return {
        "shape": [max(2, math.ceil(edge / cell)) for edge in (high - low).tolist()],
        "cell": cell,
        "origin": low.tolist(),
    }


def holds(grid: Grid, places: Array) -> bool:
    """Whether all places, shape (n, 2), are on a grid."""
    if not len(places):
        return True
    return all(grid.index(corner) is not None for corner in (places.min(axis=0).tolist(), places.max(axis=0).tolist()))
