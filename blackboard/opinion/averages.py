"""Averages of opinions: the linear and the logarithmic pool of the paper, and the family of means between and beyond them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked, checked_weights, from_logarithm, logarithm, shares


def linear_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LOP, sum_i w_i P_i (IV-A.1), of opinions (N, *grid shape), in the grid's shape.

    weights (N,) are scaled to sum to 1, None means equal. Idempotent, without veto. Raises OpinionError.
    """
    stack = checked(opinions)
    p = np.einsum("n,n...->...", shares(weights, len(stack)), stack)
    return np.asarray(p / p.sum())


def logarithmic_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LGP, prod_i P_i^w_i normalised (IV-B.1), of opinions (N, *grid shape), in the grid's shape.

    weights (N,) are exponents and taken as they are; None means 1 each: the Bayes product, which is right for opinions
    that are independent given the truth, on a uniform prior. P^0 = 1, also for P = 0: weight 0 means unheard.
    A zero is a veto; only true zeros are, as all is done with logarithms. Raises OpinionError, also where no cell is left.
    """
    stack = checked(opinions)
    return from_logarithm(log_product(stack, checked_weights(weights, len(stack))), "logarithmic")


def geometric_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The geometric mean density, prod_i P_i^w_i normalised, with weights scaled to sum to 1; None means equal.

    Known as Chernoff fusion or generalised covariance intersection: idempotent, so it is safe where correlation is unknown.
    Otherwise as `logarithmic_pool`.
    """
    stack = checked(opinions)
    return from_logarithm(log_product(stack, shares(weights, len(stack))), "geometric")


def hoelder_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, a: float = 0.5) -> Array:
    """The power mean (sum_i w_i P_i^a)^(1/a), normalised, with weights scaled to sum to 1; None means equal.

    a = 1 is the linear pool, a -> 0 the geometric mean, a = -1 the harmonic mean; idempotent, a zero is a veto for a <= 0
    (Koliander, El-Laham, Djuric, Hlawatsch, Proc. IEEE 110(4), 2022). Raises OpinionError, also where no cell is left.
    """
    stack = checked(opinions)
    if not math.isfinite(a):
        raise OpinionError(f"a {a}: give a finite exponent")
    weights = shares(weights, len(stack))
    if abs(a) < 1e-8:  # where rounding would be divided by a
        return geometric_pool(stack, weights)
    heard = weights > 0
    offsets = np.log(weights[heard]).reshape(-1, *(1,) * (stack.ndim - 1))
    return from_logarithm(np.logaddexp.reduce(a * logarithm(stack[heard]) + offsets, axis=0) / a, "hoelder")


def harmonic_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """The harmonic mean density (sum_i w_i / P_i)^-1, normalised (Sharma et al., arXiv 2412.06716): `hoelder_pool` with a = -1."""
    return hoelder_pool(opinions, weights, a=-1.0)


def channel_filter_pool(
    opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, common: npt.ArrayLike | None = None
) -> Array:
    """prod_i P_i^w_i / prod_j Q_j, normalised: the product without what is known to be counted more than once.

    common (M, *grid shape) holds each piece Q_j of shared information as often as it is counted too much: N opinions that
    started from one prior give N - 1 copies of it. With this provenance the pool is exact; without (None) it is the product.
    A cell that a piece rules out stays ruled out: opinions made from it cannot hold it possible. weights as in
    `logarithmic_pool`. Raises OpinionError, also where no cell is left.
    """
    stack = checked(opinions)
    logs = log_product(stack, checked_weights(weights, len(stack)))
    if common is not None:
        pieces = checked(common)
        if pieces.shape[1:] != stack.shape[1:]:
            raise OpinionError(
                f"common of shape {pieces.shape} for opinions on a grid of {stack.shape[1:]}; give (M, *grid shape)"
            )
        shared = logarithm(pieces).sum(axis=0)
        possible = np.isfinite(shared)
        logs = np.where(possible, logs - np.where(possible, shared, 0.0), -np.inf)
    return from_logarithm(logs, "channel-filter")


def log_product(stack: Array, weights: Array) -> Array:
    """sum_i w_i ln P_i, in the grid's shape, with 0 ln 0 = 0."""
    heard = weights > 0
    return np.asarray(sum(w * logarithm(p) for w, p in zip(weights[heard], stack[heard], strict=True)))
