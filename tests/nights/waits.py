"""Who waits for whom in lockstep: nobody goes on without what a tick takes, but for those who are late, and these not for ever."""

from collections import defaultdict

from blackboard.board.service import BoardService
from blackboard.process.in_vain import InVain
from blackboard.process.service import Service
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import Forward
from blackboard.wire.messages import Clock, Consensus, Report, Solo, Status
from robot_agent.service import AgentService
from sim_world.service import WorldService
from tests.nights.events import Began, Event, Heard, Moved, Said, Stepped, opened
from tests.nights.ledger import Piece, name_of
from tests.nights.night import Night
from tests.nights.oracles import Oracle
from tests.nights.receipts import evidence_in


class RobotsWaitForTheAgreed(Oracle):
    """In lockstep a robot acts on what its boards agreed on in the tick before, all of it, or counts the tick as late.

    Not asked of its first tick of a run, nor of the first by the world's clock.
    """

    sees = (Began, Heard, Said)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: By process: run, tick and late ones, when it reported last, since it goes by the world's clock.
        self._done: dict[str, tuple[str, int, int]] = {}
        #: By process: sub-team and subject -> the newest tick of what was agreed about it that was heard.
        self._heard: dict[str, dict[tuple[str, str], int]] = defaultdict(dict)

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            for table in (self._done, self._heard):
                table.pop(event.process, None)
            return
        assert isinstance(event, Heard | Said)
        if not isinstance(robot := event.service, AgentService):
            return
        if robot.clock.pace is not Pace.LOCKSTEP:
            self._done.pop(event.process, None)
        if isinstance(event, Heard):
            message = opened_as_consensus(event.envelope)
            if message is not None:
                heard, what = self._heard[event.process], (message.sub_team, message.subject)
                heard[what] = max(message.tick, heard.get(what, -1))
        elif isinstance(event, Said) and isinstance(event.message, Report) and robot.clock.pace is Pace.LOCKSTEP:
            self._judge(event, robot)

    def _judge(self, event: Said, robot: AgentService) -> None:
        late, clock = robot.counters["late"], robot.clock.followed
        now = robot.run, robot.tick, late
        run, tick, before = self._done.get(event.process, now)
        self._done[event.process] = now
        if run != now[0] or tick == now[1] or clock is None or late > before:
            return
        heard = self._heard[event.process]
        for sub_team in robot.peer.sub_teams:
            for subject in clock.settled.get(sub_team, []):
                if heard.get((sub_team, subject), -1) < clock.tick - 1:
                    self.breaks(
                        event.at,
                        f"{event.process} does tick {clock.tick} before it has what {sub_team} agreed on {subject}",
                    )


def opened_as_consensus(envelope: Envelope) -> Consensus | None:
    """What was agreed, where an envelope is that."""
    if keys.AGREED.match(envelope.key) is None:
        return None
    message = opened(envelope)[2]
    return message if isinstance(message, Consensus) else None


class BoardsWait(Oracle):
    """What a board in lockstep must have when it is done with a phase of a tick, unless it counts the tick as late."""

    sees = (Began, Heard, Said)
    phase = ""

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: Board -> the run, ticks that were late, and the tick, when it was done with the newest one.
        self._done: dict[str, tuple[str, int, int]] = {}

    def see(self, event: Event) -> None:
        if self.night.team.mode != "lockstep":
            return
        if isinstance(event, Began):
            self._done.pop(event.process, None)
            self.forget(event.process)
        elif isinstance(event, Heard) and isinstance(event.service, BoardService):
            self.hear(event, event.service)
        elif isinstance(event, Said) and isinstance(status := event.message, Status) and status.phase == self.phase:
            board = event.service
            assert isinstance(board, BoardService)
            now = board.clock.run, board.counters["late"], status.tick
            before, self._done[event.process] = self._done.get(event.process, ("", -1, -1)), now
            if before[0] != board.clock.run:
                self.begin_run(event.process)
            goes_by_it = board.clock.pace is Pace.LOCKSTEP and status.tick == board.clock.tick
            if goes_by_it and before[:2] == now[:2] and before[2] != status.tick:
                self.judge(event, status.tick, board)

    def forget(self, process: str) -> None:
        """A process was started: it has heard nothing."""
        raise NotImplementedError

    def begin_run(self, process: str) -> None:
        """A board is done with the first tick of a run."""

    def hear(self, event: Heard, board: BoardService) -> None:
        """A board hears something."""
        raise NotImplementedError

    def judge(self, event: Said, tick: int, board: BoardService) -> None:
        """A board is done with the phase of a tick, and not late."""
        raise NotImplementedError


