"""The geometric mean with the weights that minimise entropy (Chernoff fusion): it never gains from an echo.

Along P^w Q^(1-w) the entropy of Gaussians is convex in w, of other beliefs it need not be: a coarse scan finds the valley, a
golden section its bottom, so that a narrow second valley can be missed, at the price of a less sharp result, never a wrong one.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.averages import geometric_pool
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked, from_logarithm
from blackboard.opinion.weights import entropy

SCAN = (0.2, 0.4, 0.6, 0.8)
GOLDEN = (math.sqrt(5) - 1) / 2  # of a section, where the next one is measured
SECTIONS = 7  # leave w within 0.014 = 2 * 0.2 * GOLDEN^7: entropy is flat at its minimum
FAINT = 18.0  # nats below what matters, a cell is left out of the search: 4e4 of them hold 4e4 exp(-18) = 6e-4
SLACK = 1e-6  # nats that an average must gain over an opinion as it stands
ROUNDS = 50  # of the search over more than two weights


def chernoff(first: Array, second: Array) -> tuple[Array, float]:
    """first^w second^(1-w), normalised, and the w in [0, 1] for which its entropy is least. Both in the grid's shape.

    The ends are the opinions as they stand (P^0 = 1, also for P = 0), so the result is never less sharp than the sharper one,
    and it is that one where no cell is possible for both. Of equals `first` is taken: an exact echo changes nothing.
    Raises OpinionError for an argument that is no PV or of another shape.
    """
    if first.shape != second.shape:
        raise OpinionError(f"opinions of shapes {first.shape} and {second.shape}; give two on one grid")
    at_first, at_second = entropy(first), entropy(second)
    met = (first > 0) & (second > 0)
    a, b = np.log(first[met]), np.log(second[met])
    if len(a):
        w = _sharpest(a, b)
        mean = w * a + (1.0 - w) * b
        if _entropy(mean) < min(at_first, at_second) - SLACK:
            p = np.zeros(first.shape)
            p[met] = from_logarithm(mean, "chernoff")
            return p, w
    return (first, 1.0) if at_first <= at_second + SLACK else (second, 0.0)


def chernoff_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The geometric mean of opinions (N, *grid shape) with the weights of least entropy, in the grid's shape.

    Searched among the cells that all hold possible, downhill from equal weights, each step from one opinion to another
    (pairwise Frank-Wolfe). The opinions as they stand are candidates too, so some cell always survives. Given weights are not
    optimised: then it is `geometric_pool`. Its flaw: of opinions that contradict each other it believes the sharpest.
    Raises OpinionError.
    """
    stack = checked(opinions)
    if weights is not None:
        return geometric_pool(stack, weights)
    entropies = [entropy(p) for p in stack]
    sharpest = stack[int(np.argmin(entropies))]
    met = (stack > 0).all(axis=0)
    if not met.any():
        return np.asarray(sharpest / sharpest.sum())
    pooled = np.zeros(met.shape)
    pooled[met] = from_logarithm(_sharpest_mean(np.log(stack[:, met])), "chernoff")
    return pooled if entropy(pooled) < min(entropies) - SLACK else np.asarray(sharpest / sharpest.sum())


def _sharpest_mean(logs: Array) -> Array:
    """sum_i w_i logs_i, shape (cells,), of logs (N, cells), with the w >= 0 of sum 1 that minimise its entropy."""
    w = np.full(len(logs), 1.0 / len(logs))
    mean = w @ logs
    for _ in range(ROUNDS):
        p = from_logarithm(mean, "chernoff")
        slopes = logs @ (p * (p @ mean - mean))  # of the entropy in each weight: minus a covariance
        to, fro = int(np.argmin(slopes)), int(np.argmax(np.where(w > 0, slopes, -np.inf)))
        step = w[fro] * (logs[to] - logs[fro])
        least, part = min((_entropy(mean + t * step), t) for t in (_sharpest(mean + step, mean), 1.0))
        if least > _entropy(mean) - SLACK:
            break
        moved = part * w[fro]
        w[to], w[fro] = w[to] + moved, w[fro] - moved
        mean = w @ logs
    return np.asarray(mean)


def _sharpest(a: Array, b: Array) -> float:
    """The w in (0, 1) for which exp(w a + (1 - w) b), normalised, has the least entropy. Shapes (cells,)."""
    matters = np.maximum(a, b) > np.minimum(a, b).max() - FAINT
    b, slope = b[matters], a[matters] - b[matters]

    def at(w: float) -> tuple[float, float]:
        return _entropy(b + w * slope), w

    best = min(at(w) for w in SCAN)
    low, high = best[1] - SCAN[0], best[1] + SCAN[0]
    left, right = at(high - GOLDEN * (high - low)), at(low + GOLDEN * (high - low))
    for _ in range(SECTIONS):
        best = min(best, left, right)
        if left < right:
            high, right = right[1], left
            left = at(high - GOLDEN * (high - low))
        else:
            low, left = left[1], right
            right = at(low + GOLDEN * (high - low))
    return min(best, left, right)[1]


def _entropy(logs: Array) -> float:
    """Entropy in nats of exp(logs), normalised: ln Z - E[logs]."""
    shifted = logs - logs.max()
    p = np.exp(shifted)
    total = float(p.sum())
    return math.log(total) - float((p * shifted).sum()) / total
