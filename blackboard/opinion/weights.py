"""The entropy of an opinion, and the weights that opinions get by it."""

import math

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked, positive

#: Entropies count as at least this in weights, in nats: that of a Gaussian as wide as rounding to a cell (sigma = 1 / sqrt(12)
#: cells), 0.1765. Below it the entropy measures the grid and not the sensor, and 1 / H**k would go to infinity.
LEAST_ENTROPY = 0.5 * math.log(2 * math.pi * math.e / 12)


def entropy(p: npt.ArrayLike) -> float:
    """Shannon's entropy of one opinion of any shape, in nats, with 0 ln 0 = 0. OpinionError if p is no PV."""
    (opinion,) = checked(np.asarray(p)[np.newaxis])
    return entropy_of(opinion)


def entropy_of(p: Array) -> float:
    """As `entropy`, of an opinion that is checked already."""
    some = p if p.min() > 0 else p[p > 0]
    return max(0.0, -float((some * np.log(some)).sum()))  # (III-.2)


def entropy_weights(opinions: npt.ArrayLike, k: float = 1.0, *, cell_ratio: float = 1.0) -> Array:
    """Weights proportional to 1 / H(P_i)**k, shape (N,), summing to 1 (III-A.1).

    opinions (N, *grid shape); k >= 0: 0 to 1 where sensors are likely to fail, 1 or more where they are reliable.
    cell_ratio = v_ref / v_cell: with another value than 1 the entropy is that of the mass per reference cell,
    H + ln(v_cell / v_ref), which does not depend on the grid. H counts as at least LEAST_ENTROPY.
    Raises OpinionError for opinions that are no PVs, a negative k, a ratio that is not positive.
    """
    stack = checked(opinions)
    if not (math.isfinite(k) and k >= 0):
        raise OpinionError(f"k {k}: give a finite exponent of at least 0")
    offset = math.log(positive(cell_ratio, "cell_ratio"))  # H + ln(v_cell / v_ref) is H - offset
    bounded = np.maximum([entropy_of(p) - offset for p in stack], LEAST_ENTROPY)
    weights = (bounded.min() / bounded) ** k  # (III-A.1)
    return np.asarray(weights / weights.sum())
