"""The geometric mean with the weights that minimise entropy (Chernoff fusion): the same information again adds nothing to it.

Along P^w Q^(1-w) the entropy of Gaussians is convex in w, of other beliefs it need not be: a coarse scan finds the lowest
part, a golden section the minimum there. A narrow second minimum can be missed; the result is then less sharp, and still valid.
"""

import math

import numpy as np

from blackboard.errors import OpinionError
from blackboard.opinion.averages import Geometric
from blackboard.opinion.grid import Array
from blackboard.opinion.rules import Pooled, Rule, rule
from blackboard.opinion.vectors import from_logarithm
from blackboard.opinion.weights import entropy

SCAN = (0.2, 0.4, 0.6, 0.8)
GOLDEN = (math.sqrt(5) - 1) / 2  # of a section, where the next one is measured
SECTIONS = 7  # leave w within 0.014 = 2 * 0.2 * GOLDEN^7: entropy is flat at its minimum
FAINT = 18.0  # nats below what matters, a cell is left out of the search: 4e4 of them hold 4e4 exp(-18) = 6e-4
SLACK = 1e-6  # nats that an average must gain over an opinion as it stands
MAX_STEPS = 50  # of the search over more than two weights


def chernoff(first: Array, second: Array) -> tuple[Array, float]:
    """first^w second^(1-w), normalised, and the w in [0, 1] for which its entropy is least. Both in the grid's shape.

    The ends are the opinions as they stand (P^0 = 1, also for P = 0). So the result is never less sharp than the sharper one.
    Where no cell is possible for both, it is the sharper one. Of equals `first` is taken: an exact echo changes nothing. Raises
    OpinionError for an argument that is no PV or of another shape.
    """
    if first.shape != second.shape:
        raise OpinionError(f"opinions of shapes {first.shape} and {second.shape}; give two on one grid")
    at_first, at_second = entropy(first), entropy(second)
    met = (first > 0) & (second > 0)
    a, b = np.log(first[met]), np.log(second[met])
    if len(a):
        w = _sharpest(a, b)
        mean = w * a + (1.0 - w) * b  # ln(P^w Q^(1-w))
        if _entropy(mean) < min(at_first, at_second) - SLACK:
            p = np.zeros(first.shape)
            p[met] = from_logarithm(mean, "chernoff")
            return p, w
    return (first, 1.0) if at_first <= at_second + SLACK else (second, 0.0)


@rule("chernoff")
class Chernoff(Rule):
    """The geometric mean with the weights of least entropy; given weights are not optimised: then it is `Geometric`.

    Idempotent; a zero is a veto, but some cell always survives, as the opinions as they stand are candidates too. Its flaw: of
    opinions that contradict each other it believes the sharpest. Contribution of an opinion: the exponent w_i that was found.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        if weights is not None:
            return Geometric().pool(opinions, weights)
        entropies = [entropy(p) for p in opinions]
        sharpest = int(np.argmin(entropies))
        met = (opinions > 0).all(axis=0)
        if met.any():
            logs, w = _sharpest_mean(np.log(opinions[:, met]))
            p = np.zeros(met.shape)
            p[met] = from_logarithm(logs, self.name)
            if entropy(p) < min(entropies) - SLACK:
                return Pooled(p, w)
        return Pooled(np.asarray(opinions[sharpest] / opinions[sharpest].sum()), np.eye(len(opinions))[sharpest])


def _sharpest_mean(logs: Array) -> tuple[Array, Array]:
    """sum_i w_i logs_i, shape (cells,), of logs (N, cells), and the w >= 0 (N,) of sum 1 that minimise its entropy."""
    w = np.full(len(logs), 1.0 / len(logs))
    mean = w @ logs  # ln prod_i P_i^w_i
    for _ in range(MAX_STEPS):
        p = from_logarithm(mean, "chernoff")
        slopes = logs @ (p * (p @ mean - mean))  # dH/dw_i = -Cov(ln P_i, ln p) under p
        to, fro = int(np.argmin(slopes)), int(np.argmax(np.where(w > 0, slopes, -np.inf)))
        step = w[fro] * (logs[to] - logs[fro])
        least, part = min((_entropy(mean + t * step), t) for t in (_sharpest(mean + step, mean), 1.0))
        if least > _entropy(mean) - SLACK:
            break
        moved = part * w[fro]
        w[to], w[fro] = w[to] + moved, w[fro] - moved
        mean = w @ logs
    return np.asarray(mean), w


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
    return math.log(total) - float((p * shifted).sum()) / total  # (III-.2)
