"""Evidence that is lost: what a board has heard and does not settle, what does not reach every board, what a joint does not know."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from blackboard.board.board import Board
from blackboard.board.service import BoardService
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import Forward, PackedEvidence
from blackboard.wire.messages import Report
from robot_agent.gaussian.agent import JointAgent
from robot_agent.service import AgentService
from tests.nights.events import Event, Heard, Moved, Said, Stepped, opened
from tests.nights.ledger import Piece, name_of
from tests.nights.night import Night
from tests.nights.oracles import Broken, Oracle

#: Ticks after which every board has settled what a robot says: where there is no world its own board may wait for one, the others for
#: another one, and messages take up to a fifth.
DUE = 2.5
#: Times the variance of a robot's place by itself, that a joint has of it at most: half of what it tells counts where it enters again.
MOST = 2.0


@dataclass(frozen=True)
class Told:
    """A piece of evidence as a message has it, with its robot's tick."""

    piece: Piece
    tick: int


@dataclass
class Books:
    """What a board has heard, and what of it has been settled."""

    board: Board
    settled: set[Piece] = field(default_factory=set)
    heard: dict[str, dict[int, int]] = field(
        default_factory=dict
    )  # robot -> its epochs that were heard -> their newest ticks
    due: dict[Piece, float] = field(default_factory=dict)  # what the next settlement must have -> when it was heard
    own: set[Piece] = field(default_factory=set)  # of its own robots, heard since it settled last
    passing: set[Piece] = field(default_factory=set)  # the same, heard before that

    def note(self, told: Told, at: float) -> bool:
        """Whether what a board has heard is due: not where as new of its robot was heard, a later tick or a greater epoch."""
        robot, epoch, _ = told.piece
        epochs = self.heard.setdefault(robot, {})
        is_new = epoch >= max(epochs, default=epoch) and told.tick > epochs.get(epoch, -1)
        epochs[epoch] = max(told.tick, epochs.get(epoch, -1))
        if is_new and told.piece not in self.settled:
            self.due[told.piece] = at
        return is_new


def evidence_in(envelope: Envelope, sub_team: str = "") -> Iterator[Told]:
    """The evidence that a message holds for a board of a sub-team: what another board of it passes on is for others."""
    message = opened(envelope)[2]
    if isinstance(message, Report) and message.evidence is not None and message.subject == f"robot/{message.source}":
        yield _told(message.source, message.tick, message.evidence)
    for one in message.evidence if isinstance(message, Forward) and message.sub_team != sub_team else ():
        yield _told(one.robot, one.tick, one.evidence)


def _told(robot: str, tick: int, packed: PackedEvidence) -> Told:
    return Told((f"robot/{robot}", packed.epoch, packed.travelled.time), tick)


@dataclass(frozen=True)
class Before:
    """A board before it handles a message, and the evidence of honest robots in that."""

    board: Board
    goes_by: tuple[Pace, str]
    refused: int
    handled: int
    unregistered: int  # of those that were refused
    told: tuple[Told, ...] = ()
    is_own: bool = False  # whether it is told by a robot of its sub-team, not passed on
    registered: tuple[Told, ...] = ()  # of what another board passes on, that of robots which the board has there

    @classmethod
    def of(
        cls,
        service: BoardService,
        told: tuple[Told, ...] = (),
        *,
        is_own: bool = False,
        registered: tuple[Told, ...] = (),
    ) -> "Before":
        goes_by, refused = (service.clock.pace, service.clock.run), service.refused
        counts = refused.total(), service.counters["heard"], refused["unregistered"]
        return cls(service.board, goes_by, *counts, told, is_own, registered)

    def taken(self, service: BoardService) -> tuple[Told, ...]:
        """What has been handled: the board did not refuse the message, nor keep it for later, nor begin anew.

        What is passed on of a robot that is not there costs nothing of what else is passed on.
        """
        now = Before.of(service)
        if (self.board, self.goes_by) != (now.board, now.goes_by):
            return ()
        if now.unregistered - self.unregistered == now.refused - self.refused == 1:
            return self.registered
        return self.told if now.refused == self.refused and now.handled > self.handled else ()