class BoardsWaitForForwards(BoardsWait):
    """In lockstep a joint is done with a tick when it has what each board passes on whose tick it has, or counts the tick as late.

    Not asked of what a board listed before it yielded: nobody waits for who follows, and who leads instead passes on the same robots'.
    """

    phase = "agreed"

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        #: By process: boards, as sub-team and name, and the ticks that their statuses list, and that they passed on.
        self._listed: dict[str, set[tuple[str, str, int]]] = defaultdict(set)
        self._passed: dict[str, set[tuple[str, str, int]]] = defaultdict(set)

    def forget(self, process: str) -> None:
        for table in (self._listed, self._passed):
            table.pop(process, None)

    begin_run = forget

    def hear(self, event: Heard, board: BoardService) -> None:
        _, parts, message = opened(event.envelope)
        if isinstance(message, Forward):
            self._passed[event.process].add((message.sub_team, message.board, message.tick))
        elif isinstance(message, Status) and message.kind == "board":
            other, listed = (parts["sub_team"], message.process), self._listed[event.process]
            if message.follows:
                listed -= {of for of in listed if of[:2] == other}
            elif message.phase == "consensus":
                listed.add((*other, message.tick))

    def judge(self, event: Said, tick: int, board: BoardService) -> None:
        if self.night.team.fusion != "joint":
            return
        for sub_team, name, listed in self._listed[event.process] - self._passed[event.process]:
            waits = (
                board.participants.has_board(sub_team, name)
                and f"board/{sub_team}/{name}" not in board.reception.in_vain
            )
            if listed == tick and sub_team != board.sub_team and waits:
                self.breaks(event.at, f"{event.process} is done with tick {tick} before it has what {name} passes on")


class BoardsWaitForReports(BoardsWait):
    """In lockstep a board settles what its robots list as reported in a tick once all that is here, or counts the tick as late."""

    phase = "consensus"

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._begun: dict[str, float] = {}  # run -> when its first Clock was said
        #: By process: the robots' newest lists, and when each of their reports was heard last, by source, subject and tick.
        self._lists: dict[str, dict[str, Status]] = defaultdict(dict)
        self._heard: dict[str, dict[tuple[str, str, int], float]] = defaultdict(dict)

    def see(self, event: Event) -> None:
        if isinstance(event, Said) and isinstance(event.message, Clock):
            self._begun.setdefault(event.message.run, event.at)
        super().see(event)

    def forget(self, process: str) -> None:
        self._lists.pop(process, None)
        self._heard.pop(process, None)

    def hear(self, event: Heard, board: BoardService) -> None:
        topic, parts, message = opened(event.envelope)
        if isinstance(message, Report):
            self._heard[event.process][message.source, message.subject, message.tick] = event.at
        elif topic is keys.STATUS and isinstance(message, Status) and parts["sub_team"] == board.sub_team:
            self._lists[event.process] |= {message.process: message} if message.phase == "reported" else {}

    def judge(self, event: Said, tick: int, board: BoardService) -> None:
        heard, begun = self._heard[event.process], self._begun.get(board.clock.run, 0.0)
        for robot in board.participants.robots():
            listed = self._lists[event.process].get(robot)
            if listed is None or listed.tick != tick or f"robot/{robot}" in board.reception.in_vain:
                continue
            for subject in listed.subjects:
                ticks = [t for (*said, t), at in heard.items() if said == [robot, subject] and at >= begun]
                if max(ticks, default=-1) < tick:
                    self.breaks(
                        event.at, f"{event.process} settles tick {tick} before it has what {robot} reports of {subject}"
                    )


