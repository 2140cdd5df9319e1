"""The clock never jumps back; a manual one stands still."""

from __future__ import annotations

import time

import pytest

from blackboard.process.clock import ManualClock, UnixClock


def test_the_clock_tells_unix_time() -> None:
    assert UnixClock().now() == pytest.approx(time.time(), abs=1.0)


def test_a_step_of_the_systems_clock_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = UnixClock()
    before = clock.now()
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert before <= clock.now() < before + 60.0


def test_a_manual_clock_moves_when_it_is_moved() -> None:
    clock = ManualClock(5.0)
    assert clock.now() == clock.now() == 5.0
    clock.advance(1.5)
    assert clock.now() == 6.5
    with pytest.raises(ValueError, match="backwards"):
        clock.advance(-1.0)
