"""A belief as bytes and back: cropped to its support, its logarithm in whole levels, the mass left out spread evenly.

Codings "log8" and "log16" (docs/bytes.md): a cell of probability p becomes the level b = round(top + ln(p / peak) / step), where
b <= 0 means "in the rest". Read back, the kept cells share 1 - rest in the proportion exp(b step), and the cells of the rest share
`rest` evenly.

What is lost, with the step of a coding ("log8": 0.05 nats and 255 levels; "log16": 0.025 nats and 510 levels; both reach 12.7 nats
below the peak):
- a kept cell is off by a factor of at most exp(step / 2) before its share is normalised, exp(step) in the end;
- the total variation between a belief and what is read back is at most step / 4 + (the mass left out), and each cell left
  out held less than 3e-6 of the peak;
- a zero comes back as zero where nothing else was left out, and otherwise as the even floor.

Reading is deterministic, and unpack(pack(b)) of a b that came from `pack` in the same coding is b to the bit, so robots may compare
beliefs.
"""

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError, Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.wire import levels as coded
from blackboard.wire.levels import Coding, Levels
from blackboard.wire.messages import MAX_CELLS, PackedBelief, PackedGrid

NEWEST = 1 << 19  # cells of beliefs that are kept, in 4 MiB
STEP = 0.05  # nats between two levels of "log8"
MAX_STEP = 1.0  # nats; level 1 of "log8" is then e-254 of the peak, far from underflow


@dataclass(frozen=True)
class Scale:
    """The levels that are written in a coding: nats between two of them, and the level of the likeliest cell."""

    step: float
    top: int


SCALES: dict[str, Scale] = {"log8": Scale(STEP, 255), "log16": Scale(STEP / 2, 510)}


def pack(belief: Belief, coding: Coding = "log8") -> PackedBelief:
    """A belief in a coding. One of ours that is no probability grid raises OpinionError.

    Not every member of a team reads "log16" (docs/bytes.md).
    """
    scale = SCALES[coding]
    peak, lo, levels = _levels(belief, scale, coded.KIND[coding])
    return PackedBelief(
        grid=packed_grid(belief.grid),
        lo=lo,
        box=levels.shape,
        coding=coding,
        step=scale.step,
        rest=_rest(belief.p, peak, lo, levels, scale),
        data=coded.written(levels.ravel()),
    )


@lru_cache(maxsize=64)
def packed_grid(grid: Grid) -> PackedGrid:
    """A grid as a message names it, without its anchor; made once, because every belief of a team names the same."""
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
    """The belief of a message in either coding, normalised; on `grid` if one is given. It is shared, so its array is read-only.

    Refused: "fields" (the parts do not fit together), "grid" (another grid than `grid`), "frame" (both name one, and another),
    "mass" (no probabilities).
    """
    kept = _beliefs.get((packed, grid))
    if kept is None:
        kept = _beliefs[packed, grid] = _unpacked(packed, grid)
        _newest.append(kept)
        while len(_newest) > 1 and len(_newest) * kept.p.size > NEWEST:
            _newest.popleft()
    return kept


#: What is unpacked, for as long as somebody has it: in one process all who hear a message read it once. The newest are kept, because a
#: referee reads those of a tick once the next one has begun.
_beliefs: WeakValueDictionary[tuple[PackedBelief, Grid | None], Belief] = WeakValueDictionary()
_newest: deque[Belief] = deque()


def _unpacked(packed: PackedBelief, grid: Grid | None) -> Belief:
    own = _own_grid(packed)
    if grid is not None:
        if (own.shape, own.cell, own.origin, own.unit) != (grid.shape, grid.cell, grid.origin, grid.unit):
            raise Refused("grid", f"a belief on {_described(own)}, the team's is {_described(grid)}")
        if own.frame and grid.frame and own.frame != grid.frame:
            raise Refused("frame", f"a belief in frame {own.frame!r}, the team's is {grid.frame!r}")
        own = grid
    weights, cells, count, total = _weights(packed)
    left = own.size - count
    rest = packed.rest
    if not 0 <= rest <= 1 or (rest > 0 and not left):
        raise Refused("mass", f"rest {rest} is no probability mass for {left} cells")
    if not total and not rest:
        raise Refused("mass", "no probability mass at all")
    if not total:  # no cell is kept: nothing is known
        rest = total = 1.0
    floor = rest / left if rest else 0.0
    p = np.full(own.shape, floor)
    shares = np.where(weights > 0, weights * ((1.0 - rest) / total), floor)
    p[_slices(packed.lo, packed.box)] = (shares if cells is None else shares[cells]).reshape(packed.box)
    p.flags.writeable = False
    return Belief(own, p)


# --- writing -----------------------------------------------------------------------------------------------------------