class LockstepIsWhole(Oracle):
    """In lockstep, once the team is well, a board is done with a tick when it has all that was said in it, or counts it as late.

    A joint has settled all evidence of the tick. What is pooled is of the tick, from every robot that can say everything, and from
    every sub-team. Not asked of a board that waits for somebody no longer (`LateAreWaitedForAgain`).
    """

    sees = (Began, Said, Stepped)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._is_asked = night.team.mode == "lockstep" and night.is_honest
        self._may_be_old = night.team.is_poor or bool(
            night.team.unnamed
        )  # what is seen now and then without a name is kept
        self._late: dict[str, int] = {}  # board -> ticks that were late when it was done with the one before
        self._tick: dict[str, int] = {}  # board -> the newest tick with which it was done
        self._said: dict[Piece, int] = {}  # the evidence of the newest ticks, with the tick
        self._settled: dict[str, set[Piece]] = defaultdict(set)  # by process
        self._clock: Clock | None = None

    def see(self, event: Event) -> None:
        if not self._is_asked:
            return
        if isinstance(event, Began):
            self._late.pop(event.process, None)
        elif event.at <= self.night.well:
            return
        elif isinstance(event, Stepped):
            self._settled[event.process].update(map(name_of, event.batch))
        elif isinstance(event, Said):
            self._hear(event)

    def _hear(self, event: Said) -> None:
        message, board = event.message, event.service
        if isinstance(message, Clock):
            self._clock = message
        elif isinstance(message, Report):
            for told in evidence_in(event.envelope):
                self._said.setdefault(told.piece, told.tick)
        elif isinstance(board, BoardService) and isinstance(message, Consensus) and message.rule != "joint":
            self._judge_ages(event, board, message)
        elif isinstance(board, BoardService) and isinstance(message, Status) and message.phase == "agreed":
            self._judge_pieces(event, board, message)

    def _is_on_time(self, process: str, board: BoardService) -> bool:
        late = board.counters["late"]
        before, self._late[process] = self._late.get(process, -1), late
        return late == before and not board.reception.in_vain.names

    def _judge_pieces(self, event: Said, board: BoardService, status: Status) -> None:
        is_on_time, before = self._is_on_time(event.process, board), self._tick.get(event.process)
        self._tick[event.process] = status.tick
        if (
            not is_on_time
            or before == status.tick
            or self._clock is None
            or status.tick != self._clock.tick
            or board.board.joint is None
        ):
            return
        for piece in sorted(piece for piece, tick in self._said.items() if tick == status.tick):
            if piece not in self._settled[event.process]:
                self.breaks(event.at, f"{event.process} is done with tick {status.tick} without {piece}")

    def _judge_ages(self, event: Said, board: BoardService, consensus: Consensus) -> None:
        may_be_old = consensus.level == "consensus" and self._may_be_old
        known = self._late.get(event.process) == board.counters["late"] and not board.reception.in_vain.names
        if not known or may_be_old or not consensus.subject.startswith("robot/"):
            return
        for used in consensus.used:
            if used.age > 0.0:
                what = f"the {consensus.level} of {event.process} on {consensus.subject} in tick {consensus.tick}"
                self.breaks(event.at, f"{what} takes what {used.source} said {used.age:.1f} s before")


class LateAreWaitedForAgain(Oracle):
    """Who was waited for in vain, and has answered as many ticks as it owes since the faults are over, is waited for again."""

    sees = (Began, Heard, Moved)
    slack = 3  # ticks: an answer is counted when the next tick begins, and the first ones may be of a tick that counted

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._answers: dict[str, dict[str, set[int]]] = defaultdict(
            lambda: defaultdict(set)
        )  # process -> who, and which ticks
        self._owed: dict[
            tuple[str, str], tuple[int, int]
        ] = {}  # process and who -> how often in vain, ticks that it owed at first

    def see(self, event: Event) -> None:
        if isinstance(event, Began):
            self._answers.pop(event.process, None)
            self._owed = {of: owed for of, owed in self._owed.items() if of[0] != event.process}
        elif event.at <= self.night.healed or not self.night.is_honest:
            return
        elif isinstance(event, Heard):
            for who, tick in answers_in(event):
                self._answers[event.process][who].add(tick)
        elif isinstance(event, Moved):
            self._look(event)

    def _look(self, event: Moved) -> None:
        in_vain = in_vain_of(event.service)
        if in_vain is None:
            return
        answers = self._answers[event.process]
        for who in in_vain.names:
            times, left, _ = in_vain.debts[who]
            if self._owed.get((event.process, who), (0, 0))[0] != times:
                self._owed[event.process, who] = times, left
                answers[who].clear()
            elif len(answers[who]) > self._owed[event.process, who][1] + self.slack:
                self.breaks(
                    event.at,
                    f"{event.process} does not wait for {who}, which has answered {len(answers[who])} ticks since",
                )


def in_vain_of(service: Service) -> InVain | None:
    """Whom a process waits for no longer; None: it waits for nobody."""
    if isinstance(service, BoardService):
        return service.reception.in_vain
    return service.members.in_vain if isinstance(service, WorldService) else None


def answers_in(event: Heard) -> list[tuple[str, int]]:
    """Who has answered which tick, by what a process hears."""
    topic, parts, message = opened(event.envelope)
    if isinstance(message, Solo) and event.process == "world":
        return [(f"robot/{message.robot}", message.tick)]
    if topic is not keys.STATUS or not isinstance(message, Status):
        return []
    if message.kind == "board":
        answers = message.phase == "consensus" and (event.process == "world" or not message.follows)
        return [(f"board/{parts['sub_team']}/{message.process}", message.tick)] if answers else []
    return (
        [(f"robot/{message.process}", message.tick)] if message.phase == "reported" and event.process != "world" else []
    )
