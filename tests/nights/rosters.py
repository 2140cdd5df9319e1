"""Whether those who count as there are there."""

from collections.abc import Iterable

from blackboard.board.service import BoardService
from blackboard.process.roster import Roster
from blackboard.process.service import Service
from blackboard.wire import keys
from tests.nights.events import Began, Ended, Event, Moved, Over
from tests.nights.night import Night
from tests.nights.oracles import Oracle


class RostersAreTrue(Oracle):
    """In the end a board counts exactly those who are there, and nobody is forgotten while the router is away."""

    sees = (Began, Ended, Moved, Over)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._running: dict[str, Service] = {}
        self._away: dict[Service, set[str]] = {}  # who counted when a process that is cut off was looked at last

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._running[event.process] = event.service
        elif isinstance(event, Ended):
            self._running.pop(event.process, None)
        elif isinstance(event, Moved):
            self._look(event)
        else:
            there = {token for service in self._running.values() for token in service.tokens}
            for process, service in self._running.items():
                counted = _counted(service.roster) if isinstance(service, BoardService) else _names(there)
                if wrong := sorted(counted ^ _names(there)):
                    self.breaks(event.at, f"{process} is wrong about who is there: {wrong[0]}")

    def _look(self, event: Moved) -> None:
        roster = getattr(event.service, "roster", None)
        before = self._away.pop(event.service, set())
        if isinstance(roster, Roster) and roster.away:
            self._away[event.service] = _counted(roster)
            if forgotten := sorted(before - self._away[event.service]):
                self.breaks(event.at, f"{event.process} forgets {forgotten[0]} while the router is away")


class EarlyIsTaken(Oracle):
    """What a robot said before its token came is judged once the token is there."""

    sees = (Moved,)

    def see(self, event: Event) -> None:
        if not isinstance(event, Moved) or not isinstance(board := event.service, BoardService):
            return
        for key, reason in board.intake.doubted.items():
            parts = keys.REPORT.match(key)
            if reason == "unregistered" and parts and parts["source"] in board.roster.robots.get(parts["sub_team"], ()):
                self.breaks(event.at, f"{event.process} keeps {key}, whose sender is there, and does not judge it")


def _counted(roster: Roster) -> set[str]:
    """All who count as there, by the names of processes in a night."""
    processes = {
        f"{kind}/{s}/{name}"
        for kind in ("robot", "board")
        for s, names in getattr(roster, f"{kind}s").items()
        for name in names
    }
    return processes | ({"world"} if roster.world else set())


def _names(tokens: Iterable[str]) -> set[str]:
    processes = set[str]()
    for token in tokens:
        if parts := keys.MEMBER.match(token):
            processes.add(f"robot/{parts['sub_team']}/{parts['robot']}")
        elif parts := keys.BOARD.match(token):
            processes.add(f"board/{parts['sub_team']}/{parts['board']}")
        elif keys.WORLD.match(token):
            processes.add("world")
    return processes
