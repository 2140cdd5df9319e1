"""How fast the pools are: ratios to print, none to assert. Run `python benchmarks/bench_pools.py` from the repository.

Processor seconds, the best of several runs; ratios compare on one machine only.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from timeit import repeat

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from blackboard import POOLS, Grid, cooperative_pool, entropy_weights, linear_pool
from blackboard.opinion.belief import gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.components import alphas
from blackboard.opinion.grid import Array
from tests import oracles


def team(n: int, side: int, rng: np.random.Generator) -> Array:
    """Opinions of n robots about one place on side x side cells, floored as after the wire."""
    grid = Grid((side, side))
    around = rng.normal(side / 2, 3, (n, 2))
    stack = np.stack([gaussian(grid, tuple(c), s).p for c, s in zip(around, rng.uniform(1.5, 4, n), strict=True)])
    return 0.999999 * stack + 0.000001 / grid.size


def milliseconds(call: Callable[..., object], *arguments: object, number: int = 5) -> float:
    return 1e3 * min(repeat(lambda: call(*arguments), number=number, repeat=5, timer=time.process_time)) / number


def main() -> None:
    rng = np.random.default_rng(0)
    print("COP by the recursion against the sum over all subsets (12 cells; the oracle counts with 50 digits)")
    for n in (3, 6, 10):
        p = rng.random((n, 12))
        p /= p.sum(axis=1, keepdims=True)
        fast = milliseconds(cooperative_pool, p)
        slow = milliseconds(oracles.cooperative_terms, p, [1.0] * n, alphas(n).tolist(), number=1)
        print(f"  N = {n:2}: {fast:8.3f} ms, subsets {slow:9.3f} ms: {slow / fast:8.0f} times")
    print("COP against LOP, both with their weights (III-A.1) given")
    for n, side in ((3, 50), (6, 50), (6, 200), (30, 200)):
        p = team(n, side, rng)
        w = entropy_weights(p, 2.0)
        cop, lop = milliseconds(cooperative_pool, p, w), milliseconds(linear_pool, p, w)
        print(f"  N = {n:2}, {side} x {side}: {cop:8.3f} ms, LOP {lop:7.3f} ms: {cop / lop:5.1f} times")
    print("two opinions, Chernoff")
    for side in (50, 200):
        print(f"  {side} x {side}: {milliseconds(chernoff, *team(2, side, rng)):.3f} ms")
    print("every rule, N = 5, 50 x 50")
    p = team(5, 50, rng)
    for name, rule in POOLS.items():
        print(f"  {name:17} {milliseconds(rule, p):7.3f} ms")


if __name__ == "__main__":
    main()
