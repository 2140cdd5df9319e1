"""A robot whose beliefs another program makes, as a service: what it reports when, what it hears of its team. Pure.

Where no world gives the clock, a report is sent at once, stamped with Unix time. Where a world does, what was reported is sent again
at each of its ticks with the stamp that it had, until it is `STANDS` seconds old, because a world that waits for everybody waits for
this robot, too.

Long, because it is the whole protocol of such a robot: what it checks, when it speaks, what it hears.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

from blackboard.board.board import Board
from blackboard.config import BoardSection
from blackboard.errors import OpinionError, Refused
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake, TooEarly
from blackboard.process.membership import Membership
from blackboard.process.offsets import Echoes
from blackboard.process.refusals import told
from blackboard.process.roster import Roster
from blackboard.process.team_clock import News, Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Informed, PackedBelief, Refusal, Report, Solo, Status
from blackboard.wire.types import Message

log = logging.getLogger(__name__)

STANDS = 5.0  # seconds of team time that a report is sent again for, at each tick of a world
#: Seconds without a newer agreed belief after which an older one is taken, because the stamp of the last one must have been wrong.
FORGOTTEN = 10.0
MAX_SUBJECTS = 1024  # of which it is remembered what was agreed on last
SUM = 1e-6  # by which the mass of a belief may miss 1
MAX_LOGGED = 256  # boards and reasons of refusals that are remembered as logged


@dataclass(frozen=True)
class Agreed:
    """What the team agreed on about a subject. `time` is team time in seconds, `story` the message: who was used, who was not."""

    subject: str
    belief: Belief
    tick: int
    time: float
    story: Consensus


class Member:
    """The process of one robot (`blackboard.process.service.Service`), whose owner calls `report`."""

    def __init__(
        self,
        *,
        team: str,
        sub_teams: tuple[str, ...],
        robot: str,
        grid: Grid,
        settings: BoardSection,
        on_agreed: Callable[[Agreed], None] = lambda agreed: None,
        on_refused: Callable[[Refusal], None] = lambda refusal: None,
    ) -> None:
        self.team, self.sub_teams, self.robot, self.grid = team, sub_teams, robot, grid
        self._membership = Membership(team, sub_teams, robot)
        self.intake = Intake()
        self.roster = Roster(self.tokens[0])
        self.clock = TeamClock(self.roster)
        self._judge = Board("judge", robot, grid, settings)  # refuses what the team's boards would refuse
        self._on_agreed, self._on_refused = on_agreed, on_refused
        self._echoes = Echoes()  # of the boards' stamps, where each process goes by its own clock
        self._reports: dict[str, Report] = {}  # subject -> the newest
        self._tick = -1  # of the newest report
        #: subject -> time and tick of what was agreed on last, and Unix time when it came; the oldest arrival first
        self._heard: dict[str, tuple[tuple[float, int], float]] = {}
        self._logged: set[tuple[str, str]] = set()

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return self._membership.tokens

    @property
    def listens(self) -> tuple[str, ...]:
        return self._membership.listens

    @property
    def watches(self) -> tuple[str, ...]:
        return self._membership.watches

    @property
    def done(self) -> bool:
        return False

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.intake.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self.roster.hear(envelope, now)
            early = self.intake.retry(lambda _, it: self._hear(it, now)) if envelope.kind is Kind.ALIVE else []
            return early + self._look(now)
        return self.intake.take(envelope, lambda _, it: self._hear(it, now)) + self._look(now)

    def wake(self, now: float) -> list[Envelope]:
        out = self._look(now)
        return out + (self._statuses(now) if now >= self.intake.status_due else [])

    def wake_at(self, now: float) -> float | None:
        return min(self.intake.status_due, self.clock.changes_at(), self.roster.changes_at())

    # --- the robot's own beliefs --------------------------------------------------------------------------------------

    def report(
        self,
        subject: str,
        belief: Belief,
        now: float,
        *,
        time: float | None = None,
        informed: tuple[Belief, dict[str, float]] | None = None,
    ) -> list[Envelope]:
        """Report a first-hand belief; return what is to be sent. `time`: team time of the belief [default: now].

        `informed` is what the robot believes with its team's beliefs folded in, and whose information that is. Refused: what a
        board would refuse, with the reason that it would give.
        """
        stamp = self.clock.time(now) if time is None else time
        tick = self._next_tick(now)
        report = self.checked(subject, belief, tick, stamp, self.clock.time(now), informed)
        self._reports[subject] = report
        self._tick = report.tick
        if self.clock.pace is Pace.WAITING:
            return []
        return [*self._sent([report]), *self._statuses(now)]

    def withdraw(self, subject: str, now: float) -> list[Envelope]:
        """Believe nothing any more about a subject; what a board had of it is left out at once."""
        if self._reports.pop(subject, None) is None:
            return []
        self._tick = self._next_tick(now)  # boards drop what is from before the tick of a status
        return self._statuses(now)

    def _next_tick(self, now: float) -> int:
        """The world's tick; where no world gives one, milliseconds of Unix time, which also grow when the program starts again."""
        return self.clock.tick if self.clock.followed is not None else max(self._tick + 1, int(1000 * now))

    def checked(
        self,
        subject: str,
        belief: Belief,
        tick: int,
        stamp: float,
        time: float,
        informed: tuple[Belief, dict[str, float]] | None = None,
    ) -> Report:
        """A report, opened and judged as a board does at team time `time`. Refused: as there."""
        message = Report.model_construct(
            source=self.robot,
            subject=subject,
            tick=max(0, tick),
            time=stamp,
            belief=_packed(belief),
            informed=None
            if informed is None
            else Informed.model_construct(belief=_packed(informed[0]), ancestors=informed[1]),
        )
        key = keys.REPORT.key(team=self.team, sub_team=self.sub_teams[0], source=self.robot, subject=subject)
        _, _, opened = open_envelope(Envelope(key, encode(message)))
        assert isinstance(opened, Report)
        self._judge.hear(opened, time)
        return opened

    # --- receiving ----------------------------------------------------------------------------------------------------

    def _hear(self, message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            news = self.clock.hear(message, now)
            return [] if message.end else self._follow(news, now, message)  # the last Clock of a run begins no tick
        if isinstance(message, Consensus | Refusal):
            if message.board not in self.roster.boards.get(message.sub_team, []):
                who = f"board {message.board} holds no liveliness token in sub-team {message.sub_team}"
                raise TooEarly(Refused("unregistered", who))  # the token may be on its way
            self._hear_agreed(message, now) if isinstance(message, Consensus) else self._hear_refusal(message)
        return []

    def _hear_agreed(self, consensus: Consensus, now: float) -> None:
        if self.clock.pace is Pace.FREE:
            self._echoes.hear(f"{consensus.sub_team}/{consensus.board}", consensus.time, now)
        at = consensus.time, consensus.tick
        last, since = self._heard.get(consensus.subject, ((-math.inf, -1), now))
        if at > last or now - since > FORGOTTEN:
            belief = unpack(consensus.belief, self.grid)
            self._heard.pop(consensus.subject, None)
            self._heard[consensus.subject] = at, now
            if len(self._heard) > MAX_SUBJECTS:
                del self._heard[next(iter(self._heard))]
            self._on_agreed(Agreed(consensus.subject, belief, consensus.tick, consensus.time, consensus))

    def _hear_refusal(self, refusal: Refusal) -> None:
        self.intake.counters["told_refused"] += 1
        seen = refusal.board, refusal.reason
        if seen not in self._logged and len(self._logged) < MAX_LOGGED:
            self._logged.add(seen)
            log.warning("%s; not logged again for this board and reason", told(refusal))
        self._on_refused(refusal)

    # --- the team's clock ---------------------------------------------------------------------------------------------

    def _look(self, now: float) -> list[Envelope]:
        self.roster.forget(now)
        out: list[Envelope] = []
        while (news := self.clock.look(now)) is not News.NOTHING:
            out += self._follow(news, now)
        return out

    def _follow(self, news: News, now: float, heard: Clock | None = None) -> list[Envelope]:
        """At each tick of a world say what still stands; stamps of another run, or of Unix time, are forgotten."""
        if news is News.NOTHING:
            return []
        if news in (News.RUN, News.FREE):
            self._reports, self._heard, self._tick = {}, {}, -1
            self._judge = Board("judge", self.robot, self.grid, self._judge.settings)
        if self.clock.followed is None:
            return []
        if news is News.REPEATED and heard is not None:
            wanted = heard.wants(f"robot/{self.robot}")
            if wanted != "answers":
                return self._statuses(now) if wanted == "status" else []
        else:
            oldest = self.clock.time(now) - STANDS
            self._tick = self.clock.tick
            standing = {s: r for s, r in self._reports.items() if r.time >= oldest}
            self._reports = {s: r.model_copy(update={"tick": self._tick}) for s, r in standing.items()}
        return [*self._sent(list(self._reports.values())), *self._solo(now), *self._statuses(now)]

    # --- sending ------------------------------------------------------------------------------------------------------

    def _sent(self, reports: list[Report]) -> list[Envelope]:
        encoded = [(report.subject, encode(report)) for report in reports]
        parts = {"team": self.team, "source": self.robot}
        return [
            Envelope(keys.REPORT.key(**parts, sub_team=sub_team, subject=subject), payload)
            for sub_team in self.sub_teams
            for subject, payload in encoded
        ]

    def _solo(self, now: float) -> list[Envelope]:
        """What the world's referee waits for."""
        beliefs = {report.subject: report.belief for report in self._reports.values()}
        solo = Solo(robot=self.robot, tick=max(0, self._tick), time=self.clock.time(now), beliefs=beliefs)
        return [Envelope(keys.SOLO.key(team=self.team, robot=self.robot), encode(solo))]

    def _statuses(self, now: float) -> list[Envelope]:
        reported = self._tick >= 0 and self.clock.pace is not Pace.WAITING
        status = Status(
            process=self.robot,
            kind="robot",
            tick=max(0, self._tick),
            time=self.clock.time(now),
            phase="reported" if reported else "idle",
            subjects=sorted(self._reports),
            settings={"client": "python", "pace": self.clock.pace.value},
        )
        if self.clock.pace is Pace.FREE:
            status = status.model_copy(update={"sent": now, "echo": self._echoes.held(now)})
        payload = encode(self.intake.counted(status, now))
        parts = {"team": self.team, "process": self.robot}
        return [Envelope(keys.STATUS.key(**parts, sub_team=s), payload) for s in self.sub_teams]


def _packed(belief: Belief) -> PackedBelief:
    """Refused "mass": no probability grid."""
    try:
        packed = pack(belief)
    except OpinionError as error:
        raise Refused("mass", str(error)) from None
    total = float(belief.p.sum())
    if abs(total - 1.0) > SUM:
        raise Refused("mass", f"the cells sum to {total:g}, not to 1")
    return packed
