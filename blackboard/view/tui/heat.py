"""A map of beliefs for a terminal: colours of character cells, two of the map in each, and letters on them. Pure."""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Grid
from blackboard.state.moments import Moment, Point
from blackboard.state.received import STEP, Drawn
from blackboard.wire.gaussians import pose_of

BACK = (13, 17, 23)
#: Okabe and Ito's orange, sky, green, pink and yellow, brighter where they are too faint on black, and three that differ from them.
COLOURS = (
    (230, 159, 0), (86, 180, 233), (0, 178, 131), (224, 122, 184), (240, 228, 66), (232, 80, 58), (154, 123, 255),
    (196, 204, 212),
)  # fmt: skip
ARROWS = "→↗↑↖←↙↓↘"  # where a robot heads, by eighths of a turn
FADE = 0.6  # share of its colour that a belief keeps which is not chosen

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Heat:
    """`pixels` has shape (2 rows, columns, 3), the upper edge first; `marks` are letters by row and column of characters."""

    pixels: Pixels
    marks: dict[tuple[int, int], str] = field(default_factory=dict)


def colour(number: int) -> tuple[int, int, int]:
    """The colour of a subject by its place among all."""
    return COLOURS[number % len(COLOURS)]


def heat(moment: Moment, grid: Grid, chosen: str, rows: int, columns: int, log: bool) -> Heat:
    """All agreed beliefs on the whole grid, undistorted where a character is twice as high as wide; truths are crosses.

    What is not sure to be there is fainter.

    Where the map is smaller than the grid, a pixel shows the largest of its cells, so that a sharp peak does not vanish.
    """
    scale = min(columns / grid.shape[0], 2 * rows / grid.shape[1])  # pixels for a cell
    width, height = max(1, int(grid.shape[0] * scale)), max(1, int(grid.shape[1] * scale))
    colours = np.tile(np.array(BACK, float), (2 * ((height + 1) // 2), width, 1))
    marks: dict[tuple[int, int], str] = {}
    for number, (name, about) in enumerate(moment.subjects.items()):
        drawn = None if about.best is None else about.best.drawn
        if drawn is not None:
            fade = about.share * (1.0 if name == chosen or not chosen else FADE)
            share = _shares(drawn, grid, width, height, log)[..., None] * fade
            colours[:height] = colours[:height] * (1 - share) + np.array(colour(number)) * share
            row, column = _at((drawn.mean[0], drawn.mean[1]), grid, width, height)
            if (pose := pose_of(None if about.best is None else about.best.message.state)) is not None:
                marks[row // 2, column + 1] = ARROWS[round(4 * float(pose.mean[HEADING]) / math.pi) % 8]
            for k, letter in enumerate(name.split("/", 1)[1][:6]):
                marks[row // 2, column + 2 + k] = letter
    for about in moment.subjects.values():
        if about.truth is not None:
            row, column = _at(about.truth, grid, width, height)
            marks[row // 2, column] = "×"
    return Heat(colours.astype(np.uint8), {at: letter for at, letter in marks.items() if at[1] < columns})


def _shares(drawn: Drawn, grid: Grid, width: int, height: int, log: bool) -> npt.NDArray[np.float64]:
    """How much of its colour a belief puts on each pixel, 0 to 1, shape (height, width); the upper edge first."""
    whole = np.zeros(grid.shape)
    levels = np.frombuffer(drawn.levels, np.uint8).reshape(drawn.box).astype(float)
    shade = levels / 255.0 if log else np.where(levels > 0, np.exp((levels - 255.0) * STEP), 0.0)
    (i, j), (n, m) = drawn.lo, drawn.box
    whole[i : i + n, j : j + m] = shade
    rows = _pooled(_pooled(whole, width, 0), height, 1)
    return np.asarray(rows.T[::-1], float)


def _pooled(cells: npt.NDArray[np.float64], size: int, axis: int) -> npt.NDArray[np.float64]:
    """An axis in `size` pixels: each the largest of its cells, or the cell that it lies in."""
    count = cells.shape[axis]
    if size >= count:
        return np.asarray(np.take(cells, np.arange(size) * count // size, axis))
    return np.asarray(np.maximum.reduceat(cells, np.arange(size) * count // size, axis))


def _at(place: Point, grid: Grid, width: int, height: int) -> tuple[int, int]:
    """The pixel of a place: row from the upper edge, and column."""
    x, y = ((at - low) / (grid.cell * n) for at, low, n in zip(place, grid.origin, grid.shape, strict=True))
    column = min(width - 1, max(0, math.floor(x * width)))
    return min(height - 1, max(0, height - 1 - math.floor(y * height))), column
