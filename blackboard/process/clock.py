"""The only place that reads a clock."""

from __future__ import annotations

import time
from datetime import UTC, datetime


class UnixClock:
    """Unix time in seconds that never jumps back: read once from the system, then counted on monotonically.

    A later step of the system's clock (NTP, an operator) is not followed until the process starts again.
    """

    def __init__(self) -> None:
        self._offset = time.time() - time.monotonic()

    def now(self) -> float:
        return self._offset + time.monotonic()


class ManualClock(UnixClock):
    """A clock that stands still until it is moved; for tests and replays."""

    def __init__(self, now: float = 0.0) -> None:
        self._now = now

    def now(self) -> float:
        return self._now

    def advance(self, seconds: float) -> None:
        if seconds < 0:
            raise ValueError(f"a clock does not run backwards, by {seconds} s")
        self._now += seconds


def utc(seconds: float) -> datetime:
    """Unix time in seconds as a date, in whole seconds; reads no clock."""
    return datetime.fromtimestamp(int(seconds), UTC)
