"""The error along the way, estimated on line: as large as it is, never less than the wheels' physics say, and no lie breaks it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import FORWARD, STATES, TURN, Motion, Nuisance
from robot_agent.gaussian.along import LONGEST, SPAN, AlongNoise

ALONG = 0.03  # unit / sqrt(s), as the physics say
TICK = Motion(distance=0.2, dt=1.0, moving=1.0, along=ALONG**2, across=0.004**2, heading=1e-4)
SURE = 0.01  # unit: sigma of the position that is seen


def block(x: float, y: float = 0.0, heading: float = 0.0, sigma: float = SURE) -> Moments:
    mean = np.zeros(STATES)
    mean[:3], mean[[FORWARD, TURN]] = (x, y, heading), 1.0
    covariance = np.zeros((STATES, STATES))
    covariance[0, 0] = covariance[1, 1] = sigma**2
    return Moments(mean, covariance)


def driven(true: float, seconds: int, seed: int, by_team: bool = False, heading: float = 0.0) -> AlongNoise:
    """A robot that is seen in each tick while it drives, with an error along the way of `true` times what the physics say."""
    rng, noise, way = np.random.default_rng(seed), AlongNoise("robot/r1", Nuisance()), 0.0
    for _ in range(seconds):
        seen = way + SURE * rng.normal()
        noise.judge(block(seen * math.cos(heading), seen * math.sin(heading), heading), by_team=by_team)
        noise.move(TICK)
        way += TICK.distance + true * ALONG * rng.normal()
    return noise


@pytest.mark.parametrize("true", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_it_is_found_to_a_quarter_after_ten_minutes(true: float, heading: float) -> None:
    found = [math.sqrt(driven(true, 600, seed, heading=heading).variance) for seed in range(8)]
    assert np.mean(found) == pytest.approx(true, rel=0.25)


@pytest.mark.parametrize("seed", range(8))
def test_wheels_that_are_as_the_physics_say_are_not_taken_for_worse_by_luck(seed: int) -> None:
    assert driven(1.0, 60, seed, by_team=True).variance == 1.0


def test_wheels_that_are_better_than_the_physics_say_count_as_those() -> None:
    assert driven(0.2, 600, 1).variance == 1.0


def test_it_begins_with_the_physics_and_one_span_moves_it_little() -> None:
    assert driven(4.0, int(SPAN), 1).variance == 1.0
    assert all(driven(1.0, int(SPAN) + 2, seed).variance < 2.0**2 for seed in range(20))


def test_a_belief_that_knows_no_more_than_odometry_judges_nothing() -> None:
    noise = AlongNoise("robot/r1", Nuisance())
    noise.judge(block(0.0), by_team=False)
    for tick in range(1, 3 * int(LONGEST)):
        noise.move(TICK)
        noise.judge(block(TICK.distance * tick + 5.0, sigma=0.03 * math.sqrt(tick)), by_team=False)
    assert noise.variance == 1.0


def test_a_span_of_the_team_is_not_judged_by_the_robot_alone() -> None:
    noise = AlongNoise("robot/r1", Nuisance())
    for _ in range(8):
        before = noise.variance
        noise.judge(block(0.0), by_team=True)
        for tick in range(1, int(LONGEST)):
            noise.move(TICK)
            noise.judge(block(TICK.distance * tick + 1.0), by_team=False)
        assert noise.variance == before
        noise.judge(block(TICK.distance * (LONGEST - 1) + 1.0), by_team=True)
        noise.give_up()
    assert noise.variance > 1.0


def test_what_was_given_up_is_not_judged() -> None:
    noise = AlongNoise("robot/r1", Nuisance())
    for _ in range(10):
        noise.judge(block(0.0), by_team=False)
        for _ in range(int(SPAN)):
            noise.move(TICK)
        noise.give_up()
    assert noise.variance == 1.0


def test_one_misread_correction_is_not_taken_for_the_wheels() -> None:
    noise = driven(1.0, 300, 2)
    noise.judge(block(1e3), by_team=False)
    for tick in range(int(SPAN) + 1):
        noise.move(TICK)
        noise.judge(block(2e3 + tick), by_team=False)
    assert noise.variance < 2.0**2


NUMBERS = st.floats(-1e4, 1e4)


@given(st.lists(st.tuples(NUMBERS, NUMBERS, st.floats(0, 1e4), st.booleans()), max_size=40))
def test_it_stays_between_the_physics_and_eight_times_them_whatever_a_team_says(
    told: list[tuple[float, float, float, bool]],
) -> None:
    noise = AlongNoise("robot/r1", Nuisance(sigmas=(0.05,) * 6))
    for x, heading, sigma, by_team in told:
        noise.judge(block(x, -x, heading, sigma), by_team=by_team)
        for _ in range(int(SPAN)):
            noise.move(TICK)
        assert 1.0 <= noise.variance <= 8.0**2
