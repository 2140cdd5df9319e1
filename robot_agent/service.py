"""A robot as a process sees it: envelopes to messages around an Agent (docs/design.md, "A tick in lockstep")."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence

from blackboard.errors import Refused
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import encode, open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Message, Readings, Report, Solo, Status
from robot_agent.agent import Agent, Feedback
from robot_agent.config import RobotSection

log = logging.getLogger(__name__)

STATUS_PERIOD = 1.0  # seconds between signs of life
MAX_SUBJECTS = 256  # whose agreed beliefs are kept


class AgentService:
    """The process of one robot (`blackboard.wire.envelope.Service`); it may be in several sub-teams."""

    def __init__(
        self,
        *,
        team: str,
        sub_teams: Sequence[str],
        robot: str,
        grid: Grid,
        settings: RobotSection,
        feedback: Feedback = "guarded",
    ) -> None:
        self.team, self.sub_teams, self.robot = team, tuple(sub_teams), robot
        self.grid, self.settings, self.feedback = grid, settings, feedback
        self.counters: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self._warned: set[tuple[str, str]] = set()
        self._status_due = 0.0
        self._begin("")

    def _begin(self, run: str) -> None:
        """Forget everything: a new run of the world, or the very first."""
        self.run = run
        self.agent = Agent(self.robot, self.settings, self.grid, self.feedback)
        self.tick, self.time = -1, 0.0  # of the newest tick that was done
        self._clock: Clock | None = None
        self._readings: Readings | None = None  # waiting for its tick to begin
        self._waiting_since: float | None = None
        self._agreed: dict[str, dict[str, Consensus]] = {}  # sub-team -> subject -> the newest
        self._sent: list[Envelope] = []
        self._subjects: list[str] = []

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def tokens(self) -> tuple[str, ...]:
        return tuple(keys.MEMBER.key(team=self.team, sub_team=s, robot=self.robot) for s in self.sub_teams)

    @property
    def listens(self) -> tuple[str, ...]:
        agreed = [keys.AGREED.key(team=self.team, sub_team=s, subject="**") for s in self.sub_teams]
        return (keys.CLOCK.key(team=self.team), keys.READING.key(team=self.team, robot=self.robot), *agreed)

    @property
    def watches(self) -> tuple[str, ...]:
        return ()

    @property
    def done(self) -> bool:
        return False

    def note(self, counters: dict[str, int]) -> None:
        self.counters.update({name: n - self.counters[name] for name, n in counters.items()})

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.kind is not Kind.PUT:
            return []
        try:
            _, _, message = open_envelope(envelope)
            return self._hear(message, now)
        except Refused as refusal:
            self._refuse(envelope.key, refusal)
            return []

    def wake(self, now: float) -> list[Envelope]:
        out = self._advance(now)
        return out + ([self._status(s, now) for s in self.sub_teams] if now >= self._status_due else [])

    def wake_at(self, now: float) -> float | None:
        if self._waiting_since is None:
            return self._status_due
        return min(self._status_due, self._waiting_since + self.settings.patience)

    # --- what is heard ------------------------------------------------------------------------------------------------

    def _hear(self, message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock | Readings):
            if message.run != self.run:
                self._begin(message.run)
            elif message.tick == self.tick and isinstance(message, Clock) and not message.end:
                self.counters["repeated"] += 1
                return list(self._sent)
        if isinstance(message, Clock):
            self._clock = message
        elif isinstance(message, Readings):
            if message.tick > self.tick:
                self._readings = message
        elif isinstance(message, Consensus):
            self._keep(message)
        return self._advance(now)

    def _keep(self, consensus: Consensus) -> None:
        """Keep the newest agreed belief about each subject, unpacked once to see that it can be used."""
        known = self._agreed.setdefault(consensus.sub_team, {})
        before = known.get(consensus.subject)
        if before is not None and (before.tick, before.time) >= (consensus.tick, consensus.time):
            return
        if before is None and len(known) >= MAX_SUBJECTS:
            raise Refused("too-many", f"{consensus.subject} would be one more than {MAX_SUBJECTS} subjects")
        if consensus.tick > self.tick + 1:
            raise Refused("future", f"agreed in tick {consensus.tick}, and this robot has done {self.tick}")
        unpack(consensus.belief, self.grid)
        known[consensus.subject] = consensus

    def _refuse(self, key: str, refusal: Refused) -> None:
        self.refused[refusal.reason] += 1
        if (key[:200], refusal.reason) not in self._warned and len(self._warned) < 1000:
            self._warned.add((key[:200], refusal.reason))
            log.warning("refused %.200s (%s); counted, and not logged again for this source", key, refusal)

    # --- when to act --------------------------------------------------------------------------------------------------

    def _advance(self, now: float) -> list[Envelope]:
        """Do the tick, once it has begun and what the boards agreed before it is in, or patience is over."""
        readings = self._readings
        if (
            readings is None
            or self._clock is None
            or (self._clock.mode == "lockstep" and self._clock.tick < readings.tick)
        ):
            return []
        if self._clock.mode == "lockstep" and not self._agreed_in(self._clock):
            if self._waiting_since is None:
                self._waiting_since = now
            if now < self._waiting_since + self.settings.patience:
                return []
            self.counters["late"] += 1
        self._waiting_since = None
        self._readings = None
        return self._act(readings, now)

    def _agreed_in(self, clock: Clock) -> bool:
        """Whether all that this robot's boards settled in the tick before has arrived."""
        return all(
            (known := self._agreed.get(sub_team, {}).get(subject)) is not None and known.tick >= clock.tick - 1
            for sub_team in self.sub_teams
            for subject in clock.settled.get(sub_team, [])
        )

    def _act(self, readings: Readings, now: float) -> list[Envelope]:
        fresh: dict[str, Consensus] = {}
        for sub_team in sorted(self._agreed):
            for subject, consensus in self._agreed[sub_team].items():
                if subject not in fresh or consensus.tick > fresh[subject].tick:
                    fresh[subject] = consensus
        self._agreed = {}
        reports, solo = self.agent.tick(readings, fresh)
        self.tick, self.time = readings.tick, readings.time
        self._subjects = [report.subject for report in reports]
        self.counters["ticks"] += 1
        self._sent = self._envelopes(reports, solo, now)
        return list(self._sent)

    # --- what is said -------------------------------------------------------------------------------------------------

    def _envelopes(self, reports: list[Report], solo: Solo, now: float) -> list[Envelope]:
        out = []
        for sub_team in self.sub_teams:
            for report in reports:
                key = keys.REPORT.key(team=self.team, sub_team=sub_team, source=self.robot, subject=report.subject)
                out.append(Envelope(key, encode(report)))
        out.append(Envelope(keys.SOLO.key(team=self.team, robot=self.robot), encode(solo)))
        return out + [self._status(sub_team, now) for sub_team in self.sub_teams]

    def _status(self, sub_team: str, now: float) -> Envelope:
        self._status_due = now + STATUS_PERIOD
        status = Status(
            process=self.robot,
            kind="robot",
            tick=max(0, self.tick),
            time=self.time,
            phase="reported" if self.tick >= 0 else "idle",
            subjects=self._subjects,
            counters=dict(self.counters),
            refused=dict(self.refused),
            settings={"localizer": self.settings.localizer, "feedback": self.feedback},
        )
        return Envelope(keys.STATUS.key(team=self.team, sub_team=sub_team, process=self.robot), encode(status))
