"""Cases: what several sources believe about one subject at one instant, and the truth. Pure; the random generator is an argument.

A run is what one seed, or one stretch of a recording, gives: one case in the trials below, many from a team.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial

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
    common: Array | None = None  # (M, *grid shape): known pieces of information, each counted once too often

    def __post_init__(self) -> None:
        if self.opinions.shape != (len(self.sources), *self.grid.shape):
            raise ValueError(
                f"case of {len(self.sources)} sources on a grid of {self.grid.shape}: opinions of shape {self.opinions.shape}"
            )

    @property
    def asked(self) -> tuple[float, str]:
        """The time, rounded to milliseconds, and the subject: what other beliefs about the same are found by."""
        return round(self.time, 3), self.subject

    def of(self, sources: Collection[str]) -> Case:
        kept = [i for i, source in enumerate(self.sources) if source in sources]
        return replace(self, sources=tuple(self.sources[i] for i in kept), opinions=self.opinions[kept])


Run = list[Case]
Trial = Callable[[np.random.Generator], Case]

GRID = Grid((50, 50))  # cells
SOURCES = 5
SIGMA = (1.5, 4.0)  # cells, drawn for each source
MARGIN = 15.0  # cells between the truth and the border, so that no opinion is cut off there
CORRELATION = 0.8  # of the errors of any two sources, relative to their sigmas
LIE, LIAR_SIGMA = 12.0, 1.2  # cells: the error of a source that lies, and the sigma of its belief


def independent(rng: np.random.Generator) -> Case:
    """Five honest sources: their errors are independent, and each is drawn with its own sigma."""
    truth, sigmas = _draw(rng)
    return _case(truth, truth + sigmas[:, None] * rng.standard_normal((SOURCES, 2)), sigmas)


def correlated(rng: np.random.Generator) -> Case:
    """The errors are as large as their sigmas say, but have a common part, as from a wrong map or a shared calibration."""
    truth, sigmas = _draw(rng)
    own, common = rng.standard_normal((SOURCES, 2)), rng.standard_normal(2)
    errors = math.sqrt(1 - CORRELATION) * own + math.sqrt(CORRELATION) * common
    return _case(truth, truth + sigmas[:, None] * errors, sigmas)


def echoes(rng: np.random.Generator) -> Case:
    """Two honest sources, of which one is repeated by three others, as when robots pass on what they received."""
    truth, sigmas = _draw(rng)
    means = truth + sigmas[:, None] * rng.standard_normal((SOURCES, 2))
    sigmas[1:4], means[1:4] = sigmas[0], means[0]
    case = _case(truth, means, sigmas)
    return replace(case, common=case.opinions[1:4])


def with_liars(liars: int, rng: np.random.Generator) -> Case:
    """Five sources, of which some have the same sharp belief 12 cells off."""
    truth, sigmas = _draw(rng)
    means = truth + sigmas[:, None] * rng.standard_normal((SOURCES, 2))
    angle = rng.uniform(0, 2 * math.pi)
    means[:liars] = truth + LIE * np.array([math.cos(angle), math.sin(angle)])
    sigmas[:liars] = LIAR_SIGMA
    return _case(truth, means, sigmas)


#: The trials: five generated situations, by their names in tables.
TRIALS: dict[str, Trial] = {
    "independent": independent,
    "correlated": correlated,
    "echoes": echoes,
    "one liar": partial(with_liars, 1),
    "two collude": partial(with_liars, 2),
}


def _draw(rng: np.random.Generator) -> tuple[Array, Array]:
    """The truth, shape (2,), and the sources' sigmas, shape (SOURCES,)."""
    truth = np.array([rng.uniform(MARGIN, n - MARGIN) for n in GRID.shape])
    return truth, rng.uniform(*SIGMA, SOURCES)


def _case(truth: Array, means: Array, sigmas: Array) -> Case:
    """Gaussians about these means (N, 2), cells; an error above 3.7 sigma may lead over the border, where the mean then stays."""
    means = np.clip(means, 0.0, GRID.shape)
    opinions = np.stack([gaussian(GRID, mean, float(sigma)).p for mean, sigma in zip(means, sigmas, strict=True)])
    names = tuple(f"s{i + 1}" for i in range(len(means)))
    x, y = truth.tolist()
    return Case(GRID, "object/target", 0.0, names, opinions, (x, y))
