"""The numbers behind the paper's figures, of a few small runs that are made once."""

from functools import cache
from typing import Any

import numpy as np

from blackboard.config import load
from blackboard.lab import paper, parallel


@cache
def score_figures(seed: int) -> paper.FigureScores:
    world = paper.world(load("paper"), 25, 3, 12.0)
    (rules,), (joint,) = (parallel.score_figures(some, [world], seed, 4.0) for some in (paper.RULES, {}))
    return rules.beside(joint)


@cache
def numbers() -> dict[str, Any]:
    rng = np.random.default_rng(1)
    return paper.on_a_line(rng) | paper.in_the_world({25: [score_figures(seed) for seed in range(4)]}, rng)
