"""The numbers behind the paper's figures, of a few small runs that are made once."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from blackboard.config import load
from blackboard.lab import paper, parallel


@cache
def score_figures(seed: int) -> paper.FigureScores:
    world = paper.world(load("paper"), 25, 3, 12.0)
    return parallel.score_figures(paper.RULES, world, seed, 4.0)


@cache
def numbers() -> dict[str, Any]:
    return paper.numbers({25: [score_figures(seed) for seed in range(4)]}, np.random.default_rng(1))
