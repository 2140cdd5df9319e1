"""Rules that a minority of wrong sources cannot capture. Unweighted by default: a liar would claim to be certain."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from blackboard.opinion.agreement import coefficients
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked, from_logarithm, logarithm, shares

CLOSE = 1e-7  # distance of roots that is rounding: the sources are the same
STEPS = 500  # of Weiszfeld's iteration, which converges linearly


def median_log_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The cell-wise weighted median of the log beliefs, normalised (after Mitra, Richards, Sundaram, arXiv 1903.05817).

    opinions (N, *grid shape); weights (N,) are scaled to sum to 1, None means equal. Where exactly half of the weight is on
    either side, the median is the mean of the two logarithms. Idempotent; half of the weight is a veto. Raises OpinionError,
    also where no cell is left.
    """
    stack = checked(opinions)
    flat = stack.reshape(len(stack), -1)
    order = np.argsort(flat, axis=0, kind="stable")
    reached = np.cumsum(shares(weights, len(stack))[order], axis=0)
    lower, upper = np.argmax(reached > 0.5 - 1e-9, axis=0), np.argmax(reached > 0.5 + 1e-9, axis=0)
    logs = logarithm(np.take_along_axis(flat, order, axis=0))
    cells = np.arange(flat.shape[1])
    return from_logarithm(0.5 * (logs[lower, cells] + logs[upper, cells]), "median-log").reshape(stack.shape[1:])


def geometric_median_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The belief whose square root has the least weighted sum of distances to the opinions' square roots (Hellinger distances).

    opinions (N, *grid shape); weights (N,) None means equal. It breaks down only when half of the weight lies; idempotent, no
    veto. Raises OpinionError.
    """
    stack = checked(opinions)
    roots = np.sqrt(stack).reshape(len(stack), -1)
    p = (_median_mix(roots - roots.mean(axis=0), shares(weights, len(stack))) @ roots).reshape(stack.shape[1:]) ** 2
    return np.asarray(p / p.sum())


def _median_mix(points: Array, weights: Array) -> Array:
    """The geometric median of points (N, dimensions) as their convex combination, shape (N,), by Weiszfeld's iteration.

    Only inner products are needed. A point to which the others pull with less than its own weight is the median itself; there
    the iteration would crawl, so this is looked at first.
    """
    n = len(points)
    inner = points @ points.T
    each = np.eye(n)
    for i in range(n):
        distances = _lengths(each - each[i], inner)
        others = distances > CLOSE
        pull = np.where(others, weights, 0.0) / np.maximum(distances, CLOSE)
        if _lengths((pull - pull.sum() * each[i])[np.newaxis], inner)[0] < weights[~others].sum() * (1.0 - 1e-9):
            return np.asarray(each[i])
    mix = weights
    for _ in range(STEPS):
        pull = weights / np.maximum(_lengths(mix - each, inner), CLOSE)
        before, mix = mix, pull / pull.sum()
        if np.abs(mix - before).max() < 1e-12:
            break
    return mix


def _lengths(steps: Array, inner: Array) -> Array:
    """Lengths of vectors (M, N) given in points with these inner products, shape (M,)."""
    return np.asarray(np.sqrt(np.maximum(((steps @ inner) * steps).sum(axis=1), 0.0)))


def largest_cliques(opinions: npt.ArrayLike, xi: float) -> list[tuple[int, ...]]:
    """All largest sets of opinions that agree in pairs, Bhattacharyya distance <= xi nats (II-A.1), in ascending order.

    One in nearly all cases; several where nothing says which is right. Steps grow exponentially with N only where agreement
    is made up to be as intransitive as possible.
    """
    near = coefficients(opinions) >= math.exp(-xi) * (1.0 - 1e-12)
    largest: list[tuple[int, ...]] = [()]

    def grow(clique: tuple[int, ...], candidates: list[int]) -> None:
        if not candidates:
            if len(clique) > len(largest[0]):
                largest.clear()
            largest.append(clique)
        for i, one in enumerate(candidates):
            if len(clique) + len(candidates) - i < max(1, len(largest[0])):
                break  # too few are left
            grow((*clique, one), [other for other in candidates[i + 1 :] if near[one, other]])

    grow((), list(range(len(near))))
    return [clique for clique in largest if len(clique) == len(largest[0])]
