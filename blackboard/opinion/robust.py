"""Rules that a minority of wrong sources cannot capture. All sources are treated alike: a liar would claim a high weight."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.agreement import bhattacharyya
from blackboard.opinion.cooperative import normalised
from blackboard.opinion.grid import Array
from blackboard.opinion.weights import as_opinions, as_weights

LARGEST_TEAM = 16  # cliques are enumerated; a sub-team is smaller


def median_log_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The cell-wise median of the log beliefs, normalised (after arXiv 1903.05817); `weights` is checked and ignored.

    For an even number the median is the mean of the middle two logarithms. Where the medians leave no cell, the linear pool.
    """
    stack = as_opinions(opinions)
    as_weights(weights, len(stack), 1.0)
    with np.errstate(divide="ignore"):
        logs = np.sort(np.log(stack), axis=0)
    n = len(stack)
    median = logs[n // 2] if n % 2 else 0.5 * (logs[n // 2 - 1] + logs[n // 2])
    if not np.isfinite(median.max()):
        return np.asarray(stack.mean(axis=0) / stack.mean(axis=0).sum())
    return normalised(median, "median-log")


def geometric_median_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The belief whose square root has the least summed (Hellinger) distance to the opinions' square roots (Weiszfeld)."""
    stack = as_opinions(opinions)
    w = as_weights(weights, len(stack), 1.0)
    roots = np.sqrt(stack).reshape(len(stack), -1)
    centre = w @ roots / w.sum()
    for _ in range(100):
        distances = np.maximum(np.linalg.norm(roots - centre, axis=1), 1e-9)
        pull = w / distances
        moved = pull @ roots / pull.sum()
        step, centre = float(np.abs(moved - centre).max()), moved
        if step < 1e-12:
            break
    p = (centre**2).reshape(stack.shape[1:])
    return np.asarray(p / p.sum())


def clique_pool(
    opinions: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    *,
    rule: str = "logarithmic",
    xi: float = 3.0,
    gamma: float = 0.5,
    cell_ratio: float = 1.0,
) -> Array:
    """The largest set of opinions that agree in pairs, then any rule on it.

    Two opinions agree when their Bhattacharyya distance is at most `xi` nats (II-A.1). Of equally large sets the one with the
    least summed distance wins.
    """
    from blackboard.opinion.pools import fuse

    stack = as_opinions(opinions)
    if rule == "clique":
        raise OpinionError("clique cannot gate itself; name another rule")
    as_weights(weights, len(stack), 1.0)
    members = largest_clique(stack, xi)
    return fuse(rule, stack[members], gamma=gamma, cell_ratio=cell_ratio)


def largest_clique(stack: Array, xi: float) -> list[int]:
    """Indices of the largest set of opinions that agree in pairs; ties by the least summed distance, then by content."""
    n = len(stack)
    if n > LARGEST_TEAM:
        raise OpinionError(f"clique: {n} opinions are more than {LARGEST_TEAM}")
    distance = {(i, j): bhattacharyya(stack[i], stack[j]) for i, j in combinations(range(n), 2)}
    for size in range(n, 1, -1):
        sets = [s for s in combinations(range(n), size) if all(distance[p] <= xi for p in combinations(s, 2))]
        if sets:
            best = min(sets, key=lambda s: (round(sum(distance[p] for p in combinations(s, 2)), 9), _content(stack, s)))
            return list(best)
    return [min(range(n), key=lambda i: _content(stack, (i,)))]


def _content(stack: Array, members: tuple[int, ...]) -> list[bytes]:
    """A key that does not depend on the order of the opinions."""
    return sorted(stack[i].tobytes() for i in members)
