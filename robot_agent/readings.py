"""Which readings a robot acts on next: those that go on with the ones before. Pure."""

from __future__ import annotations

from blackboard.process.team_clock import Pace, TeamClock
from blackboard.wire.messages import Readings

JUMP = 100  # ticks: readings that are further ahead, or behind, are believed with the second ones in succession


class Sequencer:
    """Takes readings as they come. A jump, to another run or far away in this one, is believed once it goes on by itself.

    Where a world's Clock is followed, that decides: readings are at most one tick ahead of it.
    """

    def __init__(self) -> None:
        self.next: Readings | None = None  # of the tick that is to be done next
        self.doubted: Readings | None = None  # the newest that did not go on with those before

    def take(self, readings: Readings, run: str, tick: int, clock: TeamClock) -> list[Readings]:
        """The readings that are to be acted on one after the other, of a robot that has done a tick (-1: none) of a run."""
        before, self.doubted = self.doubted, None
        newest = tick + JUMP if clock.followed is None else max(clock.followed.tick, tick) + 1
        if readings.run == run and (tick < 0 or tick < readings.tick <= newest):
            return [readings]
        if readings.run == run and abs(readings.tick - tick) <= JUMP:
            return []
        if clock.pace is Pace.FREE and before is not None and _follows(before, readings):
            return [before, readings]
        self.doubted = readings
        return []

    def check(self, run: str, tick: int) -> None:
        """AssertionError: an invariant does not hold for a robot that has done a tick of a run."""
        assert self.next is None or (self.next.run == run and self.next.tick > tick), (self.next, run, tick)


def _follows(before: Readings, readings: Readings) -> bool:
    """Whether readings may be the next ones after others."""
    return readings.run == before.run and 0 < readings.tick - before.tick <= JUMP
