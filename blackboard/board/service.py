"""The board process: envelopes to messages around a Board, and what it sends at the end of each phase of a tick.

Long, because it is the whole protocol of a board's process: what it hears, when a tick is over, what it sends.

The table `blackboard.process.rounds.BOARD` says when a phase is over (docs/design.md, "A tick in lockstep").
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import TypeVar

from blackboard.board.board import Board
from blackboard.board.clocks import Clocks
from blackboard.board.joint.desk import JointDesk
from blackboard.board.lead import Lead, Part, Said
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
from blackboard.wire.arrays import packed_grid
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import Forward
from blackboard.wire.memory import Memory
from blackboard.wire.messages import Clock, Consensus, PackedAnchor, Refusal, Report, Status
from blackboard.wire.raw import MAX_BYTES
from blackboard.wire.types import MAX_OPINIONS, Message

log = logging.getLogger(__name__)

M = TypeVar("M", Report, Consensus, Forward)

SILENT = 1.0  # seconds beyond its patience with both phases of a tick after which a leader that publishes nothing is given up


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
        self.lead = Lead(self.roster, sub_team, board, silent=2 * settings.patience + SILENT)
        self.clocks = Clocks(f"{sub_team}/{board}", settings.skew)
        self._settings, self._learns = settings_in_force(settings), settings.learns
        self._packed_grid = packed_grid(grid)
        self._anchor = None if grid.anchor is None else PackedAnchor(**asdict(grid.anchor))
        self._led: int | None = None  # the term in which it was logged that this board leads
        self._pace = self.clock.pace  # the pace at which early messages were retried last
        self._is_wake_due = False  # in real time: whether a message came since the board was woken
        self._begin()

    def _begin(self) -> None:
        """Forget all messages: a new run begins, or stamps have another time base from now on."""
        self.board = Board(self.sub_team, self.name, self.grid, self.settings, self.intake.failures.survive)
        self.rounds.enter("settled", 0.0)
        self._reports: RollCall[str] = RollCall()  # of the sub-team's robots
        self._consensuses: RollCall[tuple[str, str]] = RollCall()  # of other sub-teams' boards: sub-team and board
        self._said: list[Said] = []  # in this tick, or kept, where another board leads
        self._sent: list[Envelope] = []  # in this tick; sent again when the world repeats its Clock
        self._agreed_at: tuple[int, float] | None = None  # tick and team time of the newest tick that is settled
        self._told_at: float | None = None  # team time in seconds of the newest Memory that this board sent
        self._taken_over = (
            "",
            -math.inf,
        )  # of the newest Memory that was taken over: the board, and its whole second of team time
        self._joint = (
            None
            if self.settings.fusion == "opinions"
            else JointDesk(self.grid, self.settings, self.counters, self.board.ageing)
        )
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
            *([keys.MEMORY.key(team=team, sub_team=mine, board="*")] if self._learns else []),
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
        out = self._look(now)
        if self.clock.pace is Pace.REALTIME and self.rounds.phase == "exchange":
            out += self._turn(now)  # first, because a new Clock ends the exchange without publishing what is agreed
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self._hold(now)
            self.roster.hear(envelope, now)
            out += self._retry(now) if envelope.kind is Kind.ALIVE else []
            out += [self._status(now)] if _is_world(envelope) else []
        else:
            out += self.intake.take(envelope, lambda parts, message: self._hear(parts, message, now))
        out += self._advance(now, woken=False) + self._refusals(now)
        self._is_wake_due = self.clock.pace is Pace.REALTIME
        return out + self._memory()

    def wake(self, now: float) -> list[Envelope]:
        self._is_wake_due = False
        out = self._advance(now) + self._refusals(now) + self._memory()
        return [*out, self._status(now)] if now >= self.intake.status_due else out

    def wake_at(self, now: float) -> float | None:
        if self._is_wake_due:
            return now
        rounds_end = self.rounds.ends_at(self.clock.pace)
        changes_at = min(self.clock.changes_at(), self.roster.changes_at(), self.lead.changes_at())
        return min(self.intake.status_due, rounds_end, changes_at)

    # --- receiving --------------------------------------------------------------------------------------------------------

    def _hear(self, parts: dict[str, str], message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            return self._follow(self._hear_clock(message, now), now, message)
        if self.clock.pace is Pace.WAITING:
            raise TooEarly  # its stamp cannot be judged before the world's clock is known
        time = self.clock.time(now)
        if isinstance(message, Report):
            self.participants.check_robot(message.source)
            self.participants.hear_robot(message.source)
            message = self._hear_report(message, now, time)
            self._reports.record(message.source, message.subject, message.tick)
            self.intake.record_age(message.source, now)
            about_itself = message.subject == f"robot/{message.source}"
            if self._joint is not None and message.evidence is not None and about_itself:
                skew = self._skew
                self._joint.take(message.source, message.tick, message.time, message.evidence, own=True, skew=skew)
        elif isinstance(message, Consensus) and message.sub_team != self.sub_team:
            self.participants.check_board(message.sub_team, message.board)
            self.clocks.echoes.hear(f"{message.sub_team}/{message.board}", message.time, now)
            self.board.hear_consensus(self._on_time(message, now), time)
            self._consensuses.record((message.sub_team, message.board), message.subject, message.tick)
        elif isinstance(message, Forward) and message.sub_team != self.sub_team and self._joint is not None:
            self.participants.check_board(message.sub_team, message.board)
            message = self._on_time(message, now)
            self.board.check_time(message.time, time)
            sub_team = message.sub_team
            self._joint.hear(message, lambda robot: self.participants.has_robot(robot, sub_team), self._skew)
        elif isinstance(message, Memory):
            self._hear_memory(message, time)
        elif isinstance(message, Status):
            return self._hear_status(parts["sub_team"], message, now)
        return []

    def _hear_clock(self, clock: Clock, now: float) -> News:
        if not self.roster.world:
            self.counters["unannounced"] += 1
            if self.counters["unannounced"] == 1:
                log.warning(
                    "a Clock without %s is not followed before that token is there", keys.WORLD.key(team=self.team)
                )
        return self.clock.hear(clock, now)

    @property
    def _skew(self) -> float:
        """Seconds that a robot's clock may be off: none where all go by a world's."""
        return self.settings.skew if self.clock.pace is Pace.FREE else 0.0

    def _on_time(self, message: M, now: float) -> M:
        """A message with its stamp by this board's clock, where each process goes by its own."""
        if self.clock.pace is not Pace.FREE:
            return message
        source = message.source if isinstance(message, Report) else f"{message.sub_team}/{message.board}"
        time = self.clocks.corrected(source, message.time, now)
        return message if time == message.time else message.model_copy(update={"time": time})

    def _hear_report(self, report: Report, now: float, time: float) -> Report:
        try:
            report = self._on_time(report, now)
            self.board.hear(report, time)
            return report
        except Refused as refusal:
            if self.clock.pace is Pace.FREE and refusal.reason in ("past", "future"):
                raise TooEarly(refusal) from None  # it may be stamped by a world whose Clock has not come yet
            raise

    def _hear_status(self, sub_team: str, status: Status, now: float) -> list[Envelope]:
        if status.kind == "robot" and sub_team == self.sub_team:
            self.participants.hear_robot(status.process)
        if status.kind == "robot" and sub_team == self.sub_team and status.phase == "reported":
            self.participants.check_robot(status.process)
            self._learn_of(status.process, status, now)
            self._reports.record_list(status.process, status.tick, status.subjects)
            self.board.withdraw(status.process, status.tick, {*status.subjects, *status.kept})
        elif status.kind == "board" and sub_team == self.sub_team:
            return self._hear_twin(status, now)
        elif status.kind == "board":
            self._hear_board(sub_team, status, now)
        elif status.kind == "robot" and self.participants.has_robot(status.process, sub_team):
            self._learn_of(status.process, status, now)
        return []

    def _learn_of(self, source: str, status: Status, now: float) -> None:
        """How fast a robot is, and where each process goes by its own clock, how far that is off."""
        if status.speed is not None and status.kind == "robot":
            self.board.ageing.learn_speed(source, status.speed)
        if self.clock.pace is Pace.FREE:
            self.clocks.hear(source, status, now)

    def _hear_twin(self, status: Status, now: float) -> list[Envelope]:
        """Another board of this sub-team says whether it leads, and what it has published."""
        if status.process == self.name:
            return []
        if status.process not in self.roster.boards.get(self.sub_team, []):
            raise TooEarly  # its token may be on its way
        newest = self.clock.time(now) + self.settings.future
        if self.clock.pace is Pace.FREE and not status.follows:
            self.clocks.offsets.told(status.clocks)
        answers = self.lead.hear(status, now, newest, any_tick=self.clock.pace is Pace.FREE)
        return [self._status(now)] if answers else []

    def _hear_memory(self, memory: Memory, time: float) -> None:
        """Where this board follows, replace what it has learned by what its leader has: one Memory for each second of team time.

        So both go on alike, whichever of them was restarted; and a leader that repeats itself costs little.
        """
        if memory.board not in self.roster.boards.get(self.sub_team, []):
            raise TooEarly  # its token may be on its way
        if self.lead.part is not Part.FOLLOWS or memory.board != self.lead.leader or memory.run != self._run:
            return
        self.board.check_time(memory.time, time)
        older = self._agreed_at is not None and memory.tick < self._agreed_at[0]
        # In lockstep one of an older tick would undo what was learned since; elsewhere it costs a sample of each pair at most.
        board, second = self._taken_over
        repeated = memory.board == board and math.floor(memory.time) <= second
        if not repeated and not (older and self.clock.pace is Pace.LOCKSTEP):
            self.board.remember(memory)
            self._taken_over = memory.board, math.floor(memory.time)

    def _hear_board(self, sub_team: str, status: Status, now: float) -> None:
        """A board of another sub-team lists what it settled."""
        if status.process in self.roster.boards.get(sub_team, []):
            self._learn_of(f"{sub_team}/{status.process}", status, now)
            self.participants.hear_role(sub_team, status.process, follows=status.follows)
        if status.phase == "consensus" and not status.follows:
            # Outside lockstep an empty list changes nothing, and a board that has just started may send it before its token arrives.
            if status.subjects or self.clock.pace is Pace.LOCKSTEP:
                self.participants.check_board(sub_team, status.process)
            elif status.process not in self.roster.boards.get(sub_team, []):
                return
            self._consensuses.record_list((sub_team, status.process), status.tick, status.subjects)
            self.board.withdraw_consensuses(sub_team, status.tick, status.subjects)
            if self._joint is not None and status.process in self.roster.boards.get(sub_team, []):
                self._joint.expect((sub_team, status.process), status.settings.get("fusion") == "joint")

    def _retry(self, now: float) -> list[Envelope]:
        return self.intake.retry(lambda parts, message: self._hear(parts, message, now))

    # --- when to settle ---------------------------------------------------------------------------------------------------

    def _follow(self, news: News, now: float, heard: Clock | None = None) -> list[Envelope]:
        """React to what is new about the team clock, by the Clock that was heard, and return what is to be sent."""
        if news is News.NOTHING:
            return []
        if news is News.REPEATED:
            self.counters["repeated"] += 1
            wanted = "answers" if heard is None else heard.wants(f"board/{self.sub_team}/{self.name}")
            if wanted != "answers":
                return [self._status(now, self._lacks())] if wanted == "status" else []
            return list(self._sent) if self.lead.leads else [self._followed(said, now) for said in self._said]
        if news is not News.TICK:
            self._begin()
            self.lead.begin(None if news is News.FREE else self.clock.time(now))
        if news is News.FREE:
            log.warning(
                "the world is gone, its last Clock is %g s old: going by Unix time, starting afresh", WORLD_SILENT
            )
            return []
        if self.lead.since is None:
            self.lead.since = self.clock.time(now)
        self.counters["skipped"] += self.rounds.phase != "settled"
        self.rounds.enter("reports", now)
        self._said, self._sent = [], []
        return []

    def _advance(self, now: float, *, woken: bool = True) -> list[Envelope]:
        """Do what can be done: settle once the reports are in, exchange once the other boards' consensuses are.

        A board is woken after each batch of messages. Only then does a tick begin without a world, and only then are the reports of
        a tick settled in real time. Otherwise a board that needs longer than a tick to settle would settle every tick that it reads
        of, later each time; so it goes on with the newest tick of the batch, and counts the others as skipped.
        """
        self._hold(now)
        self.roster.forget(now)
        out: list[Envelope] = []
        while (news := self.clock.look(now, ticks=woken)) is not News.NOTHING:
            out += self._follow(news, now)
        if self.clock.pace is not self._pace:
            self._pace = self.clock.pace
            out += self._retry(now)
        out += self._look(now)
        return out + (self._turn(now) if woken or self.clock.pace is not Pace.REALTIME else [])

    def _turn(self, now: float) -> list[Envelope]:
        """End each phase of the tick that is over, and return what is published at its end."""
        out: list[Envelope] = []
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

    def _lacks(self) -> list[str]:
        """Whose messages of this tick are waited for, as a Clock names them."""
        tick, phase = self.clock.tick, self.rounds.phase
        if phase == "reports":
            return [f"robot/{name}" for name in self.participants.robots() if not self._reports.complete(name, tick)]
        if phase != "exchange":
            return []
        return [
            f"board/{sub_team}/{name}"
            for sub_team, name in self.participants.boards() or ()
            if not self._consensuses.complete((sub_team, name), tick)
            or (self._joint is not None and not self._joint.has_heard((sub_team, name), tick))
        ]

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
        if level == "agreed":
            self._agreed_at = tick, time
        status = self._plain_status(tick, time).model_copy(
            update={
                "phase": level,
                "subjects": [c.subject for c in found],
                "learned": self.board.learned(),
                "dissent": self.board.dissent() + (self._joint.dissent.told() if self._joint is not None else []),
            }
        )
        if not out and self.clock.pace is Pace.FREE:
            # Without a world no process waits for the status of a phase, so an empty one is left to the status of each second.
            self._settled = status
            return []
        said = Said(tick, level, time, tuple(out), status)
        self._said.append(said)
        if self.lead.may_say(time):
            sent = self._say(said, now)
            self._sent += sent
            return sent
        self.lead.keep(said, now)
        return [self._followed(said, now)]

    def _say(self, said: Said, now: float) -> list[Envelope]:
        self._settled = said.status
        if said.envelopes and self._led != (term := self.lead.term):
            self._led = term
            log.info("%s speaks for sub-team %s from tick %d on (term %d)", self.name, self.sub_team, said.tick, term)
        return [*said.envelopes, self._status(now)]

    def _followed(self, said: Said, now: float) -> Envelope:
        """The status of a board that follows: the phase is over here, too."""
        self._settled = said.status.model_copy(update={"subjects": []})
        return self._status(now)

    def _look(self, now: float) -> list[Envelope]:
        """Where this board's part changes, tell the others; where it leads now, say all that the one before did not."""
        if not self.lead.look(now):
            return []
        if not self.lead.leads:
            return [self._status(now)]
        settled = self._settled
        self._sent = [
            envelope for said in self._said for envelope in self._say(said, now)
        ]  # what is sent again where the world repeats its Clock
        self._settled = settled
        return [envelope for said in self.lead.release() for envelope in self._say(said, now)] or [self._status(now)]

    def _consensuses_of(self, tick: int, time: float) -> list[Consensus]:
        """What the sub-team believes, which this board also hears itself."""
        found = self.board.settle(tick, time, self.participants.counts)
        for consensus in found:
            with self.intake.failures.survive(consensus.subject):
                self.board.hear_consensus(consensus, time)
        self.board.withdraw_consensuses(self.sub_team, tick, [c.subject for c in found])
        return found

    def _forward(self, joint: JointDesk, tick: int, time: float) -> list[Envelope]:
        evidence = joint.forward()
        if not evidence and self.clock.pace is Pace.FREE:
            return []
        forward = Forward(board=self.name, sub_team=self.sub_team, tick=max(0, tick), time=time, evidence=evidence)
        return [Envelope(keys.FORWARD.key(team=self.team, sub_team=self.sub_team, board=self.name), encode(forward))]

    def _agreed(self, tick: int, time: float) -> list[Consensus]:
        """What the joint knows, and what the boards' opinions say about everything else, as much as a status can list."""
        found = dict[str, Consensus]()
        if self._joint is not None:
            make = partial(
                Consensus, board=self.name, sub_team=self.sub_team, level="agreed", tick=max(0, tick), time=time
            )
            with self.intake.failures.survive("the joint"):
                found = {consensus.subject: consensus for consensus in self._joint.settle(time, make)}
        first = found.keys() | {f"robot/{robot}" for robot in self.participants.robots()}
        found |= {consensus.subject: consensus for consensus in self.board.exchange(tick, time, found.keys())}
        kept = sorted(found, key=lambda subject: (subject not in first, subject))[:MAX_OPINIONS]
        return [self._told_to(found[subject]) for subject in sorted(kept)]

    def _told_to(self, agreed: Consensus) -> Consensus:
        """What is agreed about a robot tells it how far its clock is ahead, where each goes by its own."""
        ahead = self.clocks.offsets.ahead(agreed.subject.removeprefix("robot/"))
        off = self.clock.pace is Pace.FREE and agreed.subject.startswith("robot/") and ahead
        return agreed.model_copy(update={"ahead": ahead}) if off else agreed

    def _plain_status(self, tick: int, time: float) -> Status:
        return Status(
            process=self.name,
            kind="board",
            tick=max(0, tick),
            time=time,
            settings=self._settings,
            grid=self._packed_grid,
            anchor=self._anchor,
        )

    @property
    def _run(self) -> str:
        return "" if self.clock.followed is None else self.clock.followed.run

    def _memory(self) -> list[Envelope]:
        """What a board that leads remembers, after the first tick of each second of team time."""
        if not (self._learns and self.lead.leads) or self._agreed_at is None:
            return []
        tick, time = self._agreed_at
        if self._told_at is not None and math.floor(time) == math.floor(self._told_at):
            return []
        self._told_at = time
        memory = Memory(
            board=self.name,
            sub_team=self.sub_team,
            run=self._run,
            tick=max(0, tick),
            time=time,
            consensus=self.board.memory("consensus"),
            agreed=self.board.memory("agreed"),
        )
        payload = encode(memory)
        if len(payload) > MAX_BYTES:  # no message may be larger; who follows learns by itself then
            self.counters["memory_too_large"] += 1
            return []
        return [Envelope(keys.MEMORY.key(team=self.team, sub_team=self.sub_team, board=self.name), payload)]

    def _refusals(self, now: float) -> list[Envelope]:
        """Tell robots of the sub-team what was refused under their names, unless this board follows one that does."""
        told = self.intake.refusals.due(now)
        if not told or self.lead.part is Part.FOLLOWS:
            return []
        parts, time = {"team": self.team, "sub_team": self.sub_team}, self.clock.time(now)
        return [
            Envelope(
                keys.REFUSED.key(**parts, robot=it.robot),
                encode(Refusal(board=self.name, sub_team=self.sub_team, time=time, **asdict(it))),
            )
            for sub_team, it in told
            if sub_team == self.sub_team
        ]

    def _status(self, now: float, lacks: Sequence[str] = ()) -> Envelope:
        """What was settled last, at the time of that tick, with the counters as they stand; "idle" before the first tick."""
        status = self._settled or self._plain_status(self.clock.tick, self.clock.time(now))
        part = {"follows": not self.lead.leads, "term": self.lead.term, "since": self.lead.since, "lacks": list(lacks)}
        status = status.model_copy(update=part)
        if self.clock.pace is Pace.FREE:
            status = self.clocks.shown(status, now)
        key = keys.STATUS.key(team=self.team, sub_team=self.sub_team, process=self.name)
        return Envelope(key, encode(self.intake.counted(status, now)))


def _is_world(envelope: Envelope) -> bool:
    """Whether a world has come: it asks who is there, and a token alone is nobody."""
    return envelope.kind is Kind.ALIVE and keys.WORLD.match(envelope.key) is not None


def settings_in_force(settings: BoardSection) -> dict[str, str | float]:
    """What a status shows: the rule and its parameters, and those of each table of `subjects`, as `object/ball.rule`."""
    return {**settings.in_force(), "feedback": settings.feedback, "fusion": settings.fusion}
