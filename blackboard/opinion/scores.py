"""How good a belief was, once the truth is known: error, log score and coverage, so that entropy never stands alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.weights import entropy

LEVELS = (50, 90, 95)

#: The least probability that the log score sees: a cell that was ruled out costs ln(1e-300), not everything.
LEAST_PROBABILITY = 1e-300


def hdr_level(p: Array, index: tuple[int, ...]) -> float:
    """Mass of the cells that are strictly denser: the cell lies in the L % highest-density region iff this is below L / 100."""
    return float(p[p > p[index]].sum())


def log_score(p: Array, index: tuple[int, ...]) -> float:
    """Ln of the probability of the true cell, in nats; a proper score."""
    return math.log(max(float(p[index]), LEAST_PROBABILITY))


def nees(belief: Belief, truth: Sequence[float]) -> float:
    """Squared error of the mean over its covariance (cell^2 / 12 added), divided by the dimension: about 1 if honest."""
    away = np.asarray(truth) - belief.mean()
    cover = belief.covariance() + np.eye(belief.grid.ndim) * belief.grid.cell**2 / 12
    return float(away @ np.linalg.solve(cover, away)) / belief.grid.ndim


class Score:
    """Accumulates beliefs against the truth into the scorecard's block S."""

    def __init__(self) -> None:
        self.errors: list[float] = []
        self.entropies: list[float] = []
        self.log_scores: list[float] = []
        self.levels: list[float] = []

    def add(self, belief: Belief, truth: Sequence[float]) -> None:
        """Score one belief; `truth` in the grid's unit. A truth outside the grid counts as a cell of probability zero."""
        self.errors.append(float(np.linalg.norm(belief.mean() - np.asarray(truth))))
        self.entropies.append(entropy(belief.p))
        index = belief.grid.index(truth)
        self.log_scores.append(math.log(LEAST_PROBABILITY) if index is None else log_score(belief.p, index))
        self.levels.append(1.0 if index is None else hdr_level(belief.p, index))

    def merge(self, other: Score) -> Score:
        """Both together, as a new score."""
        both = Score()
        for name in ("errors", "entropies", "log_scores", "levels"):
            setattr(both, name, getattr(self, name) + getattr(other, name))
        return both

    def summary(self) -> dict[str, Any]:
        """The block S: errors in the grid's unit, entropy and log score in nats, coverage by level; None where n is 0."""
        n = len(self.errors)
        if not n:
            empty = dict.fromkeys(("rmse", "mean", "p95", "max", "entropy", "log_score"))
            return {"n": 0, **empty, "coverage": {str(level): None for level in LEVELS}}
        errors, levels = np.array(self.errors), np.array(self.levels)
        return {
            "n": n,
            "rmse": float(np.sqrt((errors**2).mean())),
            "mean": float(errors.mean()),
            "p95": float(np.quantile(errors, 0.95)),
            "max": float(errors.max()),
            "entropy": float(np.mean(self.entropies)),
            "log_score": float(np.mean(self.log_scores)),
            "coverage": {str(level): float((levels < level / 100).mean()) for level in LEVELS},
        }
