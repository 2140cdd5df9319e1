"""A belief as bytes and back: cropped to its support, logarithms in one byte per cell, the mass left out spread evenly.

Coding "log8" (docs/wire.md): a cell of probability p becomes the level b = round(255 + ln(p / peak) / step), where b <= 0
means "in the rest". Read back, the kept cells share 1 - rest in the proportion exp((b - 255) step), and the cells of the
rest share `rest` evenly.

What is lost, with step = 0.05 nats, so that 254 levels reach 12.7 nats below the peak:
- a kept cell is off by a factor of at most exp(step / 2) before its share is normalised, exp(step) in the end;
- the total variation between a belief and what is read back is at most step / 4 + (the mass left out), and each cell left
  out held less than exp(-254.5 step) = 3e-6 of the peak;
- a zero comes back as zero where nothing else was left out, and otherwise as the even floor.

Reading is deterministic, and unpack(pack(b)) of a b that came from `pack` is b to the bit, so robots may compare beliefs.
"""

from __future__ import annotations

import math
import zlib
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError, Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.messages import MAX_CELLS, PackedBelief, PackedGrid

Levels = npt.NDArray[np.uint8]

STEP = 0.05  # nats between two levels
TOP = 255  # the level of the likeliest cell
MAX_STEP = 1.0  # nats; level 1 is then e-111 of the peak, far from underflow
COMPRESSION = 6  # zlib level


def pack(belief: Belief) -> PackedBelief:
    """A belief in the coding "log8". One of ours that is no probability grid raises OpinionError."""
    levels = _levels(belief)
    lo, box = _support(levels)
    cropped = levels[_slices(lo, box)].ravel()
    grid = belief.grid
    return PackedBelief(
        grid=packed_grid(grid),
        lo=lo,
        box=box,
        step=STEP,
        rest=_rest(belief.p[levels == 0], cropped),
        data=zlib.compress(np.diff(cropped, prepend=np.uint8(0)).tobytes(), COMPRESSION),
    )


def packed_grid(grid: Grid) -> PackedGrid:
    """A grid as a message names it, without its anchor."""
    return PackedGrid(shape=grid.shape, cell=grid.cell, origin=grid.origin, unit=grid.unit, frame=grid.frame)


def unpacked_grid(packed: PackedGrid) -> Grid:
    """The grid that a message names; Refused "fields": it is none, or too large."""
    if len(packed.shape) != len(packed.origin) or math.prod(packed.shape) > MAX_CELLS:
        raise Refused("fields", f"a grid of {packed.shape} from {packed.origin}; at most {MAX_CELLS} cells are taken")
    return _grid(tuple(packed.shape), packed.cell, tuple(packed.origin), packed.unit, packed.frame)


@lru_cache(maxsize=64)
def _grid(shape: tuple[int, ...], cell: float, origin: tuple[float, ...], unit: str, frame: str) -> Grid:
    """Made once: every belief of a team names the same."""
    return Grid(shape, cell, origin, unit, frame)


def unpack(packed: PackedBelief, grid: Grid | None = None) -> Belief:
    """The belief of a message in either coding, normalised; on `grid` if one is given.

    Refused: "fields" (the parts do not fit together), "grid" (another grid than `grid`), "frame" (both name one, and another),
    "mass" (no probabilities).
    """
    own = _own_grid(packed)
    if grid is not None:
        if (own.shape, own.cell, own.origin, own.unit) != (grid.shape, grid.cell, grid.origin, grid.unit):
            raise Refused("grid", f"a belief on {_told(own)}, the team's is {_told(grid)}")
        if own.frame and grid.frame and own.frame != grid.frame:
            raise Refused("frame", f"a belief in frame {own.frame!r}, the team's is {grid.frame!r}")
        own = grid
    cells = _cells(packed)
    weights, total = _weights(packed, cells)
    kept = weights > 0
    left = own.size - int(np.count_nonzero(kept))
    rest = packed.rest
    if not 0 <= rest <= 1 or (rest > 0 and not left):
        raise Refused("mass", f"rest {rest} is no probability mass for {left} cells")
    if not total and not rest:
        raise Refused("mass", "no probability mass at all")
    if not total:  # no cell is kept: nothing is known
        rest = total = 1.0
    p = np.full(own.shape, rest / left if rest else 0.0)
    np.multiply(weights, (1.0 - rest) / total, out=p[_slices(packed.lo, packed.box)], where=kept)
    return Belief(own, p)


# --- writing -----------------------------------------------------------------------------------------------------------


