"""A packed belief in fewer bytes: wider steps between its levels, and a smaller box. Pure.

The coding stays "log8" (docs/bytes.md), so that every reader reads it.
"""

import math

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.wire.arrays import SCALES, support
from blackboard.wire.levels import written
from blackboard.wire.messages import PackedBelief

TOP = SCALES["log8"].top


def coarser(belief: Belief, packed: PackedBelief, step: float, reach: float) -> PackedBelief:
    """A belief, packed already on its grid, once more with levels `step` nats apart.

    Cells more than `reach` nats below the peak go into the rest, whose mass is spread evenly. step: at most 1 nat.
    """
    p = belief.p
    peak = float(p.max())
    below = np.log(np.maximum(p / peak, math.exp(-2 * TOP))) / -step
    levels = np.where(below * step > min(reach, step * (TOP - 1)), 0.0, TOP - np.rint(below)).astype(np.uint8)
    lo, box = support(levels > 0)
    inside = levels[tuple(slice(a, a + n) for a, n in zip(lo, box, strict=True))]
    rest = float(np.float32(min(1.0, p[levels == 0].sum())))
    return packed.model_copy(
        update={"lo": lo, "box": box, "coding": "log8", "step": step, "rest": rest, "data": written(inside.ravel())}
    )
