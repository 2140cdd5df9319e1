"""What a source's innovations say of its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.believed import ENOUGH, MOST_NOISE, WINDOW
from blackboard.opinion.gaussian.innovations import Innovations
from blackboard.opinion.gaussian.team import TeamJoint
from tests.opinion.gaussian import driving

CAMERA = ("robot/r1", "relative")


@pytest.mark.parametrize(("truth", "low", "high"), [(0.25, 1.0, 1.0), (1.0, 1.0, 1.6), (4.0, 2.2, 6.5)])
def test_the_noise_that_is_seen_is_a_multiple_of_what_was_claimed_and_never_less(
    truth: float, low: float, high: float
) -> None:
    chance, it = np.random.default_rng(3), Innovations()
    for squared in truth * chance.chisquare(2, WINDOW):
        it.judge(CAMERA, float(squared), 2)
    assert low <= it.variance(CAMERA) <= high


def test_a_source_is_believed_until_enough_is_known() -> None:
    it = Innovations()
    for _ in range(ENOUGH - 1):
        it.judge(CAMERA, 1e9, 2)
    assert it.variance(CAMERA) == 1.0
    it.judge(CAMERA, 1e9, 2)
    assert it.variance(CAMERA) == MOST_NOISE
    assert it.variance(("robot/r1", "increment")) == 1.0
    assert (it.samples(CAMERA), it.samples(("robot/r1", "increment"))) == (ENOUGH, 0)


def squared_distances(seed: int, claims: float) -> tuple[list[float], float]:
    """Of all robots in all ticks but the first ones, where robot r1 claims a share of its camera's and its fixes' sigma."""
    robots = driving.team(4, seed)
    it, found = TeamJoint(), []
    for tick in range(80):
        reports = driving.told(robots, tick)
        reports[1] = replace(
            reports[1],
            relatives=tuple(
                replace(r, range_variance=claims**2 * r.range_variance, bearing_variance=claims**2 * r.bearing_variance)
                for r in reports[1].relatives
            ),
        )
        it.settle(tick, 1.0, reports)
        if tick >= 30:
            for robot in robots:
                marginal = it.marginal(robot.name)
                apart = marginal.mean - robot.place
                found.append(float(apart @ np.linalg.solve(marginal.covariance, apart)))
    return found, it.innovations.variance(("robot/r1", "relative"))


@pytest.mark.team
def test_a_camera_that_claims_a_quarter_of_its_noise_is_found_out() -> None:
    honest, learned = squared_distances(5, 1.0)
    assert learned < 1.7
    told, learned = squared_distances(5, 0.25)
    assert learned > 1.8
    assert np.mean(told) < 1.6 * np.mean(honest), "and the team is hardly too sure of itself"
