"""How much the exact recursion saves against the paper's 2^N subsets, and what COP costs beside LOP: ratios, not seconds.

python benchmarks/bench_pools.py
"""

from __future__ import annotations

import itertools
import sys
import timeit
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from blackboard import cooperative_pool, linear_pool
from blackboard.opinion.cooperative import alphas


def opinions(n: int, cells: int) -> np.ndarray:
    """Overlapping Gaussians on a line."""
    x = np.arange(cells)
    p = np.exp(-0.5 * ((x - cells / 2 - 3 * np.arange(n)[:, None]) / (cells / 10)) ** 2)
    return np.asarray(p / p.sum(axis=1, keepdims=True))


def subsets(p: np.ndarray) -> np.ndarray:
    """COP as the paper writes it, one product for each subset, equal weights."""
    n = len(p)
    total = np.zeros(p.shape[1])
    for q, alpha in enumerate(alphas(n), start=1):
        chosen = itertools.combinations(range(n), q)
        total += sum((q / n) * p[list(s)].prod(axis=0) for s in chosen) ** (1 / alpha)
    return np.asarray(total / total.sum())


def seconds(work: Callable[[], object]) -> float:
    """The best of five."""
    return min(timeit.repeat(work, number=3, repeat=5)) / 3


def main() -> None:
    print("   N   subsets / recursion   COP / LOP")
    for n in (2, 4, 6, 8, 10):
        p = opinions(n, 2500)
        cop = seconds(lambda p=p: cooperative_pool(p))  # type: ignore[misc]
        slow = seconds(lambda p=p: subsets(p))  # type: ignore[misc]
        lop = seconds(lambda p=p: linear_pool(p))  # type: ignore[misc]
        print(f"{n:4}   {slow / cop:19.1f}   {cop / lop:9.1f}")


if __name__ == "__main__":
    main()
