"""Fig. 7 on 50 x 50 cells: what each run scores with 1 to 10 robots. `python -m tests.lab.sized > tests/golden/fig7.csv`, minutes.

tests/lab/test_paper.py holds the pages to that file, tests/long/test_lab.py scores its first run again.
"""

import csv
import sys

import numpy as np

from blackboard.config import load
from blackboard.lab import paper, parallel
from tests.files import ROOT

NAMES = ("cooperative", "coalition", "coalition, independent")
SIZES = (1, 2, 3, 4, 6, 10)
SEEDS = 20
METRICS = ("ratio", "log_score", "coverage_50", "coverage_95")
Sized = dict[tuple[str, str, int], list[float]]  # rule, metric, seed -> by SIZES


def score(seed: int) -> Sized:
    """The means of a run over its robots, subjects and times."""
    world = paper.world(load("paper"), 50, 10, 60.0)
    (run,) = parallel.score_figures({name: paper.RULES[name] for name in NAMES}, [world], seed, 5.0)
    by_rule = paper.fig7({50: run.over_size}, np.random.default_rng(1))["grids"]["50"]
    return {(name, m, seed): [by_rule[name][m][size - 1] for size in SIZES] for name in NAMES for m in METRICS}


def recorded() -> Sized:
    """What was written."""
    with (ROOT / "tests" / "golden" / "fig7.csv").open(encoding="utf-8") as file:
        return {(name, metric, int(seed)): [*map(float, values)] for name, metric, seed, *values in csv.reader(file)}


if __name__ == "__main__":
    writer = csv.writer(sys.stdout, lineterminator="\n")
    for seed in range(SEEDS):
        writer.writerows((*key, *(f"{value:.5f}" for value in values)) for key, values in score(seed).items())
