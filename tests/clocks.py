"""A clock that a test moves, in place of the system's."""

from blackboard.process.clock import UnixClock


class ManualClock(UnixClock):
    """A clock that stands still until it is moved, in seconds."""

    def __init__(self, now: float = 0.0) -> None:
        self._now = now

    def now(self) -> float:
        return self._now

    def advance(self, seconds: float) -> None:
        self._now += seconds
