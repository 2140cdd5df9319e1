"""A board as a process sees it: envelopes to messages around a Board, and when to settle.

In lockstep a tick is settled once everybody whom the world names has spoken; in real time also at a deadline; where no
world gives a clock, every `period` seconds of Unix time (docs/design.md, "A tick in lockstep").
"""

from __future__ import annotations

import logging
from collections import Counter, deque

from blackboard.board import Board
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.fusion import in_force
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Message, Report, Status

log = logging.getLogger(__name__)

EARLY = 1024  # envelopes that are kept until the clock is known
STATUS_PERIOD = 1.0  # seconds between statuses while nothing else is said


class BoardService:
    """The board process of one sub-team (`blackboard.wire.envelope.Service`)."""

    def __init__(self, *, team: str, sub_team: str, board: str, grid: Grid, settings: BoardSection) -> None:
        self.team, self.sub_team, self.name = team, sub_team, board
        self.grid, self.settings = grid, settings
        self.counters: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self._warned: set[tuple[str, str]] = set()
        self._members: set[str] = set()
        self._boards: dict[str, set[str]] = {}  # sub-team -> its boards that are alive
        self._gone: set[str] = set()  # robots whose token vanished
        self._world = False  # whether a world is alive, which gives the clock
        self._early: deque[Envelope] = deque(maxlen=EARLY)  # what came before its first clock
        self._heard_at: dict[str, float] = {}  # source -> when, for the ages
        self._settings = settings_in_force(settings)
        self._status_due = 0.0
        self._begin(None)

    def _begin(self, clock: Clock | None) -> None:
        """Forget everything: a new run of the world, or the very first."""
        self.board = Board(self.sub_team, self.name, self.grid, self.settings)
        self.clock = clock
        self.phase = "idle"  # idle -> reports -> exchange -> idle
        self.tick = -1
        self._clock_at = self._deadline = 0.0  # Unix seconds
        self._said: dict[str, Status] = {}  # robot -> its newest status
        self._other: dict[str, Status] = {}  # sub-team -> what its board settled last
        self._sent: list[Envelope] = []  # what was said in this tick, to be said again when the world asks
        self._last_said: tuple[str, list[str]] = ("idle", [])

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
            keys.STATUS.key(team=team, sub_team="*", process="*"),
        )

    @property
    def watches(self) -> tuple[str, ...]:
        return (
            keys.MEMBER.key(team=self.team, sub_team=self.sub_team, robot="*"),
            keys.BOARD.key(team=self.team, sub_team="*", board="*"),
            keys.WORLD.key(team=self.team),
        )

    @property
    def done(self) -> bool:
        return False

    def note(self, counters: dict[str, int]) -> None:
        """Take the link's counters into the status."""
        self.counters.update({name: n - self.counters[name] for name, n in counters.items()})

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self._liveliness(envelope)
            return self._advance(now)
        if envelope.kind is not Kind.PUT:
            return []
        try:
            _, parts, message = open_envelope(envelope)
            if self.clock is None and self._world and not isinstance(message, Clock):
                self._early.append(envelope)  # its stamp means nothing before the world's clock is known
                return []
            return self._hear(parts, message, now) + self._advance(now)
        except Refused as refusal:
            self._refuse(envelope.key, refusal)
            return []

    def wake(self, now: float) -> list[Envelope]:
        if self.clock is None and not self._world and self.tick != (tick := int(now / self.settings.period)):
            self._start(tick, now)
        return self._advance(now) + self._idle_status(now)

    def wake_at(self, now: float) -> float | None:
        if self.clock is None:
            return self._status_due if self._world else (self.tick + 1) * self.settings.period
        return self._status_due if self.phase == "idle" else min(self._deadline, self._status_due)

    # --- what is heard ----------------------------------------------------------------------------------------------------

    def _liveliness(self, envelope: Envelope) -> None:
        found = keys.parse(envelope.key)
        if found is None:
            return
        topic, parts = found
        alive = envelope.kind is Kind.ALIVE
        if topic is keys.MEMBER:
            robot = parts["robot"]
            (self._members.add if alive else self._members.discard)(robot)
            (self._gone.discard if alive else self._gone.add)(robot)
        elif topic is keys.WORLD:
            self._world = alive
        elif topic is keys.BOARD:
            boards = self._boards.setdefault(parts["sub_team"], set())
            (boards.add if alive else boards.discard)(parts["board"])

    def _hear(self, parts: dict[str, str], message: Message, now: float) -> list[Envelope]:
        self.counters["heard"] += 1
        if isinstance(message, Clock):
            return self._hear_clock(message, now)
        if isinstance(message, Report):
            if message.source not in self._members | self._named():
                raise Refused("unregistered", f"{message.source} holds no liveliness token in sub-team {self.sub_team}")
            self.board.hear(message, self._team_time(now))
            self._heard_at[message.source] = now
        elif isinstance(message, Consensus) and message.sub_team != self.sub_team:
            self.board.hear_consensus(message, self._team_time(now))
        elif isinstance(message, Status):
            self._hear_status(parts["sub_team"], message)
        return []

    def _hear_clock(self, clock: Clock, now: float) -> list[Envelope]:
        if self.clock is None or clock.run != self.clock.run:
            self._begin(clock)
        elif clock.tick < self.tick:
            return []
        elif clock.tick == self.tick:
            self.counters["repeated"] += 1
            return list(self._sent)
        self.clock = clock
        self._clock_at = now
        self._start(clock.tick, now)
        early, self._early = self._early, deque(maxlen=EARLY)
        return [answer for envelope in early for answer in self.receive(envelope, now)]

    def _hear_status(self, sub_team: str, status: Status) -> None:
        if status.kind == "robot" and sub_team == self.sub_team and status.phase == "reported":
            self._said[status.process] = status
            self.board.withdraw(status.process, status.tick, status.subjects)
        elif status.kind == "board" and sub_team != self.sub_team and status.phase == "consensus":
            self._other[sub_team] = status

    def _refuse(self, key: str, refusal: Refused) -> None:
        self.refused[refusal.reason] += 1
        source = key if len(key) < 200 else key[:200] + "..."
        if (source, refusal.reason) not in self._warned and len(self._warned) < 1000:
            self._warned.add((source, refusal.reason))
            log.warning("refused %s (%s); counted, and not logged again for this source", source, refusal)

    # --- when to settle ---------------------------------------------------------------------------------------------------

    def _team_time(self, now: float) -> float:
        """Team time: the world's clock (running on, in real time), or Unix time without a world."""
        if self.clock is None:
            return now
        return self.clock.time + (now - self._clock_at if self.clock.mode == "realtime" else 0.0)

    def _start(self, tick: int, now: float) -> None:
        self.tick, self.phase, self._sent = tick, "reports", []
        if self.clock is None:
            self._deadline = now  # nobody says when a tick ends: settle what there is
        else:
            lockstep = self.clock.mode == "lockstep"
            self._deadline = now + (self.settings.patience if lockstep else self.settings.period / 2)

    def _advance(self, now: float) -> list[Envelope]:
        """Do what can be done: settle once the reports are in, exchange once the other boards are."""
        out: list[Envelope] = []
        if self.phase == "reports" and self._due(now, self._reports_in()):
            out += self._publish("consensus", now)
            self.phase = "exchange"
            self._deadline = max(self._deadline, now) if self.clock is None else self._deadline_from(now)
        if self.phase == "exchange" and self._due(now, self._consensuses_in()):
            out += self._publish("agreed", now)
            self.phase = "idle"
        return out

    def _deadline_from(self, now: float) -> float:
        assert self.clock is not None
        return now + (self.settings.patience if self.clock.mode == "lockstep" else self.settings.period / 2)

    def _due(self, now: float, complete: bool) -> bool:
        if complete and self.clock is not None:
            return True
        if now < self._deadline:
            return False
        if self.clock is not None:
            self.counters["late"] += 1
        return True

    def _named(self) -> set[str]:
        """The robots that the world says take part in this sub-team; only in lockstep."""
        return set(self.clock.robots.get(self.sub_team, [])) if self.clock is not None else set()

    def _reports_in(self) -> bool:
        lockstep = self.clock is not None and self.clock.mode == "lockstep"
        return all(
            (said := self._said.get(robot)) is not None
            and said.tick == self.tick
            and self.board.heard(robot, self.tick, said.subjects)
            for robot in (self._named() - self._gone if lockstep else self._members)
        )

    def _consensuses_in(self) -> bool:
        if self.clock is not None and self.clock.mode == "lockstep":  # named, and not known to have died
            others = {s for s in self.clock.robots if self._boards.get(s) != set()}
        else:
            others = {s for s, boards in self._boards.items() if boards}
        return all(self._consensus_in(self._other.get(s), s) for s in others - {self.sub_team})

    def _consensus_in(self, status: Status | None, sub_team: str) -> bool:
        if status is None or status.tick != self.tick:
            return False
        return self.board.heard_consensus(sub_team, self.tick, status.subjects)

    # --- what is said -----------------------------------------------------------------------------------------------------

    def _publish(self, level: str, now: float) -> list[Envelope]:
        time = self._team_time(now)
        if level == "consensus":
            found = self.board.settle(self.tick, time)
            for consensus in found:
                self.board.hear_consensus(consensus, time)
        else:
            found = self.board.exchange(self.tick, time)
        topic = keys.CONSENSUS if level == "consensus" else keys.AGREED
        out = [Envelope(topic.key(team=self.team, sub_team=self.sub_team, subject=c.subject), encode(c)) for c in found]
        self.counters["settled"] += len(found)
        out.append(self._status(level, [c.subject for c in found], now))
        self._sent += out
        return out

    def _status(self, phase: str, subjects: list[str], now: float) -> Envelope:
        self._status_due = now + STATUS_PERIOD
        self._last_said = phase, subjects
        status = Status(
            process=self.name,
            kind="board",
            tick=max(0, self.tick),
            time=self._team_time(now),
            phase=phase,  # type: ignore[arg-type]
            subjects=subjects,
            counters=dict(self.counters),
            refused=dict(self.refused),
            ages={source: now - at for source, at in sorted(self._heard_at.items())},
            settings=self._settings,
        )
        return Envelope(keys.STATUS.key(team=self.team, sub_team=self.sub_team, process=self.name), encode(status))

    def _idle_status(self, now: float) -> list[Envelope]:
        """A sign of life once a second: the last status again, with fresh counters."""
        return [self._status(*self._last_said, now)] if now >= self._status_due else []


def settings_in_force(settings: BoardSection) -> dict[str, str | float]:
    """For people: the rule and its parameters, and the same for each table of `subjects`, as `object/ball.rule`."""
    found: dict[str, str | float] = {"rule": settings.rule, **in_force(settings), "feedback": settings.feedback}
    for pattern in sorted(settings.subjects):
        rule = settings.of(pattern)
        found |= {f"{pattern}.{name}": value for name, value in {"rule": rule.rule, **in_force(rule)}.items()}
    return found
