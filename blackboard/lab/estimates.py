"""How a rule scored on many cases, with intervals over runs. Pure; the random generator is an argument."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEVELS, Score

RESAMPLES = 400  # of the bootstrap
Z = 1.959964  # of a normal distribution, two-sided 95 %


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass
class RuleScores:
    """Scores of cases, with the number of the run that each comes from, and the seconds that its fusion took."""

    score: Score = field(default_factory=Score)
    runs: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    failed: int = 0  # fusions in which a veto left no cell; scored is what a board does then: the linear pool
    in_force: dict[str, str | float] = field(default_factory=dict)  # the rule and its parameters

    def add(self, run: int, belief: Belief, truth: tuple[float, ...], seconds: float, failed: bool = False) -> None:
        self.score.add(belief, truth)
        self.runs.append(run)
        self.seconds.append(seconds)
        self.failed += failed

    def merge(self, other: RuleScores) -> RuleScores:
        return RuleScores(
            self.score.merge(other.score),
            self.runs + other.runs,
            self.seconds + other.seconds,
            self.failed + other.failed,
            self.in_force,
        )


#: Column -> (the values of the cases, how they become one number).
Column = tuple[Callable[[RuleScores], Array], str]
COLUMNS: dict[str, Column] = {
    "rmse": (lambda t: np.array(t.score.errors), "root mean square"),
    "median": (lambda t: np.array(t.score.errors), "median"),
    "log_score": (lambda t: np.array(t.score.log_scores), "mean"),
    **{
        f"coverage_{level}": (lambda t, level=level: np.less(t.score.levels, level / 100).astype(float), "share")  # type: ignore[misc]
        for level in LEVELS
    },
    "entropy": (lambda t: np.array(t.score.entropies), "mean"),
    "ms": (lambda t: 1000 * np.array(t.seconds), "mean"),
}


def estimates(scores: RuleScores, rng: np.random.Generator) -> dict[str, Estimate]:
    """Every column of COLUMNS with its 95 % interval, from at least one case.

    Percentile bootstrap over runs, whose cases are not independent of each other. Where every run has one case, the interval of
    a share is Wilson's, which is right at 0 and 1 too (Wilson, JASA 22, 1927).
    """
    _, runs = np.unique(scores.runs, return_inverse=True)
    drawn = resamples(int(runs.max()) + 1, rng)
    single = len(drawn[0]) == len(runs)
    found = {}
    for name, (values, how) in COLUMNS.items():
        x = values(scores)
        value = float(_pooled(x, np.ones((1, len(x))), how)[0])
        if how == "share" and single:
            found[name] = wilson(value, len(x))
        else:
            low, high = np.quantile(_pooled(x, drawn[:, runs], how), (0.025, 0.975))
            found[name] = Estimate(value, float(low), float(high))
    return found


def difference(scores: RuleScores, other: RuleScores, rng: np.random.Generator) -> Estimate:
    """How much higher the mean log score of the first is, on the same cases in the same order; bootstrap over runs."""
    _, runs = np.unique(scores.runs, return_inverse=True)
    gained = np.array(scores.score.log_scores) - np.array(other.score.log_scores)
    low, high = np.quantile(_pooled(gained, resamples(int(runs.max()) + 1, rng)[:, runs], "mean"), (0.025, 0.975))
    return Estimate(float(gained.mean()), float(low), float(high))


def means(rows: Array, rng: np.random.Generator) -> list[Estimate]:
    """The mean over runs of each column of rows (runs, columns), with its interval."""
    counts = resamples(len(rows), rng)
    low, high = np.quantile(counts @ rows / len(rows), (0.025, 0.975), axis=0)
    return [Estimate(*(float(v) for v in column)) for column in zip(rows.mean(axis=0), low, high, strict=True)]


def resamples(runs: int, rng: np.random.Generator) -> Array:
    """How often each run was drawn in each resample, shape (RESAMPLES, runs)."""
    return np.asarray(rng.multinomial(runs, np.full(runs, 1 / runs), RESAMPLES).astype(float))


def wilson(share: float, n: int) -> Estimate:
    """Wilson's score interval of a share of n independent cases."""
    centre = (share + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z * math.sqrt(share * (1 - share) / n + Z**2 / (4 * n**2)) / (1 + Z**2 / n)
    return Estimate(share, max(0.0, centre - half), min(1.0, centre + half))


def _pooled(x: Array, counts: Array, how: str) -> Array:
    """One number for each row of counts (resamples, cases)."""
    if how == "median":
        order = np.argsort(x)
        reached = np.cumsum(counts[:, order], axis=1)
        return np.asarray(x[order][np.argmax(reached >= reached[:, -1:] / 2, axis=1)])
    means = counts @ (x**2 if how == "root mean square" else x) / counts.sum(axis=1)
    return np.sqrt(means) if how == "root mean square" else np.asarray(means)
