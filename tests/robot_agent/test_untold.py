"""What no odometry tells of a robot's motion: lost readings, odometry that stops, and pieces that come late."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.wire.messages import Odometry, Readings
from robot_agent.untold import TURNING, Unseen, Untold
from tests.robot_agent.robots import measured

Told = tuple[float, float | None]  # team time (s), and how long the odometry lasts, if there is any


def readings(time: float, dt: float | None, speed: float = 0.5) -> Readings:
    odometry = None if dt is None else Odometry(distance=speed * dt, turn=0.0, dt=dt)
    return measured(0, time=time, odometry=odometry)


def after(told: Sequence[Told], speed: float = 0.5) -> list[Untold]:
    states = [Untold()]
    for time, dt in told:
        states.append(states[-1].after(readings(time, dt, speed)))
    return states[1:]


STEADY: list[Told] = [(0.0, None), *((0.1 * n, 0.1) for n in range(1, 21))]


def test_odometry_of_all_of_the_time_leaves_nothing_out() -> None:
    assert all(state.lapse == Unseen() for state in after(STEADY))


@pytest.mark.parametrize("every", [0.1, 0.5, 3.0])
def test_it_adds_up_to_the_same_however_often_others_than_odometry_are_read(every: float) -> None:
    silent: list[Told] = [(2.0 + every * n, None) for n in range(1, round(3.0 / every) + 1)]
    states = after([*STEADY, *silent, (5.1, 0.1)])[len(STEADY) :]
    assert sum(state.lapse.way for state in states) == pytest.approx(0.5 * 3.0)
    assert sum(state.lapse.turn for state in states) == pytest.approx(TURNING * 3.0)
    assert after([*STEADY, (5.1, 0.1)])[-1].lapse.way == pytest.approx(0.5 * 3.0)


def test_a_robot_that_stands_or_never_moved_goes_nowhere() -> None:
    silent: list[Told] = [(2.0 + 0.1 * n, None) for n in range(1, 100)]
    assert all(state.lapse == Unseen() for state in after([*STEADY, *silent], speed=0.0))
    assert all(state.lapse == Unseen() for state in after([*silent, (12.0, 0.1)]))


def unseen(before: Readings, readings: Readings) -> Unseen:
    """What robots took for lost with two readings that came one after the other, before any odometry could be silent."""
    assert before.odometry is not None
    assert readings.odometry is not None
    gap = readings.time - before.time - readings.odometry.dt
    if gap <= readings.odometry.dt / 2:
        return Unseen()
    speed = max(abs(told.distance) / told.dt for told in (before.odometry, readings.odometry))
    rate = max(abs(told.turn) / told.dt for told in (before.odometry, readings.odometry))
    return Unseen(speed * gap, min(math.pi, max(rate, TURNING if speed else 0.0) * gap))


@given(
    ticks=st.lists(st.integers(1, 400), min_size=2, max_size=20, unique=True),
    ways=st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3)), min_size=20, max_size=20),
)
def test_where_readings_are_lost_all_of_that_time_is_unseen_and_nothing_of_another(
    ticks: list[int], ways: list[tuple[float, float]]
) -> None:
    """As of a robot whose network was cut off, with odometry in each of its readings: by two of them alone, to the digit."""
    said = [
        after.model_copy(update={"odometry": Odometry(distance=way, turn=turn, dt=0.2)})
        for after, (way, turn) in zip([readings(0.2 * tick, 0.2) for tick in sorted(ticks)], ways, strict=False)
    ]
    state = Untold().after(said[0])
    for before, now in pairwise(said):
        state = state.after(now)
        assert Unseen(state.lapse.way, min(math.pi, state.lapse.turn)) == unseen(before, now)
        assert state.whole == state.lapse


@given(seed=st.integers(0, 1000))
def test_pieces_of_unlike_length_that_cover_all_of_the_time_leave_little_out(seed: int) -> None:
    """Each counts in the step after its end. Before, a step with a short piece was taken to have lost the rest: 5 % of the time."""
    ends = np.random.default_rng(seed).integers(1, 9, 400).cumsum() * 0.02
    times = 0.1 * np.arange(1, 300)
    reached = np.concatenate([[0.0], ends])[np.searchsorted(ends, times, side="right")]
    pieces = np.diff(reached, prepend=0.0).tolist()
    states = after([(0.0, None), *((time, dt or None) for time, dt in zip(times.tolist(), pieces, strict=True))])
    assert sum(state.lapse.way for state in states[100:]) <= 0.03 * 0.5 * 20.0
