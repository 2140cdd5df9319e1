"""Robots that drive in a row, are told their places now and then, and see each other where they stand at the end of the tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from blackboard.opinion.gaussian.evidence import Evidence
from tests.opinion.gaussian.test_team import Own


def team(number: int, seed: int) -> list[Own]:
    chance = np.random.default_rng(seed)
    return [Own(f"robot/r{k}", np.array([0.0, 3.0 * k]), chance) for k in range(number)]


def told(robots: Sequence[Own], tick: int) -> list[Evidence]:
    """What all robots report of a tick, once all have moved."""
    alone = [robot.tick(tick, []) for robot in robots]
    return [
        replace(report, relatives=tuple(own.see(other) for other in robots if other is not own))
        for own, report in zip(robots, alone, strict=True)
    ]
