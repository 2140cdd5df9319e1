"""The components of the Cooperative Opinion Pool, exactly, in O(m N^2) steps for N opinions on m cells, and each opinion's part.

The paper sums over every subset of q opinions (V-.2). With E_0 = 1 and all else 0, the same components come from

    W_q += P_j (W_{q-1} + w_j E_{q-1})        E_q += P_j E_{q-1}        for each opinion j, q downwards

where E_q is the sum of all products of q opinions and W_q the same with the weights of each product: C_q = W_q. All terms
are non-negative, so nothing cancels.

The magnitudes span hundreds of decades (1 / alpha_1 = 2^N - 1), so only ratios at most 1 are ever multiplied, and the rest
is done with logarithms: each cell is scaled by its largest opinion. Where opinions differ so much in a cell that even the
products of these ratios would underflow, the cell sorts its opinions, P_1 >= P_2 >= ..., and keeps E_q and W_q relative to
P_1 P_2 ... P_q, the largest product of q there is: E_q is then between 1 and the number of subsets. Both are exact to rounding.

C_q is linear in each opinion, so P_i dC_q/dP_i is the part of C_q that comes from subsets with opinion i in them. The recursion
run backwards (reverse differentiation) gives it for all opinions at once, again with non-negative terms only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import logarithm, positive, shares

TINY = 5e-324  # the smallest positive float: x / max(x, TINY) is 1, and 0 for x = 0
LEAST_PRODUCT = 1e-280  # of a cell's ratios, for the simple scaling: 1e-308 is where floats end
BLOCK = 1024  # cells worked on at a time, so that they stay in the processor's cache
NEGLIGIBLE = 1e-9  # of all mass, in a cell: cells with less are left out when members are counted


def alphas(n: int, gamma: float = 0.5) -> Array:
    """The exponents' inverses alpha_1..alpha_n, alpha_q = alpha_{q-1} / gamma, summing to 1, for 0 < gamma <= 1 (V-C)."""
    if not 0 < gamma <= 1:
        raise OpinionError(f"gamma {gamma}: give the ratio of two alphas, above 0 and at most 1")
    falling = float(gamma) ** np.arange(n - 1, -1, -1)  # (V-C): alpha_q = alpha_{q-1} / gamma
    return np.asarray(np.maximum(falling / falling.sum(), 1e-300))  # far too small to matter, and 1 / alpha is finite


def relative_to_peak(opinions: Array, gate: float) -> Array:
    """Opinions (N, *grid shape), each with mass exp(-gate) at its own peak; gate in nats."""
    peaks = opinions.reshape(len(opinions), -1).max(axis=1)
    return np.asarray(opinions * (math.exp(-positive(gate, "gate")) / peaks).reshape(-1, *(1,) * (opinions.ndim - 1)))


def triangular_alphas(n: int) -> Array:
    """alpha_1..alpha_n in the proportion of the triangular numbers q (q + 1) / 2, summing to 1 (docs/paper.md, "The gate")."""
    triangular = np.cumsum(np.arange(1.0, n + 1))  # q (q + 1) / 2
    return np.asarray(triangular / triangular.sum())


def powered_components(
    opinions: Array, weights: npt.ArrayLike | None, alpha: npt.ArrayLike, cell_ratio: float = 1.0
) -> Array:
    """The logarithms of C_q^(1/alpha_q), q = 1..N, shape (N, cells); COP is the normalised sum of their exponentials.

    opinions (N, *grid shape), checked; alpha (N,). Rounding grows with the exponent: a term is off by about
    |ln C_q| / alpha_q times 2e-16, relatively.
    """
    # (V-.2): ln C_q^(1/alpha_q)
    return np.asarray(log_components(opinions, weights, cell_ratio) / np.reshape(alpha, (len(opinions), 1)))


def log_components(opinions: Array, weights: npt.ArrayLike | None, cell_ratio: float = 1.0) -> Array:
    """The logarithms of C_1..C_N, shape (N, cells), as mass per reference cell."""
    n = len(opinions)
    p, w = opinions.reshape(n, -1), shares(weights, n)
    logs = np.empty_like(p)
    for start in range(0, p.shape[1], BLOCK):
        block = slice(start, start + BLOCK)
        logs[:, block] = _log_components(p[:, block], w)
    # as mass per reference cell each of the q factors of C_q is v_ref / v_cell times as large
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
    """As `_log_components`, for cells in which the products of the ratios underflow."""
    order, ratios = _sorted_ratios(p)
    p = np.take_along_axis(p, order, axis=0)
    return np.asarray(np.cumsum(logarithm(p), axis=0) + logarithm(_subset_sums(ratios, weights[order], p.shape[1])))


