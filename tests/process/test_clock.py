"""The clock never jumps back."""

import time

import pytest

from blackboard.process.clock import UnixClock


def test_the_clock_tells_unix_time() -> None:
    assert UnixClock().now() == pytest.approx(time.time(), abs=1.0)


def test_a_step_of_the_systems_clock_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = UnixClock()
    before = clock.now()
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert before <= clock.now() < before + 60.0
