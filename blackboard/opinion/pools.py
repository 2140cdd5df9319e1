"""The rules for pooling opinions: one table, one signature `rule(opinions, weights=None, *, its own parameters)`.

`opinions` is (N, *grid shape), each non-negative and summing to 1; results have the grid's shape and sum to 1. A bad input
raises OpinionError naming the opinion, the cell and the value.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.cooperative import (
    calibrated_pool,
    coalition_pool,
    cooperative_components,
    cooperative_pool,
    normalised,
)
from blackboard.opinion.grid import Array
from blackboard.opinion.robust import clique_pool, geometric_median_pool, median_log_pool
from blackboard.opinion.weights import as_opinions, as_shares, as_weights, entropy, entropy_weights

Pool = Callable[..., Array]

__all__ = ["POOLS", "chernoff", "cooperative_components", "fuse", "linear_pool", "logarithmic_pool"]


def linear_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LOP: sum_i w_i P_i (IV-A.1), weights scaled to sum to 1, None means equal."""
    stack = as_opinions(opinions)
    p = np.tensordot(as_shares(weights, len(stack)), stack, axes=1)
    return np.asarray(p / p.sum())


def logarithmic_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LGP: prod_i P_i^{w_i} / its sum (IV-B.1), weights as given; None means 1 each, the Bayes product.

    A zero of an opinion with positive weight rules the cell out; raises OpinionError where no cell is left.
    """
    stack = as_opinions(opinions)
    return normalised(_log_product(stack, as_weights(weights, len(stack), 1.0)), "logarithmic")


def geometric_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LGP with weights that sum to 1: the geometric mean density (Chernoff fusion with given weights)."""
    stack = as_opinions(opinions)
    return normalised(_log_product(stack, as_shares(weights, len(stack))), "geometric")


def hoelder_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, exponent: float = -1.0) -> Array:
    """(sum_i w_i P_i^a)^(1/a), normalised: a = 1 linear, a -> 0 geometric, a = -1 harmonic (arXiv 2202.11633)."""
    stack = as_opinions(opinions)
    w = as_shares(weights, len(stack))
    if not np.isfinite(exponent):
        raise OpinionError(f"exponent = {exponent}: must be finite")
    if abs(exponent) < 1e-6:
        return geometric_pool(stack, w)
    counted = w > 0
    with np.errstate(divide="ignore"):
        logs = exponent * np.log(stack[counted])
    logs += np.log(w[counted]).reshape(-1, *([1] * (stack.ndim - 1)))
    top = logs.max(axis=0)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        total = top if exponent < 0 else safe
        summed = np.where(np.isposinf(top), np.inf, total + np.log(np.exp(logs - safe).sum(axis=0)))
    return normalised(summed / exponent, "hoelder")


def harmonic_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The harmonic mean density (sum_i w_i / P_i)^-1, normalised (arXiv 2412.06716)."""
    return hoelder_pool(opinions, weights, exponent=-1.0)


def chernoff_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The geometric mean with the weights that minimise entropy, two opinions at a time, sharpest first; `weights` is ignored.

    It never gains from an echo, but it believes the sharpest opinion, also where that one is wrong.
    """
    stack = as_opinions(opinions)
    as_weights(weights, len(stack), 1.0)
    order = sorted(range(len(stack)), key=lambda i: (entropy(stack[i]), stack[i].tobytes()))
    pooled = stack[order[0]]
    for i in order[1:]:
        pooled, _ = chernoff(pooled, stack[i])
    return np.asarray(pooled / pooled.sum())


def chernoff(first: Array, second: Array) -> tuple[Array, float]:
    """first^w second^(1-w), normalised, with the w in [0, 1] that minimises entropy, and that w.

    The entropy along w is searched on nine points and then between the best one's neighbours by golden section; the end
    points are the opinions themselves, so the result is never less sharp than the sharper one. Where their supports do
    not meet only the end points exist, and the sharper opinion is returned.
    """
    met = (first > 0) & (second > 0)
    best = min(((entropy(second), 0.0), (entropy(first), 1.0)))
    if met.any():
        a, b = np.log(first[met]), np.log(second[met])
        inner = [(_entropy_of_logs(w * a + (1 - w) * b), w) for w in np.linspace(0.125, 0.875, 7)]
        _, centre = min([best, *inner])
        best = min(best, _golden(a, b, max(0.0, centre - 0.125), min(1.0, centre + 0.125)))
    w = float(best[1])
    if w in (0.0, 1.0):
        return (first if w else second), w
    p = np.zeros(first.shape)
    logs = w * a + (1 - w) * b
    p[met] = np.exp(logs - logs.max())
    return p / p.sum(), w


