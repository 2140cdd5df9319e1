"""The only place that reads a clock."""

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


def utc(seconds: float) -> datetime:
    """Unix time in seconds as a date, in whole seconds; reads no clock."""
    return datetime.fromtimestamp(int(seconds), UTC)
