"""How good a belief was, once the truth is known: error, log score and coverage, which are shown beside every entropy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.region import least_inside
from blackboard.opinion.weights import entropy

#: The highest-density regions whose coverage is given, in percent.
LEVELS = (50, 90, 95)
SHARES = np.array(LEVELS) / 100

#: The log score counts a probability as at least this, -27.6 nats: one cell that was wrongly ruled out does not decide a mean.
LEAST_PROBABILITY = 1e-12


def hdr_level(p: Array, index: tuple[int, ...]) -> float:
    """Mass of all cells strictly denser than cell `index`: it is in the L % highest-density region iff this is below L / 100."""
    return float(p[p > p[index]].sum())


def border_mass(p: Array, index: tuple[int, ...]) -> float:
    """Mass of all cells as dense as cell `index`, itself among them."""
    return float(p[p == p[index]].sum())


def held(denser: npt.ArrayLike, border: npt.ArrayLike, share: npt.ArrayLike) -> Array:
    """How far the highest-density region of `share` of the mass (0 to 1) holds cells, by `hdr_level` and `border_mass`: 0 to 1.

    1 inside, 0 outside. Cells are lumps of mass, so that the smallest region of whole cells holds more than `share`: much more
    where a belief is a few cells wide. Cells on its border are therefore held in part, just as far as `share` needs them. So a truth
    drawn from the belief is held by the 50 % region half of the time, whatever the grid (a fuzzy region:
    Geyer and Meeden, Statistical Science 20(4), 2005).
    """
    d, b = np.asarray(denser, dtype=np.float64), np.asarray(border, dtype=np.float64)
    missing = np.asarray(share) - d
    part = missing / np.where(b > 0, b, 1.0)
    return np.asarray(np.where(b > 0, np.clip(part, 0.0, 1.0), missing > 0), dtype=np.float64)


def region_area(belief: Belief, share: float) -> float:
    """Length, area or volume, in the grid's unit ** ndim, of the highest-density region of `share` of the mass (0 to 1).

    Cells of equal density are in it together.
    """
    return int(np.count_nonzero(belief.p >= least_inside(belief.p, share))) * belief.grid.volume


def log_score(p: Array, index: tuple[int, ...]) -> float:
    """The natural logarithm of the true cell's probability, of at least LEAST_PROBABILITY: a proper score, in nats."""
    return math.log(max(float(p[index]), LEAST_PROBABILITY))


def errors(distances: npt.ArrayLike) -> dict[str, float]:
    """Distances between estimate and truth, at least one, as rmse, mean, p95 (interpolated) and max, in their unit."""
    d = np.asarray(distances, dtype=np.float64)
    p95 = float(np.quantile(d, 0.95))
    return {"rmse": math.sqrt(float((d**2).mean())), "mean": float(d.mean()), "p95": p95, "max": float(d.max())}


@dataclass
class Score:
    """Beliefs against the truth, one entry for each; `summary` is the scorecard's block S."""

    errors: list[float] = field(default_factory=list)
    entropies: list[float] = field(default_factory=list)
    log_scores: list[float] = field(default_factory=list)
    levels: list[float] = field(default_factory=list)  # `hdr_level` of the true cell
    borders: list[float] = field(default_factory=list)  # its `border_mass`

    def add(self, belief: Belief, truth: Sequence[float]) -> None:
        """Score a belief, the estimate being its mean; `truth` in the grid's unit.

        Outside the grid the truth is in no region and its cell has the least probability.
        """
        index = belief.grid.index(truth)
        self.errors.append(math.dist(belief.mean(), truth))
        self.entropies.append(entropy(belief.p))
        self.log_scores.append(math.log(LEAST_PROBABILITY) if index is None else log_score(belief.p, index))
        self.levels.append(1.0 if index is None else hdr_level(belief.p, index))
        self.borders.append(0.0 if index is None else border_mass(belief.p, index))

    def merge(self, other: "Score") -> "Score":
        """The entries of both, as a new score."""
        return Score(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def held(self, level: int) -> Array:
        """How far the `level` % highest-density region held the truth, one number from 0 to 1 for each entry (`held`)."""
        return held(self.levels, self.borders, level / 100)

    def held_first(self) -> Array:
        """How far the regions of all LEVELS held the truth of the first entry, shape (len(LEVELS),)."""
        return held(self.levels[0], self.borders[0], SHARES)

    def summary(self) -> dict[str, Any]:
        """The block S: errors in the grid's unit, entropy and log score in nats, coverage by level; None where n is 0."""
        n = len(self.errors)
        if not n:
            nothing = dict.fromkeys(("rmse", "mean", "p95", "max", "entropy", "log_score"))
            return {"n": 0, **nothing, "coverage": {str(level): None for level in LEVELS}}
        return {
            "n": n,
            **errors(self.errors),
            "entropy": float(np.mean(self.entropies)),
            "log_score": float(np.mean(self.log_scores)),
            "coverage": {str(level): float(np.mean(self.held(level))) for level in LEVELS},
        }
