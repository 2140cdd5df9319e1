"""How a rule scored on many cases, with intervals over runs. Pure; the random generator is an argument.

The cases of a run are not independent of each other, so the runs are what is drawn anew (`blackboard.judge.intervals`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from blackboard.judge.intervals import FEWEST, Estimate, over_runs, resamples, wilson
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEVELS, Score


@dataclass
class RuleScores:
    """Scores of cases, with the number of the run that each comes from, and the seconds that its fusion took."""

    score: Score = field(default_factory=Score)
    runs: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)  # empty where no single fusion was made
    failed: int = 0  # fusions in which a veto left no cell; scored is what a board does then: the linear pool
    in_force: dict[str, str | float] = field(default_factory=dict)  # the rule and its parameters

    def add(
        self, run: int, belief: Belief, truth: tuple[float, ...], seconds: float | None, failed: bool = False
    ) -> None:
        self.score.add(belief, truth)
        self.runs.append(run)
        self.seconds += [] if seconds is None else [seconds]
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
        f"coverage_{level}": (lambda t, level=level: t.score.held(level), "share")  # type: ignore[misc]
        for level in LEVELS
    },
    "entropy": (lambda t: np.array(t.score.entropies), "mean"),
    "ms": (lambda t: 1000 * np.array(t.seconds), "mean"),
}

SIGNED = ("log_score",)  # the columns that may be below 0


def estimates(scores: RuleScores, rng: np.random.Generator) -> dict[str, Estimate]:
    """Every column of COLUMNS with its 95 % interval over runs, from at least one case; without "ms" where no time was taken.

    Where every run has one case, the interval of a share is Wilson's, which is right at 0 and 1 too (Wilson, JASA 22, 1927). A share
    of 0 or 1 of all cases says nothing about how runs differ: there it is Wilson's too, in which a run counts as one case.
    """
    _, of_case = np.unique(scores.runs, return_inverse=True)
    runs = int(of_case.max()) + 1
    drawn = resamples(runs, rng)[:, of_case]
    single = runs == len(of_case)
    estimates = {}
    for name, (values, how) in COLUMNS.items():
        x = values(scores)
        if not len(x):
            continue
        value = float(_pooled(x, np.ones((1, len(x))), how)[0])
        if how == "share" and (single or value in (0.0, 1.0)):
            estimates[name] = wilson(value, runs) if runs >= FEWEST else Estimate(value)
        else:
            (estimates[name],) = over_runs(np.array([value]), _pooled(x, drawn, how)[:, None], runs)
            if name not in SIGNED:
                estimates[name] = estimates[name].within(0.0, 1.0 if how == "share" else math.inf)
    return estimates


def difference(scores: RuleScores, other: RuleScores, rng: np.random.Generator) -> Estimate:
    """How much higher the mean log score of the first is, on the same cases in the same order; the interval is over runs."""
    _, of_case = np.unique(scores.runs, return_inverse=True)
    runs = int(of_case.max()) + 1
    gained = np.array(scores.score.log_scores) - np.array(other.score.log_scores)
    drawn = _pooled(gained, resamples(runs, rng)[:, of_case], "mean")
    return over_runs(gained.mean(keepdims=True), drawn[:, None], runs)[0]


def _pooled(x: Array, counts: Array, how: str) -> Array:
    """One number for each row of counts (resamples, cases)."""
    if how == "median":
        order = np.argsort(x)
        reached = np.cumsum(counts[:, order], axis=1)
        return np.asarray(x[order][np.argmax(reached >= reached[:, -1:] / 2, axis=1)])
    means = counts @ (x**2 if how == "root mean square" else x) / counts.sum(axis=1)
    return np.sqrt(means) if how == "root mean square" else np.asarray(means)
