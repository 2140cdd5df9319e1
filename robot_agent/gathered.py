"""What the boards agreed on since a robot's last tick, and whether all that a world lists of it has come. Pure, and bounded."""

from __future__ import annotations

from collections.abc import Collection

from blackboard.errors import Refused
from blackboard.process.roll_call import RollCall
from blackboard.wire.messages import Consensus

MAX_AGREED = 512  # agreed beliefs that are kept between two ticks, over all boards


class Gathered:
    """Of each board the newest agreed belief about each subject."""

    def __init__(self) -> None:
        self._newest: dict[tuple[str, str, str], Consensus] = {}  # by sub-team, board and subject
        self._arrived: RollCall[str] = RollCall()  # by sub-team, also of the ticks before

    def take(self, consensus: Consensus) -> None:
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
        found: dict[str, Consensus] = {}
        for (_, _, subject), consensus in sorted(self._newest.items()):
            if subject not in found or consensus.tick > found[subject].tick:
                found[subject] = consensus
        self._newest = {}
        return found

    def forget_from(self, tick: int) -> None:
        """A run is followed from this tick on: what was agreed in no earlier tick is of another run, or of Unix time."""
        self._newest = {key: consensus for key, consensus in self._newest.items() if consensus.tick < tick}
        self._arrived = RollCall()
        for consensus in self._newest.values():
            self._arrived.record(consensus.sub_team, consensus.subject, consensus.tick)

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        assert len(self._newest) <= MAX_AGREED
        assert all(self.arrived(it.sub_team, it.tick, [it.subject]) for it in self._newest.values())
