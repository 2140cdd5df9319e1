"""A service that prints the denials that a router reports."""

from collections.abc import Callable

from blackboard.access.doorkeeper import read
from blackboard.process.service import Quiet
from blackboard.wire.envelope import Envelope, Kind


class DenialWatch(Quiet):
    """Listens to what a router says about every member, and hands a line to `show` whenever a count has changed."""

    def __init__(self, team: str, show: Callable[[str], object]) -> None:
        self._team, self._show = team, show
        self._counts: dict[str, int] = {}
        self.listens = (f"door/{team}/**",)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        told = read(envelope.payload) if envelope.kind is Kind.PUT else None
        who = envelope.key.removeprefix(f"door/{self._team}/")
        if told is not None and told[0] != self._counts.get(who, 0):
            self._counts[who] = told[0]
            self._show(f"{who}: {told[0]} denied, the last: {told[1]!r}")
        return []