def _golden(a: Array, b: Array, low: float, high: float) -> tuple[float, float]:
    """The least entropy of a^w b^(1-w), given as logarithms, for w between two bounds, and that w."""
    ratio = (np.sqrt(5) - 1) / 2
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = (_entropy_of_logs(w * a + (1 - w) * b) for w in (left, right))
    for _ in range(5):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - ratio * (high - low)
            at_left = _entropy_of_logs(left * a + (1 - left) * b)
        else:
            low, left, at_left = left, right, at_right
            right = low + ratio * (high - low)
            at_right = _entropy_of_logs(right * a + (1 - right) * b)
    return min((at_left, float(left)), (at_right, float(right)))


def _entropy_of_logs(logs: Array) -> float:
    """Entropy in nats of exp(logs) after normalising: ln Z - sum p ln p-before."""
    shifted = logs - logs.max()
    p = np.exp(shifted)
    total = p.sum()
    return float(np.log(total) - (p @ shifted) / total)


def product_without_common(opinions: npt.ArrayLike, common: npt.ArrayLike) -> Array:
    """Prod P_i / common^(N-1), normalised: exact where `common` is the information that all opinions contain (channel filter).

    Where `common` is zero so must be the opinions that came from it; such cells are ruled out.
    """
    stack = as_opinions(opinions)
    shared = as_opinions(np.asarray(common, dtype=float)[None])[0]
    if shared.shape != stack.shape[1:]:
        raise OpinionError(f"common has shape {shared.shape}; the opinions' grid is {stack.shape[1:]}")
    logs = _log_product(stack, np.ones(len(stack)))
    with np.errstate(divide="ignore"):
        known = np.log(shared)
    held = np.isfinite(known) & np.isfinite(logs)
    return normalised(np.where(held, logs - (len(stack) - 1) * np.where(held, known, 0.0), -np.inf), "product/common")


def _log_product(stack: Array, weights: Array) -> Array:
    counted = weights > 0  # P^0 = 1, also where P is 0
    with np.errstate(divide="ignore"):
        return np.asarray(np.tensordot(weights[counted], np.log(stack[counted]), axes=1))


#: Every rule by its name; `fuse` gives each the parameters that it has.
POOLS: dict[str, Pool] = {
    "linear": linear_pool,
    "logarithmic": logarithmic_pool,
    "geometric": geometric_pool,
    "chernoff": chernoff_pool,
    "hoelder": hoelder_pool,
    "harmonic": harmonic_pool,
    "cooperative": cooperative_pool,
    "calibrated": calibrated_pool,
    "coalition": coalition_pool,
    "median-log": median_log_pool,
    "geometric-median": geometric_median_pool,
    "clique": clique_pool,
}

#: Rules whose weights are (III-A.1); the product's are 1 each, and the robust rules treat all sources alike.
ENTROPY_WEIGHTED = frozenset({"linear", "geometric", "hoelder", "harmonic", "cooperative", "calibrated", "coalition"})


def fuse(
    rule: str, opinions: npt.ArrayLike, *, k: float = 2.0, gamma: float = 0.5, cell_ratio: float = 1.0, **more: float
) -> Array:
    """Pool by the name of a rule, with the entropy weights (III-A.1) where it uses them and the parameters it has."""
    if rule not in POOLS:
        raise OpinionError(f"rule {rule!r} is none of {', '.join(sorted(POOLS))}")
    stack = as_opinions(opinions)
    weights = entropy_weights(stack, k, cell_ratio=cell_ratio) if rule in ENTROPY_WEIGHTED else None
    known = parameters(rule)
    unknown = sorted(set(more) - known)
    if unknown:
        raise OpinionError(
            f"rule {rule!r} has no parameter {unknown[0]!r}; it has {', '.join(sorted(known)) or 'none'}"
        )
    given = {"gamma": gamma, "cell_ratio": cell_ratio, **more}
    return POOLS[rule](stack, weights, **{name: value for name, value in given.items() if name in known})


@cache
def parameters(rule: str) -> frozenset[str]:
    """The names of a rule's own parameters."""
    signature = inspect.signature(POOLS[rule])
    return frozenset(n for n, p in signature.parameters.items() if p.kind is inspect.Parameter.KEYWORD_ONLY)
