"""The clocks of the processes that a board hears, where each has its own Unix time: corrected, reported, or refused by name.
Pure.

Where a world gives the time, all stamps are its own, and nothing is corrected.
"""

import logging
from typing import TypeVar

from blackboard.errors import Refused
from blackboard.process.offsets import ClockOffsets, StampEchoes
from blackboard.process.printable import quoted
from blackboard.process.team_clock import Pace, TeamClock
from blackboard.wire.evidence import Forward
from blackboard.wire.messages import Consensus, Report, Status

log = logging.getLogger(__name__)

MAX_LOGGED = 1000  # sources that are remembered as logged

M = TypeVar("M", Report, Consensus, Forward)


class Clocks:
    """Stamps of others as stamps of this board's clock. Robots are named as `r1`, boards as `b/board-b`; `now` is Unix seconds."""

    def __init__(self, name: str, limit: float, clock: TeamClock) -> None:
        """`name` is this board's own, `limit` how many seconds are corrected."""
        self.name, self.limit, self.clock = name, limit, clock
        self.offsets, self.echoes = ClockOffsets(), StampEchoes()
        self._logged: set[str] = set()

    @property
    def differ(self) -> bool:
        """Whether each process goes by its own clock."""
        return self.clock.pace is Pace.FREE

    @property
    def skew(self) -> float:
        """Seconds that a robot's clock may be ahead."""
        return self.limit if self.differ else 0.0

    def hear_status(self, source: str, status: Status, now: float) -> None:
        """Take the stamps of a status; one without stamps (of an older version, or where there is a world) changes nothing."""
        echo = status.echo.get(self.name)
        if self.differ and status.sent is not None and echo is not None:
            self.offsets.round_trip(source, status.sent, *echo, now)

    def adopt(self, status: Status, now: float) -> None:
        """Take what another board of the sub-team finds."""
        if self.differ:
            self.offsets.hear_offsets(status.clocks, now)

    def on_time(self, source: str, message: M, now: float) -> M:
        """A message with its stamp by this board's clock. Refused: as `corrected`."""
        if not self.differ:
            return message
        time = self.corrected(source, message.time, now)
        return message if time == message.time else message.model_copy(update={"time": time})

    def corrected(self, source: str, stamp: float, now: float) -> float:
        """A stamp of a source by this board's clock. Refused: "future", "past", where its clock is off by more than is corrected."""
        if stamp - now <= self.limit:
            self.offsets.stamped(source, stamp, now)
        ahead = self.offsets.ahead(source)
        if not ahead:
            return stamp
        said = f"the clock of {quoted(source)} is {abs(ahead):.1f} s {'ahead' if ahead > 0 else 'behind'}"
        if abs(ahead) > self.limit:
            raise Refused("future" if ahead > 0 else "past", f"{said}; up to {self.limit:g} s are corrected")
        if source not in self._logged and len(self._logged) < MAX_LOGGED:
            self._logged.add(source)
            log.warning("%s; corrected, and not logged again for this source", said)
        return stamp - ahead

    def addressed(self, agreed: Consensus) -> Consensus:
        """What is agreed about a robot, with how far that robot's clock is ahead."""
        ahead = self.offsets.ahead(agreed.subject.removeprefix("robot/"))
        off = self.differ and agreed.subject.startswith("robot/") and ahead
        return agreed.model_copy(update={"ahead": ahead}) if off else agreed

    def shown(self, status: Status, now: float) -> Status:
        """A status with what the others need to know of this board's clock, and what it found of theirs."""
        if not self.differ:
            return status
        update = {"sent": now, "echo": self.echoes.held(now), "clocks": self.offsets.corrections()}
        return status.model_copy(update=update)
