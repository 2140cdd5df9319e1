"""Whether somebody speaks for each sub-team, also while a board hangs."""

from dataclasses import dataclass

from blackboard.board.lead import HOLD, PHASES
from blackboard.board.service import BoardService
from blackboard.wire.messages import Consensus, Status
from tests.nights.events import Began, Event, Moved, Said
from tests.nights.night import Night
from tests.nights.oracles import Oracle

ASLEEP = 1.5  # seconds without being woken after which a board may have been frozen
LATE = 1.0  # seconds by which a board may be woken later than it asks, because it is slow

MUTE = 2.5  # seconds in which a board that leads may publish nothing of what it settles: what another one published before is later


@dataclass
class Silence:
    """What a board has settled that nobody publishes. Times are seconds of the night."""

    looked: float
    knows: tuple[object, ...]  # its run, who leads, and which boards are there
    since: float | None = None


class SomebodySpeaks(Oracle):
    """What a board settles is published by its leader, or by itself: where it knows of none after `HOLD`, else after `silent`."""

    sees = (Began, Said, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._silences: dict[str, Silence] = {}
        self._done: dict[str, tuple[float, int]] = {}  # process -> team time and phase of its newest status
        self._published: dict[str, tuple[float, int]] = {}  # sub-team -> those of the newest of its leader

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._silences.pop(event.process, None)
            self._done.pop(event.process, None)
        elif isinstance(event, Said) and isinstance(event.message, Status) and event.message.kind == "board":
            self._hear(event, event.message)
        elif isinstance(event, Moved) and isinstance(event.service, BoardService):
            self._look(event, event.service)

    def _hear(self, event: Said, status: Status) -> None:
        if status.phase not in PHASES:
            return
        sub_team, done = event.parts["sub_team"], (status.time, PHASES.index(status.phase))
        is_new, self._done[event.process] = self._done.get(event.process) != done, done
        mine = self._silences.get(event.process)
        if not status.follows:
            self._published[sub_team] = done
            for process, silence in self._silences.items():
                if process.split("/")[1] == sub_team and (is_new or done >= self._done.get(process, done)):
                    silence.since = None
        elif is_new and mine is not None and mine.since is None and self._is_later(done, self._published.get(sub_team)):
            mine.since = event.at

    def _is_later(self, done: tuple[float, int], published: tuple[float, int] | None) -> bool:
        """Whether one is of a later phase; where time runs on two boards settle one tick at two times."""
        if published is None:
            return True
        later = done[0] - published[0]
        return later > self.night.team.tick / 2 or (abs(later) <= self.night.team.tick / 2 and done[1] > published[1])

    def _look(self, event: Moved, board: BoardService) -> None:
        knows = board.clock.run, board.clock.pace, board.lead.leader, tuple(board.roster.boards.get(board.sub_team, ()))
        silence = self._silences.setdefault(event.process, Silence(event.at, knows))
        slept, silence.looked = event.at - silence.looked > ASLEEP, event.at
        if slept or board.roster.away or board.lead.leads or silence.knows != knows:
            silence.since, silence.knows = None, knows
        elif silence.since is not None:
            most = HOLD if board.lead.leader is None else board.lead.silent
            if event.at - silence.since > most + LATE:
                self.breaks(
                    event.at, f"nobody publishes what {event.process} settled {event.at - silence.since:.1f} s before"
                )


class LeadersSpeak(Oracle):
    """A board that leads publishes what it settles, once it has led for `MUTE` seconds."""

    sees = (Began, Said, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._mute: dict[str, Silence] = {}  # by process, since it began to lead, or spoke
        self._settled: dict[str, int] = {}  # by process, what it had settled then

    def see(self, event: Event) -> None:
        if isinstance(event, Began) or (isinstance(event, Said) and isinstance(event.message, Consensus)):
            self._mute.pop(event.process, None)
        elif isinstance(event, Moved) and isinstance(event.service, BoardService):
            self._look(event, event.service)

    def _look(self, event: Moved, board: BoardService) -> None:
        knows, settled = (board.clock.run, board.clock.pace, board.lead.leads), board.counters["settled"]
        mute = self._mute.get(event.process)
        if mute is None or mute.knows != knows or event.at - mute.looked > ASLEEP or not board.lead.leads:
            self._mute[event.process] = Silence(event.at, knows, event.at)
            self._settled[event.process] = settled
            return
        mute.looked = event.at
        if mute.since is not None and event.at - mute.since > MUTE and settled > self._settled[event.process]:
            self.breaks(
                event.at,
                f"{event.process} leads and publishes nothing of what it settled for {event.at - mute.since:.1f} s",
            )
