"""Which turns are more than the noise of the odometry, by measured turns alone."""

import pickle

import numpy as np
import pytest

from blackboard.wire.messages import Odometry
from robot_agent.gaussian.jitter import FEWEST, REMEMBERED, Jitter


def significances(jitter: Jitter, turns: list[float], dt: float = 1.0) -> list[float]:
    return [jitter.significance(Odometry(distance=0.1 * dt, turn=turn, dt=dt)) for turn in turns]


@pytest.mark.parametrize("dt", [0.1, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_white_noise_alone_is_hardly_ever_significant_and_a_curve_beyond_it_is(seed: int, dt: float) -> None:
    noise = np.random.default_rng(seed).normal(size=400) * 0.1 * dt**0.5  # 0.1 rad / sqrt(s)
    jitter = Jitter()
    significances(jitter, noise[:100].tolist(), dt)
    assert np.mean(significances(jitter, noise[100:200].tolist(), dt)) < 0.1
    assert np.mean(significances(jitter, (noise[200:] + dt).tolist(), dt)[-100:]) > 0.9  # 1 rad / s


def test_until_the_noise_is_known_no_turn_is_significant() -> None:
    shares = significances(Jitter(), [0.5] * 20)
    assert shares == [0.0] * (FEWEST + 1) + [1.0] * (20 - FEWEST - 1)


def test_a_robot_that_stands_changes_nothing() -> None:
    jitter = Jitter()
    assert jitter.significance(Odometry(distance=0.0, turn=0.0, dt=1.0)) == 1.0
    assert significances(jitter, [0.5]) == [0.0]


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e6])
def test_steps_of_no_length_take_no_more_memory(turn: float) -> None:
    """A robot may tell that it makes thousands of steps within a second."""
    jitter = Jitter()
    significances(jitter, [turn] * REMEMBERED * 2, dt=1e-6)
    before = len(pickle.dumps(jitter))
    assert all(0.0 <= share <= 1.0 for share in significances(jitter, [turn] * 1000, dt=1e-6))
    assert len(pickle.dumps(jitter)) == before
