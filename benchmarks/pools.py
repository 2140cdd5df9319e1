"""What does the Cooperative Opinion Pool cost, against the pools that the paper compares it with? `python benchmarks/pools.py`.

Processor time, one thread, the best of turns. LGP is `exp(w @ log P)` and LOP `w @ P` in NumPy, without any check; COP and the
default rule are the functions that the package offers, with their checks and normalised. The opinions are Gaussians of sigma 2 to 6
cells about one place on 200 x 200 cells, as they are ("computed") and as a board reads them from a message ("received"), and
dense random ones.
"""

from collections.abc import Iterator
from functools import partial
from itertools import combinations

import numpy as np
from ratios import Measured, milliseconds, show

from blackboard import POOLS, Grid, cooperative_pool, entropy_weights
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.components import alphas
from blackboard.opinion.grid import Array
from blackboard.opinion.pools import fuse
from blackboard.opinion.rules import read_rule
from blackboard.wire.arrays import pack, unpack

GRID = Grid((200, 200))
SIZES = (4, 8, 16, 32)


def team(kind: str, n: int, grid: Grid = GRID) -> Array:
    """Opinions of n robots about one place, (n, *grid shape)."""
    rng = np.random.default_rng(n)
    if kind == "dense":
        p = rng.random((n, *grid.shape))
        return np.asarray(p / p.sum(axis=(1, 2), keepdims=True))
    around = rng.normal(grid.shape[0] / 2, 3, (n, 2))
    beliefs = [gaussian(grid, tuple(c), s) for c, s in zip(around, rng.uniform(2, 6, n), strict=True)]
    return np.stack([(unpack(pack(b)) if kind == "received" else b).p for b in beliefs])


def logarithmic(p: Array, w: Array) -> Array:
    """LGP as NumPy says it, not normalised."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(w @ np.log(p)))


def enumerated(p: Array, w: Array) -> Array:
    """COP as the paper writes it: the sum over every subset, of opinions (N, cells)."""
    n, alpha = len(p), alphas(len(p))
    total = np.zeros(p.shape[1])
    for q in range(1, n + 1):
        subsets = combinations(range(n), q)
        c = sum((w[list(s)].sum() * p[list(s)].prod(axis=0) for s in subsets), np.zeros(p.shape[1]))
        total += c ** (1 / alpha[q - 1])  # (V-.2)
    return total


def rows() -> Iterator[Measured]:
    asked = {
        ("received", 8): 2.0,
        ("computed", 8): 2.0,
        ("received", 20): 3.0,
        ("computed", 20): 3.0,
        ("dense", 8): 6.0,
    }
    for kind in ("received", "computed", "dense"):
        for n in (8, 20):
            p = team(kind, n)
            w, flat = entropy_weights(p, 2.0), p.reshape(n, -1)
            lgp, lop, cop, coalition, fusion = milliseconds(
                partial(logarithmic, flat, w),
                partial(np.matmul, w, flat),
                partial(cooperative_pool, p, w),
                partial(POOLS["coalition"], p, w, gate=4.0, independence=0.2),
                partial(fuse, read_rule({"rule": "coalition"}), p, GRID),
            )
            about = f"{kind}, N = {n}"
            yield Measured(f"COP / LGP, {about} (LGP {lgp:.2f} ms)", cop / lgp, most=asked.get((kind, n)))
            yield Measured(f"COP / LOP, {about}", cop / lop)
            yield Measured(f"the default rule / COP, {about}", coalition / cop, most=1.5)
            yield Measured(f"a board's fusion by it, with its weights and story / LGP, {about}", fusion / lgp)
    p = team("received", 12)
    w, flat = entropy_weights(p, 2.0), p.reshape(12, -1)
    slow, fast = milliseconds(partial(enumerated, flat, w), partial(cooperative_pool, p, w), rounds=2)
    yield Measured("all subsets / COP, received, N = 12", slow / fast, least=20.0)
    for kind in ("received", "dense"):
        stacks = [team(kind, n) for n in SIZES]
        times = milliseconds(*(partial(cooperative_pool, p, np.ones(len(p))) for p in stacks))
        slope = float(np.polyfit(np.log(SIZES), np.log(times), 1)[0])
        yield Measured(f"COP grows as N to the power of, {kind}, N = {SIZES[0]} to {SIZES[-1]}", slope, "", most=2.0)


def main() -> None:
    show(rows())
    small = Grid((50, 50))
    p = team("received", 5, small)
    names = list(POOLS)
    print("every rule, N = 5, 50 x 50, ms:", end=" ")
    times = milliseconds(*(partial(POOLS[name], p) for name in names))
    print(", ".join(f"{name} {ms:.2f}" for name, ms in zip(names, times, strict=True)))
    belief_small = Belief(small, p[0])
    print(f"pack and unpack a belief of 50 x 50: {milliseconds(lambda: unpack(pack(belief_small)))[0]:.2f} ms")


if __name__ == "__main__":
    main()
