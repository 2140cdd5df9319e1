"""What a board takes from robots and from other boards: whose message counts, by whose clock, and what has arrived of a tick. Pure."""

import logging
from collections.abc import Iterator

from blackboard.board.board import Board
from blackboard.board.clocks import Clocks
from blackboard.board.handover import Handover
from blackboard.board.lead import BoardRole, Lead
from blackboard.board.participants import Participants
from blackboard.board.steps import Steps
from blackboard.errors import Refused
from blackboard.process.in_vain import InVain
from blackboard.process.intake import Intake, TooEarly
from blackboard.process.roll_call import RollCall
from blackboard.process.team_clock import Pace
from blackboard.wire.evidence import Forward
from blackboard.wire.memory import Memory
from blackboard.wire.messages import Consensus, Report, Status
from blackboard.wire.types import Message

log = logging.getLogger(__name__)


class Reception:
    """Judges messages and gives them to a board; says what of a tick is not here yet. `now` is Unix time in seconds."""

    def __init__(self, name: str, participants: Participants, clocks: Clocks, lead: Lead, intake: Intake) -> None:
        self.name, self.sub_team = name, participants.sub_team
        self.participants, self.clocks, self.clock = participants, clocks, clocks.clock
        self.lead, self.intake = lead, intake

    def begin(self, board: Board, handover: Handover) -> None:
        """Forget what has arrived: from now on all goes to this board."""
        self.board, self.handover = board, handover
        self.steps = Steps()
        self._reports: RollCall[str] = RollCall()  # of the sub-team's robots
        self._consensuses: RollCall[tuple[str, str]] = RollCall()  # of other sub-teams' boards: sub-team and board
        #: robots of other sub-teams, for which a board does not wait -> a speed that counts once its team time (s) is over
        self._speeds: dict[str, tuple[float, float]] = {}
        self.in_vain = InVain()  # robots and boards, as a Clock names them

    def begin_tick(self, now: float) -> None:
        """A tick begins: what robots elsewhere said in earlier ones counts from now on, in whichever order it came."""
        self.steps.begin_tick()
        self._note_answers()
        begun = self.clock.time(now)
        for robot in [robot for robot, (time, _) in self._speeds.items() if time < begun]:
            self.board.ageing.learn_speed(robot, self._speeds.pop(robot)[1])

    def on_message(self, parts: dict[str, str], message: Message, now: float) -> bool:
        """Take a message of a robot or of another board. True: its sender should hear of this board at once. Refused, TooEarly."""
        if self.clock.pace is Pace.WAITING:
            raise TooEarly  # its stamp cannot be judged before the world's clock is known
        if isinstance(message, Status):
            return self._on_status(parts["sub_team"], message, now)
        if isinstance(message, Report):
            self._on_report(message, now)
        elif isinstance(message, Memory):
            self._on_memory(message, now)
        elif isinstance(message, Consensus) and message.sub_team != self.sub_team:
            self._on_consensus(message, now)
        elif isinstance(message, Forward) and (message.sub_team, message.board) != (self.sub_team, self.name):
            self._on_forward(message, now)
        return False

    # --- what of a tick is here ---------------------------------------------------------------------------------------

    def has(self, fact: str) -> bool:
        """Whether all "reports" of the tick, or all "consensuses" of the other boards, have arrived."""
        if fact == "consensuses" and self.participants.boards() is None:
            return False
        return next(self.lacks(fact), None) is None

    def lacks(self, fact: str) -> Iterator[str]:
        """Whose messages of the tick have not arrived, as a Clock names them."""
        tick = self.clock.tick
        for robot in self.participants.candidates() if fact == "reports" else ():
            if self._reports.complete(robot, tick) or f"robot/{robot}" in self.in_vain:
                continue
            if self.participants.awaits(robot):
                yield f"robot/{robot}"
        joint = self.board.joint
        for board in self.participants.boards() or () if fact == "consensuses" else ():
            has_forwarded = joint is None or joint.others.has_heard(board, tick)
            name = "/".join(("board", *board))
            if not (has_forwarded and self._consensuses.complete(board, tick)) and name not in self.in_vain:
                yield name

    def give_up(self, fact: str) -> None:
        """Wait no longer for who was waited for in vain, until it answers."""
        tick = self.clock.tick
        for name in list(self.lacks(fact)):
            left = self.in_vain.add(name, tick)
            log.warning("tick %d: %s was late; waited for again once it has answered %d ticks", tick, name, left)

    def _note_answers(self) -> None:
        """Count what those who were waited for in vain have answered since."""
        for name in self.in_vain.names:
            kind, *who = name.split("/")
            robot = kind == "robot"
            answered = self._reports.answered(who[0]) if robot else self._consensuses.answered((who[0], who[1]))
            if answered is not None:
                self.in_vain.answered(name, min(answered, self.clock.tick))

    def check(self) -> None:
        """AssertionError: a roll call is beyond its bounds."""
        self.steps.check()
        self._reports.check()
        self._consensuses.check()
        self.in_vain.check()

    # --- messages -----------------------------------------------------------------------------------------------------

    def _on_report(self, report: Report, now: float) -> None:
        source = report.source
        self.participants.check_robot(source)
        self.participants.hear_robot(source)
        try:
            report = self.clocks.on_time(source, report, now)
            self.board.hear(report, self.clock.time(now))
        except Refused as refusal:  # a stamp may be of a world whose Clock has not come yet
            raise self.participants.doubted(refusal) if refusal.reason in ("past", "future") else refusal from None
        self._reports.record(source, report.subject, report.tick)
        self.intake.record_age(source, now)
        self.board.hear_evidence(report, self.clocks.skew)
        self._hear_step(source, now)

    def _hear_step(self, robot: str, now: float) -> None:
        """Count a robot's step once all reports that its status lists have arrived; the status may come before them."""
        answered = self._reports.answered(robot)
        if answered is not None:
            self.steps.on_step(robot, answered, now)

    def _on_consensus(self, consensus: Consensus, now: float) -> None:
        board = consensus.sub_team, consensus.board
        self.participants.check_board(*board)
        self.clocks.echoes.hear_stamp("/".join(board), consensus.time, now)
        self.board.hear_consensus(self.clocks.on_time("/".join(board), consensus, now), self.clock.time(now))
        self._consensuses.record(board, consensus.subject, consensus.tick)

    def _on_forward(self, forward: Forward, now: float) -> None:
        if self.board.joint is None:
            return
        sub_team = forward.sub_team
        if sub_team == self.sub_team:  # of a twin, which hears the same robots
            self.participants.check_twin(forward.board)
            self.board.check_time(forward.time, self.clock.time(now))
            self.board.joint.others.hear_tracks(forward)
            return
        self.participants.check_board(sub_team, forward.board)
        forward = self.clocks.on_time(f"{sub_team}/{forward.board}", forward, now)
        self.board.check_time(forward.time, self.clock.time(now))
        self.board.joint.hear_forward(
            forward, lambda robot: self.participants.has_robot(robot, sub_team), self.clocks.skew
        )

    def _on_memory(self, memory: Memory, now: float) -> None:
        """Where this board follows, learn what its leader has learned."""
        self.participants.check_twin(memory.board)
        if self.lead.role is BoardRole.FOLLOWS and (memory.board, memory.run) == (self.lead.leader, self.clock.run):
            self.board.check_time(memory.time, self.clock.time(now))
            self.handover.take_memory(memory, lockstep=self.clock.pace is Pace.LOCKSTEP)

    def _on_status(self, sub_team: str, status: Status, now: float) -> bool:
        mine = sub_team == self.sub_team
        if status.kind == "robot":
            self._on_robot(sub_team, status, now)
        elif status.kind == "board" and mine and status.process != self.name:
            return self._on_twin(status, now)
        elif status.kind == "board" and not mine:
            self._on_board(sub_team, status, now)
        return False

    def _on_robot(self, sub_team: str, status: Status, now: float) -> None:
        """A robot says how fast it is, and one of this sub-team lists what it reported."""
        robot, mine = status.process, sub_team == self.sub_team
        if mine:
            self.participants.hear_robot(robot)
        lists = mine and status.phase == "reported"
        if lists:
            self.participants.check_robot(robot)
        if lists or self.participants.has_robot(robot, sub_team):
            self._learn_speed(status, mine or self.clock.named is None, self.clock.time(now))
            self.board.remember_tracks(status.tracks)
            self.clocks.hear_status(robot, status, now)
        if lists:
            self._reports.record_list(robot, status.tick, status.subjects)
            self.board.withdraw(robot, status.tick, {*status.subjects, *status.kept})
            self._hear_step(robot, now)

    def _learn_speed(self, status: Status, at_once: bool, begun: float) -> None:
        """Take the speed of a robot's tick: at once, or where that tick is not older than the one that has begun, once it is."""
        robot, speed = status.process, status.speed
        if speed is not None and (at_once or status.time < begun):
            self.board.ageing.learn_speed(robot, speed)
        elif speed is not None:
            time, earlier = self._speeds.get(robot, (status.time, speed))
            if time < status.time:
                self.board.ageing.learn_speed(robot, earlier)
            self._speeds[robot] = status.time, speed

    def _on_twin(self, status: Status, now: float) -> bool:
        """Another board of this sub-team says whether it leads, and what it has published."""
        self.participants.check_twin(status.process)
        if not status.follows:
            self.clocks.adopt(status, now)
        newest = self.clock.time(now) + self.board.settings.future
        return self.lead.hear_status(status, now, newest, any_tick=self.clocks.differ)

    def _on_board(self, sub_team: str, status: Status, now: float) -> None:
        """A board of another sub-team lists what it settled."""
        board = sub_team, status.process
        known = self.participants.has_board(*board)
        if known:
            self.clocks.hear_status("/".join(board), status, now)
            self.participants.hear_role(*board, follows=status.follows)
        if status.phase == "consensus" and not status.follows:
            # Outside lockstep an empty list changes nothing, and a board that has just started may send it before its token arrives.
            if not known and not status.subjects and self.clock.pace is not Pace.LOCKSTEP:
                return
            self.participants.check_board(*board)
            self._consensuses.record_list(board, status.tick, status.subjects)
            self.board.withdraw_consensuses(sub_team, status.tick, status.subjects)
            if self.board.joint is not None and known:
                self.board.joint.others.expect(board, status.settings.get("fusion") == "joint")
