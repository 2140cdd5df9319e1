"""Cases: opinions about one subject at one instant, and the truth. Pure; chance is an argument.

A run is what one seed (or one stretch of a recording) gives: one case in the made-up trials below, many from a team.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array, Grid


@dataclass(frozen=True, eq=False)
class Case:
    """Opinions (N, *grid shape) of `sources` about `subject`, the first of them by the source whose gain is asked for."""

    grid: Grid
    subject: str
    time: float  # seconds
    sources: tuple[str, ...]
    opinions: Array
    truth: tuple[float, ...]  # in the grid's unit


Run = list[Case]
Trial = Callable[[np.random.Generator], Case]

GRID = Grid((50, 50))  # cells
SOURCES = 5
SIGMA = (1.5, 4.0)  # cells, drawn for each source
MARGIN = 15.0  # cells between the truth and the border, so that no opinion is cut off there
CORRELATION = 0.8  # of the errors of any two sources
LIE, LIAR_SIGMA = 12.0, 1.2  # cells: how far off a liar is, and how sure


def independent(chance: np.random.Generator) -> Case:
    """Five honest sources: each error is what its sigma says, and its own."""
    truth, sigmas = _draw(chance)
    return _case(truth, truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2)), sigmas)


def correlated(chance: np.random.Generator) -> Case:
    """Honest one by one, but their errors have a common part (a wrong map, a shared calibration)."""
    truth, sigmas = _draw(chance)
    own, common = chance.standard_normal((SOURCES, 2)), chance.standard_normal(2)
    errors = math.sqrt(1 - CORRELATION) * own + math.sqrt(CORRELATION) * common
    return _case(truth, truth + sigmas[:, None] * errors, sigmas)


def echoes(chance: np.random.Generator) -> Case:
    """Two honest sources, of which one speaks four times: what gossip makes of one observation."""
    truth, sigmas = _draw(chance)
    sigmas[1:4] = sigmas[0]
    means = truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2))
    means[1:4] = means[0]
    return _case(truth, means, sigmas)


def liar(chance: np.random.Generator) -> Case:
    """Four honest sources and one that is sure of a place 12 cells off."""
    return _lied(chance, 1)


def collusion(chance: np.random.Generator) -> Case:
    """Three honest sources and two that are sure of the same wrong place."""
    return _lied(chance, 2)


#: The trials that every rule is put to; `../shared/theory.md` has reference results for the same five.
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
    angle = chance.uniform(0, 2 * math.pi)
    means = truth + sigmas[:, None] * chance.standard_normal((SOURCES, 2))
    means[:liars] = truth + LIE * np.array([math.cos(angle), math.sin(angle)])
    sigmas[:liars] = LIAR_SIGMA
    return _case(truth, means, sigmas)


def _case(truth: Array, means: Array, sigmas: Array) -> Case:
    opinions = np.stack([gaussian(GRID, mean, float(sigma)).p for mean, sigma in zip(means, sigmas, strict=True)])
    names = tuple(f"s{i + 1}" for i in range(len(means)))
    return Case(GRID, "object/target", 0.0, names, opinions, tuple(truth.tolist()))
