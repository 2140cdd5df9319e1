"""Two runs on the same samples: what changed, with the intervals of batch means."""

import math

import numpy as np
import pytest

from blackboard.judge.paired import BLOCKS, paired, text
from blackboard.judge.samples import Sample


def sample(tick: int, mean_x: float, log_score: float = 0.0) -> Sample:
    return Sample(
        tick=tick, time=0.2 * tick, robot="r1", sub_team="a", subject="robot/r1", level="agreed", truth_x=0.0, truth_y=0.0,
        mean_x=mean_x, mean_y=0.0, log_score=log_score, region=0.5, border=0.1, area=1.0, landmark_age=0.0,
    )  # fmt: skip


def test_the_interval_is_that_of_the_means_of_blocks() -> None:
    rng = np.random.default_rng(1)
    shift = np.repeat(rng.normal(0.5, 0.1, BLOCKS), 10)
    ones = [sample(tick, 1.0) for tick in range(10 * BLOCKS)]
    others = [sample(tick, 1.0 + shift[tick], -shift[tick]) for tick in range(10 * BLOCKS)]
    difference = paired(ones, [*others, sample(5000, 9.0)])["robots"]["agreed"]
    assert difference["n"] == 10 * BLOCKS
    blocks = shift[::10]
    half = 2.262 * blocks.std(ddof=1) / math.sqrt(BLOCKS)  # Student's t of 9 degrees of freedom
    assert difference["error"] == pytest.approx(
        {"value": blocks.mean(), "low": blocks.mean() - half, "high": blocks.mean() + half}, rel=1e-4
    )
    assert difference["log_score"]["value"] == pytest.approx(-blocks.mean())
    assert "robots agreed: error +0." in text(paired(ones, others), "cell")


def test_a_run_with_too_few_samples_has_no_interval() -> None:
    few = [sample(tick, 1.0) for tick in range(BLOCKS - 1)]
    differences = paired(few, [sample(first.tick, 1.5) for first in few])
    assert differences["robots"]["agreed"]["error"] == {"value": 0.5, "low": None, "high": None}
    assert "+0.500 (too short for an interval)" in text(differences, "cell")
