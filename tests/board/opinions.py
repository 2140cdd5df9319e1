"""Opinions of several sources about one object, tick by tick, with errors as a test wants them."""

import math
from collections.abc import Iterator

import numpy as np

from blackboard.opinion.belief import gaussian
from blackboard.opinion.provenance import Opinion
from tests.board.reports import GRID

CENTRE = (20.0, 15.0)


def opinion(source: str, mean: tuple[float, float], sigma: float = 2.0, age: float = 0.0) -> Opinion:
    return Opinion(source, gaussian(GRID, mean, sigma), {source: 0.0}, age)


def stream(
    n: int, ticks: int, *, seed: int = 1, echoes: int = 0, liar: float = 0.0, factor: float = 1.0, memory: float = 0.0
) -> Iterator[list[Opinion]]:
    """Opinions of n sources in each tick: the first `echoes` repeat the last one, and the first is `liar` cells off."""
    rng = np.random.default_rng(seed)
    errors = rng.standard_normal((n, 2))
    for _ in range(ticks):
        errors = memory * errors + math.sqrt(1 - memory**2) * rng.standard_normal((n, 2))
        means = np.array(CENTRE) + 2.0 * factor * errors
        means[:echoes] = means[-1]
        means[0, 0] += liar
        means = np.clip(means, 0, GRID.shape)
        yield [opinion(f"s{i}", (float(x), float(y))) for i, (x, y) in enumerate(means)]
