"""What a source's innovations say of its noise."""

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
    chance, innovations = np.random.default_rng(3), Innovations()
    for squared in truth * chance.chisquare(2, WINDOW):
        innovations.judge(CAMERA, float(squared), 2)
    assert low <= innovations.variance(CAMERA) <= high


def test_a_source_is_believed_until_enough_is_known() -> None:
    innovations = Innovations()
    for _ in range(ENOUGH - 1):
        innovations.judge(CAMERA, 1e9, 2)
    assert innovations.variance(CAMERA) == 1.0
    innovations.judge(CAMERA, 1e9, 2)
    assert innovations.variance(CAMERA) == MOST_NOISE
    assert innovations.variance(("robot/r1", "increment")) == 1.0
    assert (innovations.samples(CAMERA), innovations.samples(("robot/r1", "increment"))) == (ENOUGH, 0)


def squared_distances(seed: int, claims: float) -> tuple[list[float], float]:
    """Of all robots in all ticks but the first ones, where robot r1 claims a share of its camera's and its fixes' sigma."""
    robots = driving.team(4, seed)
    team, squared = TeamJoint(), []
    for tick in range(80):
        reports = driving.reports_of(robots, tick)
        reports[1] = replace(
            reports[1],
            relatives=tuple(
                replace(r, range_variance=claims**2 * r.range_variance, bearing_variance=claims**2 * r.bearing_variance)
                for r in reports[1].relatives
            ),
        )
        team.settle(tick, 1.0, reports)
        if tick >= 30:
            for robot in robots:
                marginal = team.marginal(robot.name)
                apart = marginal.mean - robot.place
                squared.append(float(apart @ np.linalg.solve(marginal.covariance, apart)))
    return squared, team.innovations.variance(("robot/r1", "relative"))


@pytest.mark.team
def test_a_camera_that_claims_a_quarter_of_its_noise_is_found_out() -> None:
    honest, learned = squared_distances(5, 1.0)
    assert learned < 1.7
    claimed, learned = squared_distances(5, 0.25)
    assert learned > 1.8
    assert np.mean(claimed) < 1.6 * np.mean(honest), "and the team is hardly too sure of itself"
