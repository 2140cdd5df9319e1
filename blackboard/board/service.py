"""The board process: envelopes to messages around a Board, and what it sends at the end of each phase of a tick.

Long, because it is the whole protocol of a board's process: what it hears, when a tick is over, what it sends.

The table `blackboard.process.rounds.BOARD` says when a phase is over (docs/design.md, "A tick in lockstep").
"""

from __future__ import annotations

import logging
from functools import partial

from blackboard.board.board import Board
from blackboard.board.joint.desk import JointDesk
from blackboard.board.participants import Participants
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake, TooEarly
from blackboard.process.roll_call import RollCall
from blackboard.process.roster import Roster
from blackboard.process.rounds import BOARD, Rounds
from blackboard.process.team_clock import WORLD_SILENT, News, Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import Forward
from blackboard.wire.messages import Clock, Consensus, Report, Status
from blackboard.wire.types import MAX_OPINIONS, Message

log = logging.getLogger(__name__)


class BoardService:
    """The board process of one sub-team (`blackboard.process.service.Service`)."""

    def __init__(self, *, team: str, sub_team: str, board: str, grid: Grid, settings: BoardSection) -> None:
        self.team, self.sub_team, self.name = team, sub_team, board
        self.grid, self.settings = grid, settings
        self.intake = Intake()
        self.counters, self.refused = self.intake.counters, self.intake.refused
        self.roster = Roster(*self.tokens)
        self.clock = TeamClock(self.roster, settings.period)
        self.participants = Participants(self.roster, self.clock, team, sub_team)
        self.rounds = Rounds(BOARD, {"patience": settings.patience, "half a period": settings.period / 2}, "settled")
        self._settings = settings_in_force(settings)
        self._pace = self.clock.pace  # the pace at which early messages were retried last
        self._begin()

    def _begin(self) -> None:
        """Forget all messages: a new run begins, or stamps have another time base from now on."""
        self.board = Board(self.sub_team, self.name, self.grid, self.settings, self.intake.failures.survive)
        self.rounds.enter("settled", 0.0)
        self._reports: RollCall[str] = RollCall()  # of the sub-team's robots
        self._consensuses: RollCall[tuple[str, str]] = RollCall()  # of other sub-teams' boards: sub-team and board
        self._sent: list[Envelope] = []  # in this tick; sent again when the world repeats its Clock
        self._joint = None if self.settings.fusion == "opinions" else JointDesk(self.grid, self.settings, self.counters)
        self._settled: Status | None = None  # the status after the newest settlement

    # --- what the loop needs ----------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return (keys.BOARD.key(team=self.team, sub_team=self.sub_team, board=self.name),)

    @property
    def listens(self) -> tuple[str, ...]:
        team, mine = self.team, self.sub_team
        return (
            keys.CLOCK.key(team=team),
            keys.REPORT.key(team=team, sub_team=mine, source="*", subject="**"),
            keys.CONSENSUS.key(team=team, sub_team="*", subject="**"),
            *([] if self.settings.fusion == "opinions" else [keys.FORWARD.key(team=team, sub_team="*", board="*")]),
            keys.STATUS.key(team=team, sub_team="*", process="*"),
        )

    @property
    def watches(self) -> tuple[str, ...]:
        return (
            keys.MEMBER.key(team=self.team, sub_team="*", robot="*"),
            keys.BOARD.key(team=self.team, sub_team="*", board="*"),
            keys.WORLD.key(team=self.team),
        )

    @property
    def done(self) -> bool:
        return False

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.intake.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self._hold(now)
            self.roster.hear(envelope, now)
            out = self._retry(now) if envelope.kind is Kind.ALIVE else []
        else:
            out = self.intake.take(envelope, lambda parts, message: self._hear(parts, message, now))
        return out + self._advance(now)

    def wake(self, now: float) -> list[Envelope]:
        out = self._advance(now)
        return [*out, self._status(now)] if now >= self.intake.status_due else out

    def wake_at(self, now: float) -> float | None:
        rounds_end = self.rounds.ends_at(self.clock.pace)
        return min(self.intake.status_due, rounds_end, self.clock.changes_at(), self.roster.changes_at())

    # --- receiving --------------------------------------------------------------------------------------------------------

    def _hear(self, parts: dict[str, str], message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            return self._follow(self._hear_clock(message, now), now)
        if self.clock.pace is Pace.WAITING:
            raise TooEarly  # its stamp cannot be judged before the world's clock is known
        time = self.clock.time(now)
        if isinstance(message, Report):
            self.participants.check_robot(message.source)
            self._hear_report(message, time)
            self._reports.record(message.source, message.subject, message.tick)
            self.intake.record_age(message.source, now)
            about_itself = message.subject == f"robot/{message.source}"
            if self._joint is not None and message.evidence is not None and about_itself:
                self._joint.take(message.source, message.tick, message.time, message.evidence, own=True)
        elif isinstance(message, Consensus) and message.sub_team != self.sub_team:
            self.participants.check_board(message.sub_team, message.board)
            self.board.hear_consensus(message, time)
            self._consensuses.record((message.sub_team, message.board), message.subject, message.tick)
        elif isinstance(message, Forward) and message.sub_team != self.sub_team and self._joint is not None:
            self.participants.check_board(message.sub_team, message.board)
            self.board.check_time(message.time, time)
            self._joint.hear(message, lambda robot: self.participants.has_robot(robot, message.sub_team))
        elif isinstance(message, Status):
            self._hear_status(parts["sub_team"], message)
        return []

    def _hear_clock(self, clock: Clock, now: float) -> News:
        if not self.roster.world:
            self.counters["unannounced"] += 1
            if self.counters["unannounced"] == 1:
                log.warning(
                    "a Clock without %s is not followed before that token is there", keys.WORLD.key(team=self.team)
                )
        return self.clock.hear(clock, now)

    def _hear_report(self, report: Report, time: float) -> None:
        try:
            self.board.hear(report, time)
        except Refused as refusal:
            if self.clock.pace is Pace.FREE and refusal.reason in ("past", "future"):
                raise TooEarly(refusal) from None  # it may be stamped by a world whose Clock has not come yet
            raise

    def _hear_status(self, sub_team: str, status: Status) -> None:
        if status.kind == "robot" and sub_team == self.sub_team and status.phase == "reported":
            self.participants.check_robot(status.process)
            self._reports.record_list(status.process, status.tick, status.subjects)
            self.board.withdraw(status.process, status.tick, status.subjects)
        elif status.kind == "board" and sub_team != self.sub_team and status.phase == "consensus":
            # Outside lockstep an empty list changes nothing, and a board that has just started may send it before its token arrives.
            if status.subjects or self.clock.pace is Pace.LOCKSTEP:
                self.participants.check_board(sub_team, status.process)
            elif status.process not in self.roster.boards.get(sub_team, []):
                return
            self._consensuses.record_list((sub_team, status.process), status.tick, status.subjects)
            self.board.withdraw_consensuses(sub_team, status.process, status.tick, status.subjects)
            if self._joint is not None and status.process in self.roster.boards.get(sub_team, []):
                self._joint.expect((sub_team, status.process), status.settings.get("fusion") == "joint")

    def _retry(self, now: float) -> list[Envelope]:
        return self.intake.retry(lambda parts, message: self._hear(parts, message, now))

    # --- when to settle ---------------------------------------------------------------------------------------------------

    def _follow(self, news: News, now: float) -> list[Envelope]:
        """React to what is new about the team clock, and return what is to be sent."""
        if news is News.NOTHING:
            return []
        if news is News.REPEATED:
            self.counters["repeated"] += 1
            return list(self._sent)
        if news is not News.TICK:
            self._begin()
        if news is News.FREE:
            log.warning(
                "the world is gone, its last Clock is %g s old: going by Unix time, starting afresh", WORLD_SILENT
            )
            return []
        self.rounds.enter("reports", now)
        self._sent = []
        return []

    def _advance(self, now: float) -> list[Envelope]:
        """Do what can be done: settle once the reports are in, exchange once the other boards' consensuses are."""
        self._hold(now)
        self.roster.forget(now)
        out: list[Envelope] = []
        while (news := self.clock.look(now)) is not News.NOTHING:
            out += self._follow(news, now)
        if self.clock.pace is not self._pace:
            self._pace = self.clock.pace
            out += self._retry(now)
        while (ended := self.rounds.turn(self.clock.pace, now, self._holds)) is not None:
            phase, late = ended
            if late:
                self.counters["late"] += 1
            out += self._publish("consensus" if phase == "reports" else "agreed", now)
        return out

    def _hold(self, now: float) -> None:
        """In lockstep let the phase, and its patience, begin anew while the router is away, because nothing can arrive then."""
        if self.roster.away and self.clock.pace is Pace.LOCKSTEP:
            self.rounds.enter(self.rounds.phase, now)

    def _holds(self, fact: str) -> bool:
        """Whether all "reports" of the tick, or all "consensuses" of the other boards, have arrived."""
        tick = self.clock.tick
        if fact == "reports":
            return all(self._reports.complete(robot, tick) for robot in self.participants.robots())
        boards = self.participants.boards()
        if boards is None or not all(self._consensuses.complete(board, tick) for board in boards):
            return False
        return self._joint is None or all(self._joint.has_heard(board, tick) for board in boards)

    # --- sending ----------------------------------------------------------------------------------------------------------

    def _publish(self, level: str, now: float) -> list[Envelope]:
        tick, time = self.clock.tick, self.clock.time(now)
        survive = self.intake.failures.survive
        found = list[Consensus]()
        with survive(f"the {level} of a tick"):
            found = self._consensuses_of(tick, time) if level == "consensus" else self._agreed(tick, time)
        topic = keys.CONSENSUS if level == "consensus" else keys.AGREED
        out = [Envelope(topic.key(team=self.team, sub_team=self.sub_team, subject=c.subject), encode(c)) for c in found]
        if level == "consensus" and self._joint is not None:
            with survive("what is forwarded"):
                out += self._forward(self._joint, tick, time)
        self.counters["settled"] += len(found)
        self._settled = self._plain_status(tick, time).model_copy(
            update={"phase": level, "subjects": [c.subject for c in found], "learned": self.board.learned()}
        )
        out.append(self._status(now))
        self._sent += out
        return out

    def _consensuses_of(self, tick: int, time: float) -> list[Consensus]:
        """What the sub-team believes, which this board also hears itself."""
        found = self.board.settle(tick, time)
        for consensus in found:
            with self.intake.failures.survive(consensus.subject):
                self.board.hear_consensus(consensus, time)
        self.board.withdraw_consensuses(self.sub_team, self.name, tick, [c.subject for c in found])
        return found

    def _forward(self, joint: JointDesk, tick: int, time: float) -> list[Envelope]:
        evidence = joint.forward()
        if not evidence and self.clock.pace is Pace.FREE:
            return []
        forward = Forward(board=self.name, sub_team=self.sub_team, tick=max(0, tick), time=time, evidence=evidence)
        return [Envelope(keys.FORWARD.key(team=self.team, sub_team=self.sub_team, board=self.name), encode(forward))]

    def _agreed(self, tick: int, time: float) -> list[Consensus]:
        """What the joint knows, and what the boards' opinions say about everything else, as much as a status can list."""
        pooled = {consensus.subject: consensus for consensus in self.board.exchange(tick, time)}
        first = {f"robot/{robot}" for robot in self.participants.robots()}
        if self._joint is not None:
            make = partial(
                Consensus, board=self.name, sub_team=self.sub_team, level="agreed", tick=max(0, tick), time=time
            )
            with self.intake.failures.survive("the joint"):
                known = {consensus.subject: consensus for consensus in self._joint.settle(time, make)}
                pooled |= known
                first |= known.keys()
        kept = sorted(pooled, key=lambda subject: (subject not in first, subject))[:MAX_OPINIONS]
        return [pooled[subject] for subject in sorted(kept)]

    def _plain_status(self, tick: int, time: float) -> Status:
        return Status(process=self.name, kind="board", tick=max(0, tick), time=time, settings=self._settings)

    def _status(self, now: float) -> Envelope:
        """What was settled last, at the time of that tick, with the counters as they stand; "idle" before the first tick."""
        status = self._settled or self._plain_status(self.clock.tick, self.clock.time(now))
        key = keys.STATUS.key(team=self.team, sub_team=self.sub_team, process=self.name)
        return Envelope(key, encode(self.intake.counted(status, now)))


def settings_in_force(settings: BoardSection) -> dict[str, str | float]:
    """What a status shows: the rule and its parameters, and those of each table of `subjects`, as `object/ball.rule`."""
    return {**settings.in_force(), "feedback": settings.feedback, "fusion": settings.fusion}