def _sorted_ratios(p: Array) -> tuple[Array, list[Array]]:
    """The order of the opinions (N, cells) in each cell, the largest first, and for each its ratios P_j / P_q, q = 1..j."""
    order = np.argsort(-p, axis=0, kind="stable")
    p = np.take_along_axis(p, order, axis=0)
    return order, [p[j] / np.maximum(p[: j + 1], TINY) for j in range(len(p))]


def _subset_sums(ratios: Iterable[Array], weights: Array, cells: int) -> Array:
    """W_1..W_N by the two recursions, shape (N, cells).

    For each opinion j its ratio to the scale of every step q = 1..j, (cells,) or (j, cells), and its weight, () or (cells,).
    """
    products, weighted = np.zeros((2, len(weights) + 1, cells))  # E_q, W_q
    products[0] = 1.0
    for j, (ratio, weight) in enumerate(zip(ratios, weights, strict=True)):
        # W_q += P_j (W_{q-1} + w_j E_{q-1}), then E_q += P_j E_{q-1}
        weighted[1 : j + 2] += ratio * (weighted[: j + 1] + weight * products[: j + 1])
        products[1 : j + 2] += ratio * products[: j + 1]
    return np.asarray(weighted[1:])


def memberships(opinions: Array, weights: npt.ArrayLike | None, mass: Array) -> Array:
    """The mass of the coalitions that each opinion is in, shape (N,), for a mass (N, cells) of each component q in each cell.

    The mass of a component in a cell falls to the subsets of q opinions in proportion to their terms of C_q (V-.2): an opinion is
    given that of all subsets with it. opinions (N, *grid shape) and weights as they were given to `log_components`.
    """
    n = len(opinions)
    in_cell = mass.sum(axis=0)
    heavy = np.flatnonzero(in_cell > NEGLIGIBLE / len(in_cell) * in_cell.sum())
    p, w, mass = opinions.reshape(n, -1)[:, heavy], shares(weights, n), mass[:, heavy] / in_cell[heavy].sum()
    found = np.zeros(n)
    for start in range(0, len(heavy), BLOCK):
        block = slice(start, start + BLOCK)
        found += _memberships(p[:, block], w, mass[:, block])
    return found


def _memberships(p: Array, weights: Array, mass: Array) -> Array:
    """The memberships in a block of cells, for opinions (N, cells): the recursion with its steps kept, then backwards."""
    n, cells = p.shape
    order, ratios = _sorted_ratios(p)
    w = weights[order]
    steps = [(np.zeros((n + 1, cells)), np.zeros((n + 1, cells)))]  # E_q and W_q before each opinion
    steps[0][0][0] = 1.0
    for j, ratio in enumerate(ratios):
        products, weighted = (values.copy() for values in steps[-1])
        weighted[1 : j + 2] += ratio * (weighted[: j + 1] + w[j] * products[: j + 1])  # as in `_subset_sums`
        products[1 : j + 2] += ratio * products[: j + 1]
        steps.append((products, weighted))
    at_products, at_weighted = np.zeros((2, n + 1, cells))  # derivatives of the mass in E_q and W_q
    last = steps[-1][1][1:]
    np.divide(mass, last, out=at_weighted[1:], where=last > LEAST_PRODUCT)
    found = np.zeros((n, cells))
    for j in range(n - 1, -1, -1):
        products, weighted = steps[j]
        # P_j dC_q/dP_j: the part of C_q (V-.2) that comes from subsets with opinion j
        to_products, to_weighted = ratios[j] * at_products[1 : j + 2], ratios[j] * at_weighted[1 : j + 2]
        found[j] = (to_weighted * (weighted[: j + 1] + w[j] * products[: j + 1]) + to_products * products[: j + 1]).sum(
            axis=0
        )
        at_products[: j + 1] += to_products + w[j] * to_weighted
        at_weighted[: j + 1] += to_weighted
    by_opinion = np.zeros((n, cells))
    np.put_along_axis(by_opinion, order, found, axis=0)
    return np.asarray(by_opinion.sum(axis=1))
