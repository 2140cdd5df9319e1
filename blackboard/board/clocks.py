"""The clocks of those that a board hears while each goes by its own Unix time: corrected, told, or refused by name. Pure."""

from __future__ import annotations

import logging

from blackboard.errors import Refused
from blackboard.process.offsets import Echoes, Offsets
from blackboard.process.printable import quoted
from blackboard.wire.messages import Status

log = logging.getLogger(__name__)

MAX_LOGGED = 1000  # sources that are remembered as logged


class Clocks:
    """Stamps of others as stamps of this board's clock. Robots are named as `r1`, boards as `b/board-b`; `now` is Unix seconds."""

    def __init__(self, name: str, limit: float) -> None:
        """`name` is this board's own, `limit` how many seconds are corrected."""
        self.name, self.limit = name, limit
        self.offsets, self.echoes = Offsets(), Echoes()
        self._logged: set[str] = set()

    def hear(self, source: str, status: Status, now: float) -> None:
        """Take the stamps of a status; one without (of an older version, or where there is a world) tells nothing."""
        echo = status.echo.get(self.name)
        if status.sent is not None and echo is not None:
            self.offsets.round_trip(source, status.sent, *echo, now)

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

    def shown(self, status: Status, now: float) -> Status:
        """A status with what the others need to know of this board's clock, and what it found of theirs."""
        update = {"sent": now, "echo": self.echoes.held(now), "clocks": self.offsets.found()}
        return status.model_copy(update=update)
