"""Drawn cases of a trial, and what rules score on them."""

import numpy as np

from blackboard.lab import comparison
from blackboard.lab.cases import GRID, TRIALS, Case
from blackboard.lab.estimates import RuleScores


def drawn(trial: str, runs: int, seed: int = 1) -> list[Case]:
    return [TRIALS[trial](stream) for stream in np.random.default_rng(seed).spawn(runs)]


def judged(trial: str, runs: int, names: list[str], seed: int = 1) -> dict[str, RuleScores]:
    rules = {name: comparison.contenders(GRID)[name] for name in names}
    return comparison.judge([(i, [case]) for i, case in enumerate(drawn(trial, runs, seed))], rules, lambda: 0.0)
