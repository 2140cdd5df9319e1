"""Cases: what several sources believe about one subject at one instant, and the truth. Pure; chance is an argument.

A run is what one seed, or one stretch of a recording, gives: one case in the trials below, many from a team.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array, Grid


@dataclass(frozen=True, eq=False)
class Case:
    """Opinions (N, *grid shape) of N sources about a subject, in the order of `sources`."""

    grid: Grid
    subject: str
    time: float  # seconds
    sources: tuple[str, ...]
    opinions: Array
    truth: tuple[float, ...]  # in the grid's unit
    common: Array | None = None  # (M, *grid shape): what is known to be counted M times too often

    def of(self, sources: Collection[str]) -> Case:
        """The same with the opinions of these sources only."""
        kept = [i for i, source in enumerate(self.sources) if source in sources]
        return replace(self, sources=tuple(self.sources[i] for i in kept), opinions=self.opinions[kept])


Run = list[Case]
Trial = Callable[[np.random.Generator], Case]

GRID = Grid((50, 50))  # cells
SOURCES = 5
SIGMA = (1.5, 4.0)  # cells, drawn for each source
MARGIN = 15.0  # cells between the truth and the border, so that no opinion is cut off there
CORRELATION = 0.8  # of the errors of any two sources, relative to their sigmas
LIE, LIAR_SIGMA = 12.0, 1.2  # cells: how far off a liar is, and how sure


def independent(chance: np.random.Generator) -> Case:
    """Five honest sources: the error of each is what its sigma says, and its own."""
    truth, sigmas = _draw(chance)
    return _case(truth, truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2)), sigmas)


def correlated(chance: np.random.Generator) -> Case:
    """Honest one by one, but their errors have a common part: a wrong map, a shared calibration."""
    truth, sigmas = _draw(chance)
    own, common = chance.standard_normal((SOURCES, 2)), chance.standard_normal(2)
    errors = math.sqrt(1 - CORRELATION) * own + math.sqrt(CORRELATION) * common
    return _case(truth, truth + sigmas[:, None] * errors, sigmas)


def echoes(chance: np.random.Generator) -> Case:
    """Two honest sources, of which one is heard four times: what gossip makes of one observation."""
    truth, sigmas = _draw(chance)
    means = truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2))
    sigmas[1:4], means[1:4] = sigmas[0], means[0]
    case = _case(truth, means, sigmas)
    return replace(case, common=case.opinions[1:4])


def liar(chance: np.random.Generator) -> Case:
    """Four honest sources, and one that is sure of a place 12 cells off."""
    return _lied(chance, 1)


def collusion(chance: np.random.Generator) -> Case:
    """Three honest sources, and two that are sure of the same wrong place."""
    return _lied(chance, 2)


#: The trials that every rule is put to.
TRIALS: dict[str, Trial] = {
    "independent": independent,
    "correlated": correlated,
    "echoes": echoes,
    "one liar": liar,
    "two collude": collusion,
}


def _draw(chance: np.random.Generator) -> tuple[Array, Array]:
    """The truth, shape (2,), and the sources' sigmas, shape (SOURCES,)."""
    truth = np.array([chance.uniform(MARGIN, n - MARGIN) for n in GRID.shape])
    return truth, chance.uniform(*SIGMA, SOURCES)


def _lied(chance: np.random.Generator, liars: int) -> Case:
    truth, sigmas = _draw(chance)
    means = truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2))
    angle = chance.uniform(0, 2 * math.pi)
    means[:liars] = truth + LIE * np.array([math.cos(angle), math.sin(angle)])
    sigmas[:liars] = LIAR_SIGMA
    return _case(truth, means, sigmas)


def _case(truth: Array, means: Array, sigmas: Array) -> Case:
    opinions = np.stack([gaussian(GRID, mean, float(sigma)).p for mean, sigma in zip(means, sigmas, strict=True)])
    names = tuple(f"s{i + 1}" for i in range(len(means)))
    x, y = truth.tolist()
    return Case(GRID, "object/target", 0.0, names, opinions, (x, y))
