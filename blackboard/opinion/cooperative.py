"""The Cooperative Opinion Pool, P = K sum_q C_q^(1/alpha_q) (V-.2), exactly, in O(m N^2) steps for N opinions on m cells.

The paper sums over every subset of q opinions. With E_0 = 1 and all else 0, the same components come from

    W_q += P_j (W_{q-1} + w_j E_{q-1})        E_q += P_j E_{q-1}        for each opinion j, q downwards

where E_q is the sum of all products of q opinions and W_q the same with the weights of each product: C_q = W_q. All terms
are non-negative, so nothing cancels.

The magnitudes span hundreds of decades (1 / alpha_1 = 2^N - 1), so only ratios at most 1 are ever multiplied, and the rest
is done with logarithms: each cell is scaled by its largest opinion. Where opinions differ so much in a cell that even the
products of these ratios would underflow, the cell sorts its opinions, P_1 >= P_2 >= ..., and keeps E_q and W_q relative to
P_1 P_2 ... P_q, the largest product of q there is: E_q is then between 1 and the number of subsets. Both are exact to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import checked, from_logarithm, logarithm, positive, shares

TINY = 5e-324  # the smallest positive float: x / max(x, TINY) is 1, and 0 for x = 0
LEAST_PRODUCT = 1e-280  # of a cell's ratios, for the simple scaling: 1e-308 is where floats end
BLOCK = 1024  # cells worked on at a time, so that they stay in the processor's cache


def alphas(n: int, gamma: float = 0.5) -> Array:
    """The exponents' inverses alpha_1..alpha_n, alpha_q = alpha_{q-1} / gamma, summing to 1, for 0 < gamma <= 1 (V-C)."""
    if not 0 < gamma <= 1:
        raise OpinionError(f"gamma {gamma}: give the ratio of two alphas, above 0 and at most 1")
    falling = float(gamma) ** np.arange(n - 1, -1, -1)
    return np.asarray(np.maximum(falling / falling.sum(), 1e-300))  # far too small to matter, and 1 / alpha is finite


def cooperative_pool(
    opinions: npt.ArrayLike, weights: npt.ArrayLike | None = None, *, gamma: float = 0.5, cell_ratio: float = 1.0
) -> Array:
    """COP (V-.2) of opinions (N, *grid shape), in the grid's shape; each cell sums over all coalitions that may be right.

    weights (N,) are scaled to sum to 1, None means equal; gamma is the ratio of the alphas (V-C); cell_ratio = v_ref / v_cell
    expresses the opinions as mass per reference cell, so that the fused density is the same on every grid; 1 is the
    paper's formula. A reference cell wider than the sharpest opinion lets that opinion win alone: take a smaller one.
    COP has no veto, so some cell always survives. It is over-confident (docs/paper.md). Raises OpinionError.
    """
    stack = checked(opinions)
    terms = powered_components(stack, weights, alphas(len(stack), gamma), cell_ratio)
    p = _mass(terms).sum(axis=0)
    return np.asarray((p / p.sum()).reshape(stack.shape[1:]))


def cooperative_components(
    opinions: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    *,
    gamma: float = 0.5,
    gate: float | None = None,
    cell_ratio: float = 1.0,
) -> Array:
    """The share of C_1^(1/alpha_1) .. C_N^(1/alpha_N) in the mass of the COP, shape (N,), summing to 1.

    The story of a consensus: most of it in C_N means all agree, in C_q that the best coalition has q members. With a gate
    these are the m_q of `coalition_pool`.
    """
    logs, alpha = _coalitions(checked(opinions), weights, gamma, gate, cell_ratio)
    mass = _mass(logs / alpha[:, np.newaxis]).sum(axis=1)
    return np.asarray(mass / mass.sum())


def calibrated_pool(
    opinions: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    *,
    gamma: float = 0.5,
    cell_ratio: float = 1.0,
    power: float | None = None,
) -> Array:
    """COP to a power: the same winner, claiming less. The default power alpha_N leaves C_N with exponent 1, the product."""
    stack = checked(opinions)
    alpha = alphas(len(stack), gamma)
    power = float(alpha[-1]) if power is None else positive(power, "power")
    terms = powered_components(stack, weights, alpha, cell_ratio)
    return from_logarithm(power * np.logaddexp.reduce(terms, axis=0), "calibrated").reshape(stack.shape[1:])


def coalition_pool(
    opinions: npt.ArrayLike,
    weights: npt.ArrayLike | None = None,
    *,
    gamma: float = 0.5,
    gate: float | None = None,
    cell_ratio: float = 1.0,
    independence: float = 0.0,
) -> Array:
    """sum_q m_q norm(C_q^(e_q)): COP only chooses the coalitions, by the mass m_q of component q in it.

    Within a coalition of q opinions e_q = q^-(1 - independence): 0 is the geometric mean of its members, which is safe
    when they share information; 1 is their product, right when they are independent. gate: see `gated_components`; with
    it, gamma and cell_ratio do not count.
    """
    stack = checked(opinions)
    if not 0 <= independence <= 1:
        raise OpinionError(f"independence {independence}: give a value from 0 (may be echoes) to 1 (independent)")
    logs, alpha = _coalitions(stack, weights, gamma, gate, cell_ratio)
    mass = _mass(logs / alpha[:, np.newaxis]).sum(axis=1)
    pooled = np.zeros(logs.shape[1])
    for q in np.flatnonzero(mass):
        exponent = (q + 1.0) ** (independence - 1.0)
        pooled += mass[q] / mass.sum() * from_logarithm(exponent * logs[q], "coalition")
    return np.asarray((pooled / pooled.sum()).reshape(stack.shape[1:]))


