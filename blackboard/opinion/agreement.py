"""Do opinions agree? Distances between two opinions on one grid (II-A.1), and the paper's entropy test for a conflict."""

import math

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked
from blackboard.opinion.weights import entropy_of

SLACK = 1e-9  # nats by which entropies differ by rounding alone


def kullback_leibler(p: npt.ArrayLike, q: npt.ArrayLike) -> float:
    """Sum p ln(p / q) in nats, at least 0; infinite where q rules out what p holds possible; not symmetric."""
    p, q = _pair(p, q)
    possible = p > 0
    p, q = p[possible], q[possible]
    if not q.all():
        return math.inf
    return max(0.0, float((p * (np.log(p) - np.log(q))).sum()))  # sum p ln(p / q)


def bhattacharyya_coefficient(p: npt.ArrayLike, q: npt.ArrayLike) -> float:
    """Sum sqrt(p q): from 0 (no cell in common) to 1 (equal)."""
    p, q = _pair(p, q)
    return min(1.0, float((np.sqrt(p) * np.sqrt(q)).sum()))  # sum sqrt(p q)


def coefficients(opinions: npt.ArrayLike) -> Array:
    """Bhattacharyya coefficients of all pairs of opinions (N, *grid shape), shape (N, N)."""
    stack = checked(opinions)
    roots = np.sqrt(stack).reshape(len(stack), -1)
    return np.asarray(roots @ roots.T)


def conflict(opinions: Array, fused: Array) -> bool:
    """The paper's second test (section VI): some individual opinion has a smaller entropy than the fused belief.

    opinions (N, *grid shape), checked, and fused in the grid's shape; differences of rounding do not count.
    """
    limit = entropy_of(fused) - SLACK
    # Renyi's entropy of order 2, -ln sum p^2, is at most Shannon's, and takes no logarithm of each cell
    # (III-B.1) is broken
    return any(-math.log(float(np.square(p).sum())) < limit and entropy_of(p) < limit for p in opinions)


def _pair(p: npt.ArrayLike, q: npt.ArrayLike) -> tuple[Array, Array]:
    p, q = np.asarray(p), np.asarray(q)
    if p.shape != q.shape:
        raise OpinionError(f"opinions of shapes {p.shape} and {q.shape}; give two on one grid")
    first, second = checked(np.stack([p, q]))
    return first, second
