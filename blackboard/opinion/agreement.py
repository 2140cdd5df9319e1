"""Do opinions agree? Distances (II-A.1) in nats, and the paper's entropy test for a conflict (section VI)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from blackboard.opinion.grid import Array
from blackboard.opinion.weights import entropy

Distance = Callable[[Array, Array], float]


def kullback_leibler(p: Array, q: Array) -> float:
    """Sum p ln(p / q) >= 0, infinite where q rules out what p allows; not symmetric."""
    held = p > 0
    if (q[held] == 0).any():
        return float("inf")
    return max(0.0, float((p[held] * np.log(p[held] / q[held])).sum()))


def bhattacharyya_coefficient(p: Array, q: Array) -> float:
    """Sum sqrt(p q), between 0 (no common cell) and 1 (equal)."""
    return min(1.0, float(np.sqrt(p * q).sum()))


def bhattacharyya(p: Array, q: Array) -> float:
    """-ln of the Bhattacharyya coefficient; infinite without a common cell."""
    coefficient = bhattacharyya_coefficient(p, q)
    return -float(np.log(coefficient)) if coefficient > 0 else float("inf")


def jensen_shannon(p: Array, q: Array) -> float:
    """Mean Kullback-Leibler distance to the midpoint, between 0 and ln 2; symmetric and always finite."""
    middle = 0.5 * (p + q)
    return min(float(np.log(2)), 0.5 * (kullback_leibler(p, middle) + kullback_leibler(q, middle)))


def agree(p: Array, q: Array, xi: float, distance: Distance = bhattacharyya) -> bool:
    """Two opinions agree when d(p, q) <= xi (II-A.1)."""
    return distance(p, q) <= xi


def conflict(opinions: Array, fused: Array) -> bool:
    """The paper's entropy test: some individual opinion is sharper than the cooperative belief. Shapes (N, *grid), grid."""
    return min(entropy(p) for p in opinions) < entropy(fused) - 1e-9