def _levels(belief: Belief, scale: Scale, kind: npt.DTypeLike) -> tuple[float, tuple[int, ...], Levels]:
    """The peak, and the lower corner of the smallest box around all cells above level 0, with the levels of its cells."""
    p = belief.p
    peak = float(p.max())
    if p.shape != belief.grid.shape or not (math.isfinite(peak) and peak > 0 and p.min() >= 0):
        raise OpinionError(
            f"a belief to pack: shape {p.shape} on a grid of {belief.grid.shape}, cells from {p.min()} to {peak}"
        )
    kept = p > peak * math.exp((0.5 - scale.top) * scale.step)
    lo, box = support(kept)
    where = _slices(lo, box)
    inside, kept = p[where] / peak, kept[where]
    below = np.log(np.maximum(inside, math.exp(-scale.top * scale.step), out=inside), out=inside)
    below /= scale.step
    below += scale.top + 0.5
    levels = below.astype(kind)  # the cast rounds down
    np.maximum(levels, kept, out=levels)  # of one that is on the brink, `kept` decides
    levels *= kept
    return peak, lo, levels


def support(hits: npt.NDArray[np.bool_]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The lower corner and the shape of the smallest box around all hits, of which there is one at least."""
    spans: list[tuple[int, int]] = []
    for axis in range(hits.ndim):
        others = tuple(other for other in range(hits.ndim) if other != axis)
        filled = np.asarray(hits.any(axis=others)).nonzero()[0]
        spans.append((int(filled[0]), int(filled[-1]) + 1))
        hits = hits[(slice(None),) * axis + (slice(*spans[-1]),)]  # the other axes need not look elsewhere
    return tuple(a for a, _ in spans), tuple(b - a for a, b in spans)


def _rest(p: Array, peak: float, lo: tuple[int, ...], levels: Levels, scale: Scale) -> float:
    """The mass left out, as a float32: recomputed from what was read back it is the same number again."""
    own = levels == 0
    left = p.size - levels.size + int(np.count_nonzero(own))
    if not left:
        return 0.0
    rest = _outside(p, lo, levels.shape) + float(p[_slices(lo, levels.shape)][own].sum())
    # As it is read, the peak is less than a step off.
    if rest / left > peak * math.exp((0.4 - scale.top - 1.0) * scale.step):
        peak = (1.0 - rest) / _total(*_counted(levels, scale.step)[:2])  # as it will be read
        if rest / left > peak * math.exp((0.4 - scale.top) * scale.step):  # the floor would round up to level 1
            rest = left * peak * math.exp(-scale.top * scale.step)
    return float(np.float32(rest))


def _outside(p: Array, lo: tuple[int, ...], box: tuple[int, ...]) -> float:
    """The sum of all cells outside a box: nothing is subtracted, so that zeros make a zero."""
    total, inside = 0.0, p
    for axis, (a, n) in enumerate(zip(lo, box, strict=True)):
        before = (slice(None),) * axis
        for out in (slice(0, a), slice(a + n, None)):
            total += float(np.add.reduce(inside[(*before, out)], axis=None))
        inside = inside[(*before, slice(a, a + n))]
    return total


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


def _described(grid: Grid) -> str:
    return f"{grid.shape} cells of {grid.cell:g} {grid.unit} from {grid.origin}"


def _weights(packed: PackedBelief) -> tuple[Array, Levels | None, int, float]:
    """What the cells of the box hold in proportion, 0 for "in the rest"; how many hold something; the sum of it.

    Where the cells are given as levels, the first are the weights of the levels, and the second the levels of the cells.
    Refused: "fields", "mass".
    """
    size = math.prod(packed.box)
    if packed.coding == "f32":
        if len(packed.data) != 4 * size:
            raise Refused("fields", f"{len(packed.data)} bytes of data for {size} cells of 4 bytes")
        masses = np.frombuffer(packed.data, "<f4")
        if not np.isfinite(masses).all() or masses.min() < 0:
            raise Refused("mass", "a cell holds NaN, infinite or negative mass")
        weights = masses.astype(np.float64)
        return weights, None, int(np.count_nonzero(weights)), float(weights.sum())
    if not 0 < packed.step <= MAX_STEP:
        raise Refused("fields", f"step {packed.step} is not above 0 and at most {MAX_STEP} nats")
    levels = coded.read(packed.data, size, packed.coding)
    table, counts = _counted(levels, packed.step)
    return table, levels, size - int(counts[0]), _total(table, counts)


# --- both --------------------------------------------------------------------------------------------------------------


def _slices(lo: tuple[int, ...], box: tuple[int, ...]) -> tuple[slice, ...]:
    return tuple(slice(a, a + n) for a, n in zip(lo, box, strict=True))


def _counted(levels: Levels, step: float) -> tuple[Array, npt.NDArray[np.intp]]:
    """The weight of each level, up to the greatest that its coding has or that there is, and how many cells are at it."""
    least = 256 if levels.dtype == np.uint8 else int(levels.max()) + 1
    return _table(step, least), np.bincount(levels.ravel(), minlength=least)


@lru_cache(maxsize=8)
def _table(step: float, size: int) -> Array:
    """Level -> mass relative to the last one's, shape (size,); 0 for level 0."""
    table: Array = np.exp((np.arange(size) - (size - 1)) * step)
    table[0] = 0.0
    table.flags.writeable = False
    return table


def _total(table: Array, counts: npt.NDArray[np.intp]) -> float:
    """The sum of all cells' relative masses, correctly rounded, so that it depends on no order."""
    there = counts.nonzero()[0]
    return math.fsum((table[there] * counts[there]).tolist())
