"""The slow and obvious versions: written as the formulas are, without regard to speed; they judge the fast ones."""

import math
from collections.abc import Iterator, Sequence
from decimal import Context, Decimal, localcontext
from itertools import combinations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: So many digits, and exponents so wide, that neither rounding nor underflow is left.
EXACT = Context(prec=50, Emin=-(10**12), Emax=10**12)


def entropy(p: Array) -> float:
    """(III-.2), summed without rounding."""
    return -math.fsum(x * math.log(x) for x in p.ravel().tolist() if x > 0)


def cooperative_terms(
    opinions: Array, weights: Sequence[float], alpha: Sequence[float], cell_ratio: float = 1.0
) -> list[list[Decimal]]:
    """C_q^(1/alpha_q) of (V-.2) for q = 1..N in every cell, by going through all subsets as the paper writes them."""
    n = len(opinions)
    with localcontext(EXACT):
        total = sum((Decimal(w) for w in weights), Decimal(0))
        w = [Decimal(x) / total for x in weights]
        p = [[Decimal(x) * Decimal(cell_ratio) for x in opinion.ravel().tolist()] for opinion in opinions]
        exponents = [1 / Decimal(float(a)) for a in alpha]
        return [[_component(p, w, cell, q) ** exponents[q - 1] for cell in range(len(p[0]))] for q in range(1, n + 1)]


def _component(p: list[list[Decimal]], w: list[Decimal], cell: int, q: int) -> Decimal:
    """C_q in one cell: over all subsets of q opinions, the sum of their weights times the product of their values."""
    total = Decimal(0)
    for subset in combinations(range(len(p)), q):
        product = Decimal(1)
        for i in subset:
            product *= p[i][cell]
        total += product if q == len(p) else sum((w[i] for i in subset), Decimal(0)) * product
    return total


def cooperative(terms: list[list[Decimal]]) -> tuple[Array, Array]:
    """The COP of these terms, flat, and the share of each component in its mass."""
    with localcontext(EXACT):
        total = sum((x for term in terms for x in term), Decimal(0))
        pool = [float(sum(column, Decimal(0)) / total) for column in zip(*terms, strict=True)]
        return np.array(pool), np.array([float(sum(term, Decimal(0)) / total) for term in terms])


def product(opinions: Array, weights: Sequence[float]) -> Array:
    """prod_i P_i^w_i of positive opinions, normalised, in the grid's shape."""
    columns = opinions.reshape(len(opinions), -1).T.tolist()
    logs = [math.fsum(w * math.log(x) for w, x in zip(weights, column, strict=True)) for column in columns]
    cells = [math.exp(log - max(logs)) for log in logs]
    return np.array([cell / math.fsum(cells) for cell in cells]).reshape(opinions.shape[1:])


def cliques(near: npt.NDArray[np.bool_]) -> list[tuple[int, ...]]:
    """All largest sets of nodes that are pairwise near, by trying all sets, in ascending order."""
    n = len(near)
    for size in range(n, 0, -1):
        largest = [s for s in combinations(range(n), size) if all(near[i, j] for i, j in combinations(s, 2))]
        if largest:
            return largest
    return []


def densest_region(p: Array, mass: float) -> Iterator[int]:
    """The cells of the highest-density region: the densest first, whole groups of equals, until `mass` is reached."""
    reached = 0.0
    for value in sorted(set(p.ravel().tolist()), reverse=True):
        if reached >= mass:
            return
        group = np.flatnonzero(p.ravel() == value)
        yield from (int(i) for i in group)
        reached += value * len(group)


def random_walk(n: int, variance: float) -> Array:
    """What becomes of mass in each of n cells between two walls, shape (n, n): 2^20 little steps to either side."""
    steps = 1 << 20
    rate = variance / 2 / steps
    step = np.eye(n) * (1 - 2 * rate) + rate * (np.eye(n, k=1) + np.eye(n, k=-1))
    step[0, 0] += rate
    step[-1, -1] += rate
    return np.linalg.matrix_power(step, steps)


def memberships(opinions: Array, weights: Sequence[float], mass: Array) -> Array:
    """The mass (N, cells) of each component in each cell, given to the subsets of q opinions by their terms of C_q (V-.2): what the
    subsets with each opinion hold together, shape (N,).
    """
    n = len(opinions)
    w = [Decimal(x) / sum((Decimal(x) for x in weights), Decimal(0)) for x in weights]
    p = [[Decimal(x) for x in opinion.ravel().tolist()] for opinion in opinions]
    masses = [Decimal(0)] * n
    with localcontext(EXACT):
        for q in range(1, n + 1):
            for cell in range(len(p[0])):
                terms = {
                    s: sum((w[i] for i in s), Decimal(0)) * _product(p, s, cell) for s in combinations(range(n), q)
                }
                total = sum(terms.values(), Decimal(0))
                for subset, term in terms.items():
                    for i in subset:
                        masses[i] += Decimal(float(mass[q - 1, cell])) * term / total if total else 0
    return np.array([float(x) for x in masses])


def _product(p: list[list[Decimal]], subset: Sequence[int], cell: int) -> Decimal:
    value = Decimal(1)
    for i in subset:
        value *= p[i][cell]
    return value
