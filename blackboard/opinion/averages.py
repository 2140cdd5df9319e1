"""Averages of opinions: the linear and the logarithmic pool of the paper, and the family of means between and beyond them."""

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.rules import EntropyWeighted, Pooled, Rule, parameter, pooled, rule
from blackboard.opinion.vectors import checked, checked_weights, from_logarithm, logarithm, shares


@rule("linear")
class Linear(EntropyWeighted):
    """LOP, sum_i w_i P_i (IV-A.1), with weights scaled to sum to 1. Idempotent, without veto.

    Contribution of an opinion: its w_i.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        w = shares(weights, len(opinions))
        p = np.einsum("n,n...->...", w, opinions)  # (IV-A.1)
        return Pooled(np.asarray(p / p.sum()), w)


@rule("logarithmic")
class Logarithmic(Rule):
    """LGP, prod_i P_i^w_i normalised (IV-B.1). Weights are exponents, 1 each on a board; P^0 = 1, also for P = 0. A zero is a veto.

    Contribution of an opinion: its exponent w_i.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        w = checked_weights(weights, len(opinions))
        return Pooled(from_logarithm(log_product(opinions, w), self.name), w)  # (IV-B.1)


@rule("geometric")
class Geometric(Rule):
    """The geometric mean density, prod_i P_i^w_i normalised, with weights scaled to sum to 1. Idempotent; a zero is a veto.

    Contribution of an opinion: its exponent w_i.
    """

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        w = shares(weights, len(opinions))
        return Pooled(from_logarithm(log_product(opinions, w), self.name), w)  # (IV-B.1), sum_i w_i = 1


@rule("hoelder")
class Hoelder(Rule):
    """The power mean (sum_i w_i P_i^a)^(1/a), normalised, with weights scaled to sum to 1. Idempotent.

    a = 1 is the linear pool, a -> 0 the geometric mean, a = -1 the harmonic mean; a zero is a veto for a <= 0
    (Koliander, El-Laham, Djuric, Hlawatsch, Proc. IEEE 110(4), 2022). Contribution of an opinion: its w_i.
    """

    a: float = parameter(default=0.5, least=-20, most=20)
    "[factor] Exponent: 1 is the linear pool, near 0 the geometric mean, -1 the harmonic mean."

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        w = shares(weights, len(opinions))
        if abs(self.a) < 1e-8:  # where rounding would be divided by a
            return Geometric().pool(opinions, w)
        counted = w > 0
        offsets = np.log(w[counted]).reshape(-1, *(1,) * (opinions.ndim - 1))
        # ln (sum_i w_i P_i^a)^(1/a) = ln(sum_i exp(a ln P_i + ln w_i)) / a
        logs = np.logaddexp.reduce(self.a * logarithm(opinions[counted]) + offsets, axis=0) / self.a
        return Pooled(from_logarithm(logs, "hoelder"), w)


@rule("harmonic")
class Harmonic(Rule):
    """The harmonic mean density (sum_i w_i / P_i)^-1, normalised (Sharma et al., arXiv 2412.06716): `Hoelder` with a = -1."""

    def pool(self, opinions: Array, weights: Array | None = None, *, cell_ratio: float = 1.0) -> Pooled:
        return Hoelder(a=-1.0).pool(opinions, weights)


@rule("channel-filter")
class ChannelFilter(Rule):
    """prod_i P_i^w_i / prod_j Q_j, normalised: the product without what is known to be counted more than once.

    On a board nothing is known to be common, and it is the product. Contribution of an opinion: its exponent w_i.
    """

    def pool(
        self,
        opinions: Array,
        weights: Array | None = None,
        *,
        cell_ratio: float = 1.0,
        common: npt.ArrayLike | None = None,
    ) -> Pooled:
        """As every rule, and `common` (M, *grid shape): see `channel_filter_pool`."""
        w = checked_weights(weights, len(opinions))
        logs = log_product(opinions, w)
        if common is not None:
            pieces = checked(common)
            if pieces.shape[1:] != opinions.shape[1:]:
                raise OpinionError(
                    f"common of shape {pieces.shape} for opinions on a grid of {opinions.shape[1:]}; give (M, *grid shape)"
                )
            shared = logarithm(pieces).sum(axis=0)
            possible = np.isfinite(shared)
            # ln prod_i P_i^w_i - ln prod_j Q_j
            logs = np.where(possible, logs - np.where(possible, shared, 0.0), -np.inf)
        return Pooled(from_logarithm(logs, self.name), w)


# --- the belief alone --------------------------------------------------------------------------------------------------


def linear_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LOP, sum_i w_i P_i (IV-A.1), of opinions (N, *grid shape), in the grid's shape.

    weights (N,) are scaled to sum to 1, None means equal. Idempotent, without veto. Raises OpinionError.
    """
    return pooled(Linear(), opinions, weights)


def logarithmic_pool(opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> Array:
    """LGP, prod_i P_i^w_i normalised (IV-B.1), of opinions (N, *grid shape), in the grid's shape.

    weights (N,) are exponents and taken as they are; None means 1 each: the Bayes product, which is right for opinions
    that are independent given the truth, on a uniform prior. P^0 = 1, also for P = 0: weight 0 leaves an opinion out.
    A zero is a veto; only true zeros are, as all is done with logarithms. Raises OpinionError, also where no cell is left.
    """
    return pooled(Logarithmic(), opinions, weights)


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
    return ChannelFilter().pool(stack, checked_weights(weights, len(stack)), common=common).p


def log_product(stack: Array, weights: Array) -> Array:
    """sum_i w_i ln P_i, in the grid's shape, with 0 ln 0 = 0."""
    counted = weights > 0
    return np.asarray(sum(w * logarithm(p) for w, p in zip(weights[counted], stack[counted], strict=True)))
