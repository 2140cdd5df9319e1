"""The robot process: envelopes to messages around an Agent, and when it acts on its readings.

The table `blackboard.process.rounds.ROBOT` says when a phase of a tick is over (docs/design.md, "A tick in lockstep").

Long, because it is the whole protocol of a robot's process: whom it believes, when it acts, what it sends.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.grid import Grid
from blackboard.process.intake import Intake, TooEarly
from blackboard.process.membership import Membership
from blackboard.process.offsets import Echoes
from blackboard.process.refusals import told
from blackboard.process.roll_call import RollCall
from blackboard.process.roster import Roster
from blackboard.process.rounds import ROBOT, Rounds
from blackboard.process.team_clock import News, Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.evidence import unpack_state
from blackboard.wire.messages import Clock, Consensus, Readings, Refusal, Report, Solo, Status
from blackboard.wire.types import Message
from robot_agent.agent import Agent, Agreed, Feedback, Unpacked
from robot_agent.budget import Budget, Known
from robot_agent.config import RobotSection
from robot_agent.gaussian.agent import JointAgent

log = logging.getLogger(__name__)

MAX_AGREED = 512  # agreed beliefs that are kept between two ticks, over all boards
JUMP = 100  # ticks: readings that are further ahead, or behind, are believed with the second ones in succession
FASTEST = 1e6  # unit per second that is told at most
LATELY = 50  # ticks of which the speed is told
SPAN = 5  # ticks over which the speed is averaged where a robot is often silent
TELLING = 10.0  # seconds of team time between two statuses with counters and settings on a poor link
FAILURES = 3  # ticks in a row that the agent could not do until it begins anew


class AgentService:
    """The process of one robot (`blackboard.process.service.Service`); it may be in several sub-teams."""

    def __init__(
        self,
        *,
        team: str,
        sub_teams: Sequence[str],
        robot: str,
        grid: Grid,
        settings: RobotSection,
        feedback: Feedback = "guarded",
        joint: bool = False,
        drift: float = 1.0,
    ) -> None:
        """`joint`: the boards keep a joint belief ([board] fusion); `drift`: how they let reports spread ([board] drift)."""
        self.drift = drift
        self.team, self.sub_teams, self.robot = team, tuple(sub_teams), robot
        self.grid, self.settings, self.feedback, self.joint = grid, settings, feedback, joint
        self._membership = Membership(self.team, self.sub_teams, robot)
        self.intake = Intake()
        self.counters, self.refused = self.intake.counters, self.intake.refused
        self.roster = Roster(self.tokens[0])
        self.clock = TeamClock(self.roster)
        self._echoes = Echoes()  # of the boards' stamps, where each process goes by its own clock
        self._ahead: dict[str, float] = {}  # sub-team -> seconds that this robot's clock is ahead of its board's
        self._told_refused: set[tuple[str, str]] = set()  # boards and reasons that are remembered as logged
        self.rounds = Rounds(ROBOT, {"patience": settings.patience}, "readings")
        self._begin("")

    def _begin(self, run: str) -> None:
        """Forget everything: another run than before, or the very first."""
        self.run = run
        self.agent = self._new_agent()
        self.tick, self.time = -1, 0.0  # of the newest tick that was done
        self.rounds.enter("readings", 0.0)
        self._readings: Readings | None = None  # of the tick that is to be done next
        self._speeds: deque[float] = deque(maxlen=LATELY)  # unit per second, by the odometry
        self._doubted: Readings | None = None  # the newest that did not go on with those before
        self._failed = 0  # ticks in a row that the agent could not do
        self._agreed: dict[tuple[str, str, str], Consensus] = {}  # by sub-team, board and subject, since the last tick
        self._arrived: RollCall[str] = RollCall()  # agreed beliefs by sub-team
        self.budget = self._new_budget()
        self._team: dict[str, Known] = {}  # what was agreed last, by subject
        self._boards = set[str]()  # that were there in the newest tick
        self._kept: list[str] = []  # subjects of which the boards keep what was reported before
        self._reports: list[Report] = []  # of the newest tick; sent again when the world repeats its Clock
        self._solo: Solo | None = None
        #: team time of the newest status that had everything, and what had been refused then
        self._told_all: tuple[float, dict[str, int]] | None = None

    def _new_agent(self) -> JointAgent | Agent:
        kind = JointAgent if self.joint else Agent
        return kind(self.robot, self.settings, self.grid, self.feedback)

    def _new_budget(self) -> Budget | None:
        if self.settings.send.budget is None:
            return None
        return Budget(self.settings.send, self.grid, self.robot, self.drift, self._size)

    def _size(self, report: Report) -> int:
        """Bytes of a report on the wire, keys included, over all sub-teams."""
        payload = len(self._encoded(report))
        return sum(payload + len(self._report_key(sub_team, report.subject)) for sub_team in self.sub_teams)

    def _encoded(self, message: Message) -> bytes:
        """On a poor link in as few bytes as there are for the same numbers."""
        return encode(message, shortest=self.budget is not None and self.budget.saves)

    def _report_key(self, sub_team: str, subject: str) -> str:
        return keys.REPORT.key(team=self.team, sub_team=sub_team, source=self.robot, subject=subject)

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return self._membership.tokens

    @property
    def listens(self) -> tuple[str, ...]:
        return (keys.READING.key(team=self.team, robot=self.robot), *self._membership.listens)

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
            early = (
                self.intake.retry(lambda _, message: self._hear(message, now)) if envelope.kind is Kind.ALIVE else []
            )
            came = envelope.kind is Kind.ALIVE and keys.WORLD.match(envelope.key) is not None
            return early + self._advance(now) + (self._statuses(now) if came else [])  # a token alone is nobody
        return self.intake.take(envelope, lambda _, message: self._hear(message, now)) + self._advance(now)

    def wake(self, now: float) -> list[Envelope]:
        out = self._advance(now)
        return out + (self._statuses(now) if now >= self.intake.status_due else [])

    def wake_at(self, now: float) -> float | None:
        ends = self.rounds.ends_at(self.clock.pace)
        return min(self.intake.status_due, ends, self.clock.changes_at(), self.roster.changes_at())

    # --- receiving ----------------------------------------------------------------------------------------------------

    def _hear(self, message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            news = self.clock.hear(message, now)
            return [] if message.end else self._follow(news, now, message)  # the last Clock of a run begins no tick
        if isinstance(message, Readings):
            return self._hear_readings(message, now)
        if isinstance(message, Consensus):
            self._keep(message, now)
        if isinstance(message, Refusal):
            self._hear_refusal(message)
        return []

    def _hear_refusal(self, refusal: Refusal) -> None:
        """A board of this robot's refused what it said: counted, and logged once for each board and reason."""
        if refusal.board not in self.roster.boards.get(refusal.sub_team, []):
            raise Refused("unregistered", f"board {refusal.board} holds no liveliness token")
        self.counters["told_refused"] += 1
        seen = refusal.board, refusal.reason
        if seen not in self._told_refused and len(self._told_refused) < MAX_AGREED:
            self._told_refused.add(seen)
            log.warning("%s; not logged again for this board and reason", told(refusal))

    def _hear_readings(self, readings: Readings, now: float) -> list[Envelope]:
        """Take readings that go on with those before; others once the world's Clock, or those that come next, say so too."""
        before, self._doubted = self._doubted, None
        if not self.run and self.clock.followed is None:
            self._begin(readings.run)
        if self._goes_on(readings):
            self._take(readings, now)
        elif readings.run != self.run or abs(readings.tick - self.tick) > JUMP:
            self._doubted = readings
            if self.clock.pace is Pace.FREE and before is not None and _follows(before, readings):
                return self._believe(before, readings, now)
        return []

    def _goes_on(self, readings: Readings) -> bool:
        """Whether these may be the next readings of this run; where a world's Clock is followed, they are one tick ahead at most."""
        followed = self.clock.followed
        newest = self.tick + JUMP if followed is None else max(followed.tick + 1, self.tick + 1)
        return readings.run == self.run and (self.tick < 0 or self.tick < readings.tick <= newest)

    def _take(self, readings: Readings, now: float) -> None:
        self._readings = readings
        self.rounds.enter("readings", now)

    def _believe(self, before: Readings, readings: Readings, now: float) -> list[Envelope]:
        """Readings jumped, and those that came next say the same: go on with both, and begin anew where they are of a new start."""
        if readings.run != self.run or readings.tick < self.tick:
            self._begin(readings.run)
        self._doubted = None
        self._take(before, now)
        out = self._advance(now)
        self._take(readings, now)
        return out

    def _follow(self, news: News, now: float, heard: Clock | None = None) -> list[Envelope]:
        """React to what is new about the team clock, by the Clock that was heard; a tick itself begins with its readings."""
        clock = self.clock.followed
        if news is News.FREE:
            log.warning("%s: the world is gone; going by Unix time", self.robot)
        elif clock is not None and clock.run != self.run:
            ahead = self._doubted
            self._begin(clock.run)
            if ahead is not None and ahead.run == clock.run:  # they came before the Clock
                self._take(ahead, now)
        if clock is not None and news is News.RUN:
            self._forget_agreed(clock.tick)
        if clock is not None and news is not News.TICK and clock.tick == self.tick:
            self.counters["repeated"] += 1  # the Clock is repeated, or the first one came after this tick was done
            wanted = "answers" if heard is None else heard.wants(f"robot/{self.robot}")
            return self._answers(now) if wanted == "answers" else self._statuses(now) if wanted == "status" else []
        return []

    def _forget_agreed(self, tick: int) -> None:
        """A run is followed from this tick on: what was agreed in no earlier tick is of another run, or of Unix time."""
        self._agreed = {key: agreed for key, agreed in self._agreed.items() if agreed.tick < tick}
        self._arrived = RollCall()
        for (sub_team, _, subject), agreed in self._agreed.items():
            self._arrived.record(sub_team, subject, agreed.tick)

    def _keep(self, consensus: Consensus, now: float) -> None:
        """Keep the newest agreed belief of each board about each subject until the next tick."""
        newest = max(self.clock.tick, self.tick + 1)  # whoever joins a run late has done none of its ticks
        if self.clock.followed is not None and consensus.tick > newest:
            raise Refused("future", f"agreed in tick {consensus.tick}, and the newest is {newest}")
        if consensus.board not in self.roster.boards.get(consensus.sub_team, []):
            who = f"board {consensus.board} holds no liveliness token in sub-team {consensus.sub_team}"
            raise TooEarly(Refused("unregistered", who))  # the token may be on its way
        if self.clock.pace is Pace.FREE:
            consensus = self._on_time(consensus, now)
        key = consensus.sub_team, consensus.board, consensus.subject
        before = self._agreed.get(key)
        if before is None and len(self._agreed) >= MAX_AGREED:
            raise Refused("too-many", f"{consensus.subject} would be one more than {MAX_AGREED} agreed beliefs")
        if before is None or (before.tick, before.time) < (consensus.tick, consensus.time):
            if self.agent.uses(consensus.subject):
                Agreed.unpacked(consensus, self.grid)  # Refused: what is wrong with it
            self._agreed[key] = consensus
            self._arrived.record(consensus.sub_team, consensus.subject, consensus.tick)

    def _on_time(self, consensus: Consensus, now: float) -> Consensus:
        """A consensus with its stamp by this robot's clock: the board tells with the robot's own place how far the two are apart."""
        self._echoes.hear(f"{consensus.sub_team}/{consensus.board}", consensus.time, now)
        if consensus.subject == f"robot/{self.robot}":
            self._ahead[consensus.sub_team] = consensus.ahead
        ahead = self._ahead.get(consensus.sub_team, 0.0)
        return consensus.model_copy(update={"time": consensus.time + ahead}) if ahead else consensus

    # --- when to act --------------------------------------------------------------------------------------------------

    def _advance(self, now: float) -> list[Envelope]:
        """Do the tick once its readings are in, and in lockstep the world's clock and what the boards agreed before it."""
        self.roster.forget(now)
        out: list[Envelope] = []
        while (news := self.clock.look(now)) is not News.NOTHING:
            out += self._follow(news, now)
        while (ended := self.rounds.turn(self.clock.pace, now, self._holds)) is not None:
            phase, late = ended
            self.counters["late"] += late
            if phase == "agreed":
                out += self._act(now)
        return out

    def _holds(self, fact: str) -> bool:
        """Whether the "readings" of the next tick are there, the world's "clock" for them, and what was "agreed" before it."""
        clock, readings = self.clock.followed, self._readings
        if fact == "readings":
            return readings is not None
        if clock is None or readings is None:
            return False
        if fact == "readings and clock":
            return clock.run == readings.run and clock.tick >= readings.tick
        settled = ((sub_team, clock.settled.get(sub_team, [])) for sub_team in self.sub_teams)
        return all(self._arrived.arrived(sub_team, clock.tick - 1, subjects) for sub_team, subjects in settled)

    def _act(self, now: float) -> list[Envelope]:
        readings, self._readings = self._readings, None
        assert readings is not None, "this phase follows the one that waits for readings"
        if self.clock.pace is Pace.FREE and self.tick < 0:
            log.info("%s: no world gives the clock; going by its readings and Unix time", self.robot)
        newest: dict[str, Consensus] = {}
        for (_, _, subject), agreed in sorted(self._agreed.items()):
            if subject not in newest or agreed.tick > newest[subject].tick:
                newest[subject] = agreed
        self._agreed = {}
        self.tick, self.time = readings.tick, readings.time
        if readings.odometry is not None:
            self._speeds.append(abs(readings.odometry.distance) / readings.odometry.dt)
        self._kept = []
        self._reports, self._solo = [], Solo(robot=self.robot, tick=self.tick, time=self.time, beliefs={})
        self._failed += 1
        with self.intake.failures.survive("the robot's tick"):
            self._reports, self._solo = self.agent.tick(readings, Unpacked(newest, self.grid))
            self._choose(newest)
            self._failed = 0
        if self._failed >= FAILURES:
            self.agent, self._failed = self._new_agent(), 0
        self.counters["ticks"] += 1
        return self._answers(now)

    def _choose(self, agreed: Mapping[str, Consensus]) -> None:
        """On a poor link: leave out, or say more coarsely, what is worth less than its bytes."""
        if self.budget is None:
            return
        self._team.update({s: self._known(c) for s, c in agreed.items()})
        boards = {board for sub_team in self.sub_teams for board in self.roster.boards.get(sub_team, [])}
        if boards - self._boards:
            self.budget.repeat_state()
        self._boards = boards
        said = self.budget.choose(self._reports, self.time, self._speed, self._team)
        wanted = {report.subject for report in self._reports}
        self._team = {subject: it for subject, it in self._team.items() if subject in wanted}
        self._reports, self._kept = said.reports, sorted(said.kept)
        self.agent.said(said)

    def _known(self, agreed: Consensus) -> Known:
        state = None
        if agreed.subject == f"robot/{self.robot}" and agreed.state is not None:
            with suppress(Refused):
                state = unpack_state(agreed.state)
        return Known(agreed.entropy, agreed.rule == "joint", state)

    @property
    def _speed(self) -> float | None:
        """The speed for the status, unit per second: the greatest of the last ticks. Boards widen this robot's old reports by it."""
        if not self._speeds:
            return None
        speeds = list(self._speeds)
        if self.budget is not None and self.budget.saves:
            # Reports grow old before the next one, and the noise of a single tick's odometry would let them spread too far.
            ticks = min(SPAN, len(speeds))
            speeds = [sum(speeds[i : i + ticks]) / ticks for i in range(len(speeds) - ticks + 1)]
            return float(np.float32(min(max(speeds), FASTEST)))
        return min(max(speeds), FASTEST)

    # --- sending ------------------------------------------------------------------------------------------------------

    def _answers(self, now: float) -> list[Envelope]:
        """The reports of the newest tick, the solo beliefs where a world is there, whose referee reads them, and the statuses."""
        out = []
        encoded = [(report.subject, self._encoded(report)) for report in self._reports]
        for sub_team in self.sub_teams:
            for subject, payload in encoded:
                out.append(Envelope(self._report_key(sub_team, subject), payload))
        if self._solo is not None and self.roster.world:
            out.append(Envelope(keys.SOLO.key(team=self.team, robot=self.robot), encode(self._solo)))
        return out + self._statuses(now)

    def _statuses(self, now: float) -> list[Envelope]:
        """A status in every sub-team: what was reported last, with the counters as they stand."""
        status = Status(
            process=self.robot,
            kind="robot",
            tick=max(0, self.tick),
            time=self.time,
            phase="reported" if self.tick >= 0 else "idle",
            subjects=[report.subject for report in self._reports],
            settings={
                "localizer": self.settings.localizer,
                "feedback": self.feedback,
                "pace": self.clock.pace.value,
            },
            kept=self._kept,
            speed=self._speed,
        )
        if self.clock.pace is Pace.FREE:
            status = status.model_copy(update={"sent": now, "echo": self._echoes.held(now)})
        status = self.intake.counted(status, now)
        payload = self._encoded(status.model_copy(update=self._left_out(status)))
        keys_of = (keys.STATUS.key(team=self.team, sub_team=s, process=self.robot) for s in self.sub_teams)
        return [Envelope(key, payload) for key in keys_of]

    def _left_out(self, status: Status) -> dict[str, object]:
        """On a poor link most statuses leave out what only operators read, where nothing new was refused: they keep that."""
        if self.budget is None or not self.budget.saves:
            return {}
        refused = dict(self.refused)
        due = self._told_all is None or self.time - self._told_all[0] >= TELLING
        if status.phase == "idle" or due or (self._told_all is not None and self._told_all[1] != refused):
            self._told_all = self.time, refused
            return {}
        return {"counters": {}, "refused": {}, "ages": {}, "settings": {}}


def _follows(before: Readings, readings: Readings) -> bool:
    """Whether readings may be the next ones after others."""
    return readings.run == before.run and 0 < readings.tick - before.tick <= JUMP
