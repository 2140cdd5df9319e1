"""The components of the Cooperative Opinion Pool, exactly, in O(m N^2) steps for N opinions on m cells, and each opinion's part.

The paper sums over every subset of q opinions (V-.2). With E_0 = 1 and all else 0, the same components come from

    W_q += P_j (W_{q-1} + w_j E_{q-1})        E_q += P_j E_{q-1}        for each opinion j, q downwards

where E_q is the sum of all products of q opinions and W_q the same with the weights of each product: C_q = W_q. All terms
are non-negative, so nothing cancels.

The magnitudes span hundreds of decades (1 / alpha_1 = 2^N - 1). So only ratios of at most 1 are multiplied, and the rest is
done with logarithms: each cell is scaled by its largest opinion. Where opinions differ so much in a cell that even the products
of these ratios would underflow, the cell sorts its opinions, P_1 >= P_2 >= ..., and keeps E_q and W_q relative to P_1 P_2 ...
P_q, the largest product of q there is: E_q is then between 1 and the number of subsets. Both are exact to rounding.

C_q is linear in each opinion, so P_i dC_q/dP_i is the part of C_q that comes from subsets with opinion i in them. The recursion
run backwards (reverse differentiation) gives it for all opinions at once, again with non-negative terms only.
"""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError
from blackboard.opinion.grid import Array
from blackboard.opinion.vectors import logarithm, positive, shares

TINY = 5e-324  # the smallest positive float: x / max(x, TINY) is 1, and 0 for x = 0
LEAST_PRODUCT = 1e-280  # of a cell's ratios, for the simple scaling: 1e-308 is where floats end
CACHED = 1 << 15  # values of E_q worked on at a time, 256 kB, where no steps are kept
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
    return np.asarray(opinions * to_peak(opinions, gate).reshape(-1, *(1,) * (opinions.ndim - 1)))


def to_peak(opinions: Array, gate: float) -> Array:
    """What each of opinions (N, *grid shape) is multiplied with in `relative_to_peak`, shape (N,)."""
    peaks = opinions.reshape(len(opinions), -1).max(axis=1)
    return np.asarray(math.exp(-positive(gate, "gate")) / peaks)


def triangular_alphas(n: int) -> Array:
    """alpha_1..alpha_n in the proportion of the triangular numbers q (q + 1) / 2, summing to 1 (docs/paper.md, "The gate")."""
    triangular = np.cumsum(np.arange(1.0, n + 1))  # q (q + 1) / 2
    return np.asarray(triangular / triangular.sum())


def log_components(opinions: Array, weights: npt.ArrayLike | None, cell_ratio: float = 1.0, first: int = 1) -> Array:
    """The logarithms of C_first..C_N, from C_1 on unless said otherwise, shape (N - first + 1, cells), as mass per reference cell."""
    n = len(opinions)
    p, w = opinions.reshape(n, -1), shares(weights, n)
    logs = np.empty((n - first + 1, p.shape[1]))
    if 2 * first > n:
        for block in _blocks(2 * (n - first) + 1, p.shape[1]):
            logs[:, block] = _log_last(p[:, block], w, first)
    else:
        for block in _blocks(n, p.shape[1]):
            logs[:, block] = _log_components(p[:, block], w)[first - 1 :]
    if cell_ratio != 1.0:  # as mass per reference cell each of the q factors of C_q is v_ref / v_cell times as large
        logs += np.arange(first, n + 1)[:, np.newaxis] * math.log(positive(cell_ratio, "cell_ratio"))
    return logs


