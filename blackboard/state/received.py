"""What was received about a subject, and how it is drawn: a box of bytes, its mean, its entropy and its 95 % region. Pure."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.region import least_inside
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus, PackedBelief, Report

DEPTH = 9.0  # nats below the peak that are drawn; the mass below that of a Gaussian is exp(-9)
STEP = DEPTH / 254  # nats between two levels: 255 is the peak, 1 the faintest cell that is drawn, 0 is not drawn
REGION = 0.95

M = TypeVar("M", bound=Report | Consensus)


@dataclass(frozen=True)
class Drawn:
    """A belief for the eye: `levels`, one byte a cell of the box (C order), b meaning exp((b - 255) STEP) of the peak.

    lo, box: the lower corner and the shape of the box in cells; mean and sigma (the larger one) in the grid's unit; edge: the level,
    not rounded, of the faintest cell in the 95 % highest-density region; area of that region in unit^2; entropy in nats.
    """

    lo: tuple[int, ...]
    box: tuple[int, ...]
    levels: bytes
    mean: tuple[float, ...]
    sigma: float
    peak: float
    edge: float
    area: float
    entropy: float


@dataclass(frozen=True, eq=False)
class Received(Generic[M]):
    """A report or a consensus, and when it arrived (Unix seconds)."""

    message: M
    at: float
    size: int  # bytes on the wire

    def __getstate__(self) -> dict[str, object]:
        """What is packed of it (`blackboard.state.moments`): without what can be drawn again."""
        return {"message": self.message, "at": self.at, "size": self.size}

    @cached_property
    def drawn(self) -> Drawn | None:
        """Its belief for the eye; None for bytes that are no belief on two axes."""
        return drawn(self.message.belief)

    @cached_property
    def informed(self) -> Drawn | None:
        """The belief of a report that has the team's in it, for the eye; None where there is none."""
        informed = self.message.informed if isinstance(self.message, Report) else None
        return None if informed is None else drawn(informed.belief)


def read(packed: PackedBelief) -> Belief | None:
    """The belief, or None where a process would refuse it."""
    try:
        return unpack(packed)
    except Refused:
        return None


def drawn(packed: PackedBelief) -> Drawn | None:
    """A belief of the wire for the eye; None where it is none, or not on two axes."""
    belief = read(packed) if len(packed.grid.shape) == 2 else None
    return None if belief is None else draw(belief)


def draw(belief: Belief) -> Drawn:
    """A belief on two axes for the eye."""
    p = belief.p
    peak = float(p.max())
    kept = p >= peak * math.exp(-DEPTH)
    spans = [np.flatnonzero(kept.any(axis=1 - axis)) for axis in (0, 1)]
    lo, end = [int(span[0]) for span in spans], [int(span[-1]) + 1 for span in spans]
    box = p[lo[0] : end[0], lo[1] : end[1]]
    levels = 255.0 + np.log(np.maximum(box / peak, math.exp(-2 * DEPTH))) / STEP
    least = least_inside(p, REGION)
    return Drawn(
        lo=tuple(lo),
        box=box.shape,
        levels=np.maximum(0.0, np.rint(levels)).astype(np.uint8).tobytes(),
        mean=tuple(float(x) for x in belief.mean()),
        sigma=math.sqrt(max(0.0, float(np.linalg.eigvalsh(belief.covariance())[-1]))),
        peak=peak,
        edge=255.0 + math.log(least / peak) / STEP if least > 0 else 0.0,
        area=int(np.count_nonzero(p >= least)) * belief.grid.volume,
        entropy=entropy(p),
    )
