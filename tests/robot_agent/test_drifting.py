"""Fixes that leave the odometry steadily, and those that only err."""

import numpy as np
import pytest

from robot_agent.gaussian.drifting import SPAN, Drifting

SEEDS, SIGMA = range(40), 0.1  # unit, as all fixes claim


def of_fixes(beyond: np.ndarray, every: float, noise: float = 0.0, seed: int = 0) -> list[float]:
    """The speeds (unit / s) that are found with each of some fixes, whose mean is so far beyond the odometry, shape (n, 2)."""
    random, drifting, speeds = np.random.default_rng(seed), Drifting(), []
    told = beyond + noise * random.normal(size=beyond.shape)
    for number in range(1, len(told)):
        drifting.on_error(every * number, told[number] - told[number - 1])
        speeds.append(drifting.speed(SIGMA))
    return speeds


@pytest.mark.parametrize("every", [0.2, 1.0, 2.0])
@pytest.mark.parametrize("noise", [0.1, 1.0, 100.0])
def test_noise_of_fixes_is_no_drift_however_large_it_is(noise: float, every: float) -> None:
    found = [any(of_fixes(np.zeros((round(60 / every), 2)), every, noise, seed)) for seed in SEEDS]
    assert sum(found) <= 1


@pytest.mark.parametrize("every", [0.2, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_drives_while_its_wheels_measure_nothing_is_found(seed: int, every: float) -> None:
    seconds = every * np.arange(round(20 / every))
    went = np.maximum(0.0, seconds - 8.0)[:, np.newaxis] * [0.3, -0.4]
    speeds = of_fixes(went, every, 0.3, seed)
    found = [second for second, speed in zip(seconds[1:], speeds, strict=True) if speed]
    assert 8.0 < found[0] <= 8.0 + SPAN[1]
    assert speeds[-1] == pytest.approx(0.5, abs=0.15)


def test_an_error_that_wanders_within_what_is_claimed_is_no_drift() -> None:
    assert not any(of_fixes(np.outer(np.linspace(0.0, 4 * SIGMA, 50), [1.0, 0.0]), 0.2))


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("seed", range(5))
def test_a_robot_that_is_carried_once_does_not_drift(seed: int, noise: float) -> None:
    jump = np.zeros((100, 2))
    jump[50:] = 3.0, -4.0
    assert not any(of_fixes(jump, 0.2, noise, seed))


def test_fixes_without_noise_of_a_robot_that_is_where_its_odometry_leads_do_not_drift() -> None:
    assert not any(of_fixes(np.zeros((100, 2)), 0.2))


def test_what_was_before_a_belief_was_given_up_is_forgotten() -> None:
    drifting = Drifting()
    for second in range(10):
        drifting.on_error(float(second), np.array([1.0, 0.0]))
    assert drifting.speed(SIGMA) == pytest.approx(1.0)
    drifting.forget()
    assert drifting.speed(SIGMA) == 0.0
