"""Clocks, and what is numbered by them: a board knows whose clock is off, and no run of a world has the name of another one."""

from blackboard.board.service import BoardService
from blackboard.process.offsets import TOLERANCE
from blackboard.process.service import Service
from blackboard.process.team_clock import Pace
from blackboard.wire.messages import Clock, Consensus
from tests.nights.events import Began, Ended, Event, Heard, Over, Said, opened
from tests.nights.faults import AnotherBoard
from tests.nights.night import Night
from tests.nights.oracles import Oracle

#: Seconds: a correction changes in steps of `TOLERANCE`, and a board takes messages up to a tick of a slow process later.
EXACT = 3 * TOLERANCE
TOLD = 1.5  # seconds in which each robot says which tracks it has heard of


class ClocksAreKnown(Oracle):
    """Where each process goes by its own clock, a board knows in the end how far those are off that it hears.

    Not asked on poor links, where robots seldom say by which round trips a board can find it out.
    """

    sees = (Began, Ended, Over)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._running: dict[str, Service] = {}

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._running[event.process] = event.service
        elif isinstance(event, Ended):
            self._running.pop(event.process, None)
        elif not self.night.team.is_poor:
            for process, service in self._running.items():
                if isinstance(service, BoardService) and service.clock.pace is Pace.FREE:
                    self._look(event.at, process, service)

    def _look(self, at: float, process: str, board: BoardService) -> None:
        team = self.night.team
        leader = f"board/{board.sub_team}/{board.lead.leader}"
        if leader not in self._running or self._ahead(leader, at) != self._ahead(process, at):
            return  # it goes by what its leader finds, which is right by the clock of that one
        known = {robot: f"robot/{robot}" for robot in team.sub_teams[board.sub_team]}
        known |= {
            name.removeprefix("board/"): name for name in self._running if name.startswith("board/") and name != process
        }
        for source, other in known.items():
            if other.startswith(f"board/{board.sub_team}/") or other not in self._running:
                continue
            off = self._ahead(other, at) - self._ahead(process, at)
            told = board.clocks.offsets.ahead(source)
            if abs(told - off) > EXACT:
                self.breaks(at, f"{process} takes the clock of {other} for {told:.2f} s ahead, and it is {off:.2f} s")

    def _ahead(self, process: str, at: float) -> float:
        return sum(fault.ahead(process, at) for fault in self.night.faults)


class RunsAreNew(Oracle):
    """A run of a world has a name of its own, also where that is started again, and goes on tick by tick, none of them twice."""

    sees = (Began, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._lives: dict[str, int] = {}  # process -> how often it was started
        self._runs: dict[
            str, tuple[tuple[str, int], int]
        ] = {}  # run -> whose it is, in which life, and its newest tick

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._lives[event.process] = self._lives.get(event.process, 0) + 1
        elif isinstance(event, Said) and isinstance(clock := event.message, Clock):
            of = event.process, self._lives[event.process]
            before, tick = self._runs.get(clock.run, (of, clock.tick))
            self._runs[clock.run] = of, clock.tick
            if before != of:
                self.breaks(event.at, f"{event.process} begins a run under the name {clock.run} of an earlier one")
            elif not clock.end and clock.tick not in (tick, tick + 1):
                self.breaks(event.at, f"{event.process} goes from tick {tick} to tick {clock.tick}")


class TracksAreNumberedOn(Oracle):
    """A board that is started again gives no track a name that a robot has heard of before, where no other board is left to know it.

    Not asked of what it names while faults may keep the robots' statuses from it, nor on poor links, where those are rare.
    """

    sees = (Began, Heard, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        boards = [name for name in night.team.processes if name.startswith("board/")]
        others = any(isinstance(fault, AnotherBoard) for fault in night.faults)
        self._is_asked = len(boards) == 1 and not others and not night.team.is_poor and night.is_honest
        self._board: BoardService | None = None
        self._lives = 0  # of the board
        self._heard: dict[
            tuple[str, str], int
        ] = {}  # run and name of a track -> in which life of the board a robot heard it first
        self._named: set[tuple[int, str, str]] = set()  # life, run and name of what a board has told

    def see(self, event: Event) -> None:
        if not self._is_asked:
            return
        if isinstance(event, Began):
            if isinstance(event.service, BoardService):
                self._board, self._lives = event.service, self._lives + 1
            else:
                self._heard = {}  # who is started again has heard nothing
            return
        message = (
            opened(event.envelope)[2]
            if isinstance(event, Heard)
            else event.message
            if isinstance(event, Said)
            else None
        )
        if (
            not isinstance(message, Consensus)
            or message.level != "agreed"
            or not all(message.number)
            or self._board is None
        ):
            return
        track = self._board.clock.run, message.subject
        if isinstance(event, Heard) and event.process.startswith("robot/"):
            self._heard.setdefault(track, self._lives)
        elif isinstance(event, Said) and (self._lives, *track) not in self._named:
            self._named.add((self._lives, *track))
            if self._heard.get(track, self._lives) != self._lives and event.at > self.night.healed + TOLD:
                self.breaks(event.at, f"{event.process} gives the name {message.subject} again")