def registered(envelope: Envelope, service: BoardService, told: tuple[Told, ...]) -> tuple[Told, ...]:
    """Of what a board that is there passes on: that of robots which are there."""
    message, there = opened(envelope)[2], service.participants
    if not isinstance(message, Forward) or not there.has_board(message.sub_team, message.board):
        return ()
    return tuple(one for one in told if there.has_robot(one.piece[0].removeprefix("robot/"), message.sub_team))


class HeardIsSettled(Oracle):
    """Evidence of an honest robot that a board has heard, and does not say that it refuses, is in what it settles next.

    What its own robots said, a board that leads all the time has passed on when it settles the next time, or another one has.
    Not asked of what is repeated, or overtaken by newer evidence of its robot, nor of what comes before a board can judge it
    (`EarlyIsTaken`). A board that begins anew, with another run, owes nothing.
    """

    sees = (Said, Heard, Stepped, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._passed: dict[str, set[Piece]] = defaultdict(set)  # by sub-team
        self._books: dict[str, Books] = {}  # by process
        self._hears: dict[str, Before] = {}  # by process, until it has heard
        self._stepped: set[str] = set()  # processes, since they were looked at last

    def see(self, event: Event) -> None:
        if isinstance(event, Said):
            if isinstance(event.message, Forward):
                self._passed[event.message.sub_team].update(told.piece for told in evidence_in(event.envelope))
        elif isinstance(event, Heard) and isinstance(service := event.service, BoardService):
            told = evidence_in(event.envelope, service.sub_team) if service.settings.fusion == "joint" else ()
            honest = tuple(one for one in told if one.piece[0] not in self.night.liars)
            if honest:
                is_own = keys.REPORT.match(event.envelope.key) is not None
                there = registered(event.envelope, service, honest)
                self._hears[event.process] = Before.of(service, honest, is_own=is_own, registered=there)
        elif isinstance(event, Stepped):
            self._books_of(event.process, event.board).settled.update(map(name_of, event.batch))
            self._stepped.add(event.process)
        elif isinstance(event, Moved) and isinstance(event.service, BoardService):
            self._look(event, event.service)

    def _books_of(self, process: str, board: Board) -> Books:
        if process not in self._books or self._books[process].board is not board:
            self._books[process] = Books(board)
        return self._books[process]

    def _look(self, event: Moved, service: BoardService) -> None:
        books, before = self._books_of(event.process, service.board), self._hears.pop(event.process, None)
        if not service.lead.leads:
            books.own, books.passing = set(), set()
        if event.process in self._stepped:
            self._stepped.discard(event.process)
            for piece in sorted(books.due.keys() - books.settled):
                self.breaks(
                    event.at, f"{event.process} settles without {piece}, which it heard at {books.due[piece]:.2f} s"
                )
            for piece in sorted(books.passing - self._passed[service.sub_team]):
                self.breaks(event.at, f"{event.process} has settled {piece} and not passed it on")
            books.due, books.own, books.passing = {}, set(), books.own
        for told in () if before is None else before.taken(service):
            if books.note(told, event.at) and before is not None and before.is_own:
                books.own.add(told.piece)


class EvidenceReachesAll(Oracle):
    """What an honest robot says once the team is well, `DUE` ticks later every board has settled, of its own sub-team and of others.

    Not asked of what is said in the last `DUE` ticks.
    """

    sees = (Said, Stepped, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._boards = [process for process in night.team.processes if process.startswith("board/")]
        self._said: dict[Piece, float] = {}
        #: Of each board what is due, the oldest first, and what it has settled.
        self._due: dict[str, list[Piece]] = {process: [] for process in self._boards}
        self._settled: dict[str, set[Piece]] = {process: set() for process in self._boards}

    def see(self, event: Event) -> None:
        if event.at <= self.night.well or self.night.team.fusion != "joint":
            return
        if isinstance(event, Said):
            if isinstance(event.message, Report) and event.process not in self.night.liars:
                for told in evidence_in(event.envelope):
                    if self._said.setdefault(told.piece, event.at) == event.at:
                        for due in self._due.values():
                            due.append(told.piece)
        elif isinstance(event, Stepped) and event.process in self._settled:
            self._settled[event.process].update(map(name_of, event.batch))
        elif isinstance(event, Moved) and event.process in self._due:
            due, late = self._due[event.process], event.at - DUE * self.night.team.tick
            while due and self._said[due[0]] < late:
                if (piece := due.pop(0)) not in self._settled[event.process]:
                    self.breaks(event.at, f"{event.process} lacks {piece}, which was said at {self._said[piece]:.2f} s")


class RobotsAreKnown(Oracle):
    """Once the team is well, a joint has each robot that it hears of, and knows its place about as well as it does by itself.

    In some direction its variance may be larger, because a gate has left evidence out: at most `MOST` times, and not in all steps
    until the end. How it is on average is judged over all nights (`run.uncalibrated`). Not asked on nights with a liar: what honest
    robots say is then bounded. On a poor link a robot tells its whole state where a board of its own sub-teams comes.

    Nor of a robot whose place a joint gave up since the faults were over, because others' evidence was beyond 99.9 %: honest evidence
    is so, too, once in 1 000 ticks or less, and only what is measured since then is known.
    """

    sees = (Moved, Stepped)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._is_asked = night.is_honest and night.team.fusion == "joint"
        self._own: dict[Piece, Array] = {}  # what the robot that gave a piece knew then of its own place
        self._shares: dict[tuple[str, str], list[float]] = defaultdict(list)  # of a board and a robot, after each step
        self._given_up: set[tuple[str, str]] = set()  # the same pairs

    def see(self, event: Event) -> None:
        if not self._is_asked:
            return
        if isinstance(event, Moved) and isinstance(event.service, AgentService):
            if (
                isinstance(event.service.agent, JointAgent)
                and (belief := event.service.agent.filter.belief) is not None
            ):
                mine = event.service.agent.filter
                self._own[mine.robot, mine.epoch, mine.travelled.dt] = belief.covariance[AXES, AXES]
        elif isinstance(event, Stepped) and event.at > self.night.healed:
            self._given_up |= {(event.process, robot) for robot in event.outvoted}
            for evidence in event.batch if event.at > self.night.well else ():
                own = self._own.get(name_of(evidence))
                mates = self.night.team.sub_teams[event.process.split("/")[1]]
                hears = not self.night.team.is_poor or evidence.robot.removeprefix("robot/") in mates
                if own is not None and hears and evidence.robot not in event.after:
                    self.breaks(
                        event.at, f"{event.process} does not have {evidence.robot}, which knows its place, in its joint"
                    )
                if own is not None and evidence.robot in event.after:
                    known = event.after.moments(evidence.robot).covariance[AXES, AXES]
                    share = float(np.linalg.eigvals(np.linalg.solve(own, known)).real.max())
                    self._shares[event.process, evidence.robot].append(share)

    def verdict(self) -> Broken | None:
        for (process, robot), shares in self._shares.items():
            if min(shares) > MOST and (process, robot) not in self._given_up:
                self.breaks(
                    self.night.end,
                    f"{process} knows {robot} with {min(shares):.1f} times the variance of its own filter",
                )
        return self._broken

    def sums(self) -> Counter[str]:
        sums = Counter[str]({"known n": len(self._shares)})
        for shares in self._shares.values():
            sums["known"] += sum(shares) / len(shares)  # type: ignore[assignment]
        return sums