def _blocks(n: int, cells: int) -> Iterator[slice]:
    """So many cells at a time that what the recursion keeps of them for n opinions stays in the processor's cache."""
    size = max(64, CACHED // (n + 1))
    return (slice(start, start + size) for start in range(0, cells, size))


def _log_products(p: Array) -> Array:
    """The logarithm of the product of the opinions (N, cells), shape (cells,)."""
    product = p.prod(axis=0)
    logs = logarithm(product)
    small = ~(product > LEAST_PRODUCT)  # it may have lost digits on the way
    if small.any():
        logs[small] = logarithm(p.compress(small, axis=1)).sum(axis=0)
    return logs


def _log_last(p: Array, weights: Array, first: int) -> Array:
    """The logarithms of C_first..C_N alone for opinions (N, cells), shape (N - first + 1, cells), by those that a subset lacks.

    The subsets of N - r opinions are those that lack r. With x_j = min P / P_j, and E_r the sum of all products of r of the x_j,

        V_r += w_j E_r + x_j V_{r-1}        E_r += x_j E_{r-1}        for each opinion j, r downwards

    sums up, for each r that are lacking, the weights of all others: C_{N-r} = P_1 ... P_N V_r / (min P)^r. Nothing cancels here
    either.
    """
    n, cells = p.shape
    lacking = n - first
    products = _log_products(p)
    if lacking == 0:
        return products[np.newaxis]
    least = p.min(axis=0)
    ratios = least / np.maximum(p, TINY)
    both, step, room = np.zeros((2, lacking + 1, cells)), np.empty((2, lacking, cells)), np.empty((lacking + 1, cells))
    sums, weighted = both  # E_r, V_r
    sums[0] = 1.0
    for ratio, weight in zip(ratios, weights, strict=True):
        np.multiply(sums, weight, out=room)
        np.multiply(both[:, :-1], ratio, out=step)
        both[:, 1:] += step
        weighted += room
    logs = logarithm(weighted[::-1])
    logs += products
    with np.errstate(invalid="ignore"):
        logs -= np.arange(lacking, -1.0, -1.0)[:, np.newaxis] * logarithm(least)
    wide = ~((least / np.maximum(p.max(axis=0), TINY)) ** lacking > LEAST_PRODUCT)
    if wide.any():
        logs[:, wide] = _log_components_sorted(p.compress(wide, axis=1), weights)[first - 1 :]
    return logs


def _log_components(p: Array, weights: Array) -> Array:
    """The logarithms of C_1..C_N for opinions (N, cells), shape (N, cells); see the top of this file."""
    top = p.max(axis=0)
    ratios = p / np.maximum(top, TINY)
    logs = logarithm(_subset_sums(ratios, weights, len(top)))
    logs += np.arange(1, len(p) + 1)[:, np.newaxis] * logarithm(top)
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
    room = np.empty((len(weights), cells))
    for j, (ratio, weight) in enumerate(zip(ratios, weights, strict=True)):
        _take_in(products, weighted, room, j, ratio, weight)
    return np.asarray(weighted[1:])


def _take_in(products: Array, weighted: Array, room: Array, j: int, ratio: Array, weight: Array) -> None:
    """One step of both recursions in place, from j opinions to j + 1; `room` is overwritten."""
    below, step = slice(j + 1), room[: j + 1]
    np.multiply(products[below], weight, out=step)
    step += weighted[below]
    step *= ratio
    weighted[1 : j + 2] += step  # W_q += P_j (W_{q-1} + w_j E_{q-1})
    np.multiply(products[below], ratio, out=step)
    products[1 : j + 2] += step  # E_q += P_j E_{q-1}


def memberships(
    opinions: Array, weights: npt.ArrayLike | None, mass: Array, first: int = 1, size: int | None = None
) -> Array:
    """The mass of the coalitions that each opinion is in, shape (N,), for a mass of each component from `first` on in each cell.

    The mass of a component in a cell falls to the subsets of q opinions in proportion to their terms of C_q (V-.2): an opinion is
    given that of all subsets with it. opinions (N, *grid shape) and weights as they were given to `log_components`, mass
    (N - first + 1, cells). size: the number of cells of the grid, where those without mass are left out.
    """
    n = len(opinions)
    if first == n > 1:  # all of it is held by all of them
        return np.ones(n)
    in_cell = mass.sum(axis=0)
    heavy = np.flatnonzero(in_cell > NEGLIGIBLE / (size or len(in_cell)) * in_cell.sum())
    p, w = opinions.reshape(n, -1).take(heavy, axis=1), shares(weights, n)
    mass = mass.take(heavy, axis=1) / in_cell[heavy].sum()
    totals = np.zeros(n)
    for start in range(0, len(heavy), BLOCK):
        block = slice(start, start + BLOCK)
        totals += _memberships(p[:, block], w, mass[:, block], first)
    return totals


def _memberships(p: Array, weights: Array, mass: Array, first: int) -> Array:
    """The memberships in a block of cells, for opinions (N, cells): the recursion with its steps kept, then backwards."""
    n, cells = p.shape
    order, ratios = _sorted_ratios(p)
    w = weights[order]
    steps = np.zeros((2, n + 1, n + 1, cells))  # E_q and W_q before each opinion, and after the last
    steps[0, 0, 0] = 1.0
    room = np.empty((n, cells))
    for j, ratio in enumerate(ratios):
        steps[:, j + 1] = steps[:, j]
        _take_in(steps[0, j + 1], steps[1, j + 1], room, j, ratio, w[j])
    at_products, at_weighted = np.zeros((2, n + 1, cells))  # derivatives of the mass in E_q and W_q
    last = steps[1, n, first:]
    np.divide(mass, last, out=at_weighted[first:], where=last > LEAST_PRODUCT)
    shares = np.zeros((n, cells))
    for j in range(n - 1, -1, -1):
        products, weighted = steps[:, j]
        # P_j dC_q/dP_j: the part of C_q (V-.2) that comes from subsets with opinion j
        to_products, to_weighted = ratios[j] * at_products[1 : j + 2], ratios[j] * at_weighted[1 : j + 2]
        shares[j] = (
            to_weighted * (weighted[: j + 1] + w[j] * products[: j + 1]) + to_products * products[: j + 1]
        ).sum(axis=0)
        at_products[: j + 1] += to_products + w[j] * to_weighted
        at_weighted[: j + 1] += to_weighted
    by_opinion = np.zeros((n, cells))
    np.put_along_axis(by_opinion, order, shares, axis=0)
    return np.asarray(by_opinion.sum(axis=1))