def _levels(belief: Belief) -> Levels:
    """The level of each cell, 0..255, in the shape of the grid."""
    p = belief.p
    peak = p.max()
    if p.shape != belief.grid.shape or not (math.isfinite(peak) and peak > 0 and p.min() >= 0):
        raise OpinionError(
            f"a belief to pack: shape {p.shape} on a grid of {belief.grid.shape}, cells from {p.min()} to {peak}"
        )
    below = np.log(np.maximum(p / peak, math.exp(-TOP * STEP))) / STEP
    levels: Levels = (TOP + 0.5 + below).astype(np.uint8)  # the cast rounds down
    return levels


def _support(levels: Levels) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The lower corner and the shape of the smallest box around all cells above level 0."""
    axes = range(levels.ndim)
    hits = [np.flatnonzero(levels.any(axis=tuple(a for a in axes if a != axis))) for axis in axes]
    return tuple(int(h[0]) for h in hits), tuple(int(h[-1] - h[0]) + 1 for h in hits)


def _rest(left: Array, levels: Levels) -> float:
    """The mass left out, as a float32: recomputed from what was read back it is the same number again."""
    if not left.size:
        return 0.0
    rest = float(left.sum())
    peak = (1.0 - rest) / _total(_table(STEP), levels)  # as it will be read
    if rest / left.size > peak * math.exp((0.4 - TOP) * STEP):  # the floor would round up to level 1
        rest = left.size * peak * math.exp(-TOP * STEP)
    return float(np.float32(rest))


# --- reading -----------------------------------------------------------------------------------------------------------


def _own_grid(packed: PackedBelief) -> Grid:
    """The grid that the message names, with its box inside of it; Refused "fields"."""
    shape, lo, box = packed.grid.shape, packed.lo, packed.box
    if not len(shape) == len(packed.grid.origin) == len(lo) == len(box):
        raise Refused("fields", f"shape {shape}, origin {packed.grid.origin}, lo {lo} and box {box} differ in length")
    if math.prod(shape) > MAX_CELLS:
        raise Refused("fields", f"a grid of {shape} has more than {MAX_CELLS} cells")
    if not all(a >= 0 and n >= 1 and a + n <= size for a, n, size in zip(lo, box, shape, strict=True)):
        raise Refused("fields", f"a box of {box} from {lo} is not inside a grid of {shape}")
    return unpacked_grid(packed.grid)


def _told(grid: Grid) -> str:
    return f"{grid.shape} cells of {grid.cell:g} {grid.unit} from {grid.origin}"


def _cells(packed: PackedBelief) -> npt.NDArray[Any]:
    """The data as an array of shape `box`: levels ("log8") or masses ("f32"); Refused "fields"."""
    size = math.prod(packed.box)
    if packed.coding == "f32":
        if len(packed.data) != 4 * size:
            raise Refused("fields", f"{len(packed.data)} bytes of data for {size} cells of 4 bytes")
        return np.frombuffer(packed.data, "<f4").reshape(packed.box)
    if not 0 < packed.step <= MAX_STEP:
        raise Refused("fields", f"step {packed.step} is not above 0 and at most {MAX_STEP} nats")
    return np.cumsum(np.frombuffer(_inflate(packed.data, size), np.uint8), dtype=np.uint8).reshape(packed.box)


def _inflate(data: bytes, size: int) -> bytes:
    """What zlib holds, `size` bytes exactly; never more than one byte beyond is produced, whatever the data are."""
    stream = zlib.decompressobj()
    try:
        inflated = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise Refused("fields", f"data is not zlib ({error})") from None
    if len(inflated) != size or not stream.eof or stream.unused_data:
        raise Refused("fields", f"data does not inflate to {size} bytes, one for each cell of the box")
    return inflated


def _weights(packed: PackedBelief, cells: npt.NDArray[Any]) -> tuple[Array, float]:
    """What the cells of the box hold in proportion, 0 for "in the rest", and the sum of it; Refused "mass"."""
    if packed.coding == "log8":
        table = _table(packed.step)
        return table[cells], _total(table, cells)
    if not np.isfinite(cells).all() or cells.min() < 0:
        raise Refused("mass", "a cell holds NaN, infinite or negative mass")
    weights = cells.astype(np.float64)
    return weights, float(weights.sum())


# --- both --------------------------------------------------------------------------------------------------------------


def _slices(lo: tuple[int, ...], box: tuple[int, ...]) -> tuple[slice, ...]:
    return tuple(slice(a, a + n) for a, n in zip(lo, box, strict=True))


@lru_cache(maxsize=8)
def _table(step: float) -> Array:
    """Level -> mass relative to the peak's, shape (256,)."""
    table: Array = np.exp((np.arange(TOP + 1) - TOP) * step)
    table[0] = 0.0
    table.flags.writeable = False
    return table


def _total(table: Array, levels: Levels) -> float:
    """The sum of all cells' relative masses, correctly rounded, so that it depends on no order."""
    return math.fsum((table * np.bincount(levels.ravel(), minlength=TOP + 1)).tolist())