def gated_components(opinions: Array, weights: npt.ArrayLike | None, gate: float) -> tuple[Array, Array]:
    """The logarithms of C_1..C_N, shape (N, cells), and the alphas (N,), by which who disagrees is left out, whatever N.

    Every opinion counts relative to its own peak, with mass exp(-gate) there, so that one that knows little disagrees with
    nobody; and alpha_q grows as the triangular numbers q (q + 1) / 2. Then C_q^(1/alpha_q) falls behind C_{q-1}^(1/alpha_{q-1})
    where it costs the q-th opinion more than `gate` nats below its own peak to agree with the others (docs/paper.md).
    opinions (N, *grid shape), checked. Raises OpinionError.
    """
    n = len(opinions)
    peaks = opinions.reshape(n, -1).max(axis=1)
    relative = opinions * (math.exp(-positive(gate, "gate")) / peaks).reshape(-1, *(1,) * (opinions.ndim - 1))
    triangular = np.cumsum(np.arange(1.0, n + 1))
    return log_components(relative, weights), triangular / triangular.sum()


def _coalitions(
    stack: Array, weights: npt.ArrayLike | None, gamma: float, gate: float | None, cell_ratio: float
) -> tuple[Array, Array]:
    """The logarithms of the components and the alphas: by the gate, or the paper's."""
    if gate is not None:
        return gated_components(stack, weights, gate)
    return log_components(stack, weights, cell_ratio), alphas(len(stack), gamma)


def powered_components(
    opinions: Array, weights: npt.ArrayLike | None, alpha: npt.ArrayLike, cell_ratio: float = 1.0
) -> Array:
    """The logarithms of C_q^(1/alpha_q), q = 1..N, shape (N, cells); COP is the normalised sum of their exponentials.

    opinions (N, *grid shape), checked; alpha (N,). Rounding grows with the exponent: a term is off by about
    |ln C_q| / alpha_q times 2e-16, relatively.
    """
    return np.asarray(log_components(opinions, weights, cell_ratio) / np.reshape(alpha, (len(opinions), 1)))


def log_components(opinions: Array, weights: npt.ArrayLike | None, cell_ratio: float = 1.0) -> Array:
    """The logarithms of C_1..C_N, shape (N, cells), as mass per reference cell."""
    n = len(opinions)
    p, w = opinions.reshape(n, -1), shares(weights, n)
    logs = np.empty_like(p)
    for start in range(0, p.shape[1], BLOCK):
        block = slice(start, start + BLOCK)
        logs[:, block] = _log_components(p[:, block], w)
    return np.asarray(logs + np.arange(1, n + 1)[:, np.newaxis] * math.log(positive(cell_ratio, "cell_ratio")))


def _log_components(p: Array, weights: Array) -> Array:
    """The logarithms of C_1..C_N for opinions (N, cells), shape (N, cells); see the top of this file."""
    top = p.max(axis=0)
    ratios = p / np.maximum(top, TINY)
    logs = np.arange(1, len(p) + 1)[:, np.newaxis] * logarithm(top) + logarithm(_subset_sums(ratios, weights, len(top)))
    wide = ~(np.where(ratios > 0, ratios, 1.0).prod(axis=0) > LEAST_PRODUCT)
    if wide.any():
        logs[:, wide] = _log_components_sorted(p[:, wide], weights)
    return np.asarray(logs)


def _log_components_sorted(p: Array, weights: Array) -> Array:
    """The same for cells in which the products of the ratios underflow."""
    order = np.argsort(-p, axis=0, kind="stable")
    p = np.take_along_axis(p, order, axis=0)
    ratios = (p[j] / np.maximum(p[: j + 1], TINY) for j in range(len(p)))  # P_j / P_q for q = 1..j
    return np.asarray(np.cumsum(logarithm(p), axis=0) + logarithm(_subset_sums(ratios, weights[order], p.shape[1])))


def _subset_sums(ratios: Iterable[Array], weights: Array, cells: int) -> Array:
    """W_1..W_N by the two recursions, shape (N, cells).

    For each opinion j its ratio to the scale of every step q = 1..j, (cells,) or (j, cells), and its weight, () or (cells,).
    """
    products, weighted = np.zeros((2, len(weights) + 1, cells))  # E_q, W_q
    products[0] = 1.0
    for j, (ratio, weight) in enumerate(zip(ratios, weights, strict=True)):
        weighted[1 : j + 2] += ratio * (weighted[: j + 1] + weight * products[: j + 1])
        products[1 : j + 2] += ratio * products[: j + 1]
    return np.asarray(weighted[1:])


def _mass(terms: Array) -> Array:
    """The powered components relative to the largest cell of all, shape (N, cells)."""
    return np.asarray(np.exp(terms - terms.max()))
