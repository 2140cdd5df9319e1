"""What a robot acts on: the readings that go on with those before, and what its boards agreed on since its last tick. Pure."""

from collections.abc import Collection

from blackboard.errors import Refused
from blackboard.process.roll_call import RollCall
from blackboard.process.team_clock import Pace, TeamClock
from blackboard.wire.messages import Consensus, Readings

JUMP = 100  # ticks: readings that are further ahead, or behind, are believed with the second ones in succession
MAX_AGREED = 512  # agreed beliefs that are kept between two ticks, over all boards


class Sequencer:
    """Takes readings as they come. A jump, to another run or far away in this one, is believed once it goes on by itself.

    Where a world's Clock is followed, that decides: readings are at most one tick ahead of it.
    """

    def __init__(self) -> None:
        self.next: Readings | None = None  # of the tick that is to be done next
        self.doubted: Readings | None = None  # the newest that did not go on with those before

    def take_readings(self, readings: Readings, run: str, tick: int, clock: TeamClock) -> list[Readings]:
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


class Gathered:
    """Of each board the newest agreed belief about each subject since the last tick, and whether all of a tick has come."""

    def __init__(self) -> None:
        self._newest: dict[tuple[str, str, str], Consensus] = {}  # by sub-team, board and subject
        self._arrived: RollCall[str] = RollCall()  # by sub-team, also of the ticks before

    def hear_consensus(self, consensus: Consensus) -> None:
        """Keep a consensus unless a newer one of the same board is kept. Refused: "too-many"."""
        key = consensus.sub_team, consensus.board, consensus.subject
        before = self._newest.get(key)
        if before is None and len(self._newest) >= MAX_AGREED:
            raise Refused("too-many", f"{consensus.subject} would be one more than {MAX_AGREED} agreed beliefs")
        if before is None or (before.tick, before.time) < (consensus.tick, consensus.time):
            self._newest[key] = consensus
            self._arrived.record(consensus.sub_team, consensus.subject, consensus.tick)

    def arrived(self, sub_team: str, tick: int, subjects: Collection[str]) -> bool:
        """Whether what a sub-team's boards agreed on about each of these subjects in a tick, or later, has come."""
        return self._arrived.arrived(sub_team, tick, subjects)

    def collect(self) -> dict[str, Consensus]:
        """The newest about each subject, of two boards that of the first name; none of them is collected again."""
        collected: dict[str, Consensus] = {}
        for (_, _, subject), consensus in sorted(self._newest.items()):
            if subject not in collected or consensus.tick > collected[subject].tick:
                collected[subject] = consensus
        self._newest = {}
        return collected

    def forget_from(self, tick: int) -> None:
        """A run is followed from this tick on: what was agreed in no earlier tick is of another run, or of Unix time."""
        self._newest = {key: consensus for key, consensus in self._newest.items() if consensus.tick < tick}
        self._arrived = RollCall()
        for consensus in self._newest.values():
            self._arrived.record(consensus.sub_team, consensus.subject, consensus.tick)

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        assert len(self._newest) <= MAX_AGREED
        assert all(
            self.arrived(consensus.sub_team, consensus.tick, [consensus.subject]) for consensus in self._newest.values()
        )


def _follows(before: Readings, readings: Readings) -> bool:
    """Whether readings may be the next ones after others."""
    return readings.run == before.run and 0 < readings.tick - before.tick <= JUMP
