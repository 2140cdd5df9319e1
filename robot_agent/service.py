"""The robot process: which readings it acts on and when, around an Agent and a Peer.

The table `blackboard.process.rounds.ROBOT` says when a phase of a tick is over (docs/ticks.md, "A tick in lockstep").
"""

import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from blackboard.opinion.classes import is_class
from blackboard.opinion.grid import Grid
from blackboard.process.peer import Answers, Peer
from blackboard.process.reactions import Cue
from blackboard.process.rounds import ROBOT, Rounds
from blackboard.process.service import Around
from blackboard.process.team_clock import Pace
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Readings, Report, Solo
from blackboard.wire.types import Message
from robot_agent.agent import Agent, Feedback, TeamBelief, TeamBeliefs
from robot_agent.budget import Budget
from robot_agent.config import RobotSection
from robot_agent.gaussian.agent import JointAgent
from robot_agent.gaussian.sensors import Sensors
from robot_agent.inputs import Gathered, Sequencer
from robot_agent.sender import Sender, fastest
from robot_agent.sensing import PARTS
from robot_agent.slots import Slots

log = logging.getLogger(__name__)

LATELY = 50  # ticks of which the speed is said
FAILURES = 3  # ticks in a row that the agent could not do until it begins anew


class AgentService(Around):
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
        sensors: Sensors | None = None,
        hears_readings: bool = True,
        robots: int = 1,
    ) -> None:
        """`joint`: the boards keep a joint belief ([board] fusion); `drift`: how they let reports spread ([board] drift).

        `sensors` are those of a filter for a joint, where they are not those of the settings. `hears_readings`: from the wire.
        `robots` share `[robot.send] rate`.
        """
        self.robot, self.grid, self.settings = robot, grid, settings
        send = settings.send
        counted = send.rate is not None
        self._saves = counted or (send.budget is not None and math.isfinite(send.budget))
        self.peer = Peer(
            team,
            sub_teams,
            robot,
            self._hear,
            settings={"localizer": settings.localizer, "feedback": feedback},
            listens=(keys.READING.key(team=team, robot=robot),) if hears_readings else (),
            brief=self._saves,
            rare=counted,
        )
        super().__init__(self.peer)
        self.clock, self.counters, self.refused = self.peer.clock, self.peer.intake.counters, self.peer.intake.refused
        self.rounds = Rounds(ROBOT, {"patience": settings.patience}, "readings")
        self._new_agent: Callable[[], JointAgent | Agent] = (
            partial(JointAgent, robot, settings, grid, feedback, sensors)
            if joint
            else partial(Agent, robot, settings, grid, feedback)
        )
        self._new_budget = partial(Budget, send, grid, robot, drift, self.peer.size)
        self._arrivals = 0  # of boards, before the newest tick
        self._joined = -1  # the first tick of the run in which it followed a Clock
        self._pace = send.pace(robots, len(sub_teams)) if counted else None
        self._forget()

    def _begin(self, run: str) -> None:
        """Follow readings into another run than before, or into the very first."""
        self.peer.begin(run)
        self._forget()

    def _forget(self) -> None:
        self.agent = self._new_agent()
        self._failed = 0  # ticks in a row that the agent could not do
        self.rounds.enter("readings", 0.0)
        self._readings, self._agreed = Sequencer(), Gathered()
        self._speeds: deque[float] = deque(maxlen=LATELY)  # unit per second, by the odometry
        slots = None if self._pace is None else Slots(self._pace)
        sends_all = self.settings.send.budget is None and slots is None
        self._sender = None if sends_all else Sender(self._new_budget(slots, len(self.peer.sub_teams)), self.robot)

    @property
    def run(self) -> str:
        """The run of its readings."""
        return self.peer.run

    @property
    def tick(self) -> int:
        """The newest tick that was done; -1 before the first."""
        return self.peer.answers.tick

    # --- what the loop needs ------------------------------------------------------------------------------------------

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        return self.peer.receive(envelope, now) + self._turn(now)

    def wake(self, now: float) -> list[Envelope]:
        return self._advance(now) + self.peer.wake(now)

    def wake_at(self, now: float) -> float:
        return min(self.peer.wake_at(now), self.rounds.ends_at(self.clock.pace))

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        super().check()
        self._agreed.check()
        self._readings.check(self.run, self.tick)
        assert self.rounds.phase == "readings" or self._readings.next is not None, self.rounds.phase
        assert 0 <= self._failed < FAILURES

    # --- what is new --------------------------------------------------------------------------------------------------

    def _hear(self, heard: Cue | Message, now: float) -> list[Envelope]:
        if heard in (Cue.BEGIN, Cue.JOIN):
            self._joined = self.clock.tick
        if heard is Cue.BEGIN:
            ahead = self._readings.doubted
            self._forget()
            if ahead is not None and ahead.run == self.run:  # they came before the Clock
                self._wait_with(ahead, now)
        elif heard is Cue.JOIN:
            self._agreed.forget_from(self.clock.tick)
        elif heard is Cue.FREE:
            log.warning("%s: the world is gone; going by Unix time", self.robot)
        elif isinstance(heard, Readings):
            return self._hear_readings(heard, now)
        elif isinstance(heard, Consensus):
            if self.agent.uses(heard.subject):
                TeamBelief.unpacked(heard, self.grid)  # Refused: what is wrong with it
            self._agreed.hear_consensus(heard)
        return []

    def _hear_readings(self, readings: Readings, now: float) -> list[Envelope]:
        """Take readings that go on with those before; of a jump the ones before them, too."""
        if not self.run and self.clock.followed is None:
            self._begin(readings.run)
        taken = self._readings.take_readings(readings, self.run, self.tick, self.clock)
        if taken and (readings.run != self.run or readings.tick < self.tick):
            self._begin(readings.run)
        out: list[Envelope] = []
        for number, reading in enumerate(taken):
            out += self._advance(now) if number else []
            self._wait_with(reading, now)
        return out

    def _wait_with(self, readings: Readings, now: float) -> None:
        before, self._readings.next = self._readings.next, readings
        if before is None or (before.run, before.tick) != (readings.run, readings.tick):  # else the world asks again
            self.rounds.enter("readings", now)

    # --- when to act --------------------------------------------------------------------------------------------------

    def _advance(self, now: float) -> list[Envelope]:
        """See what time has changed; then as `_turn`."""
        return self.peer.look(now) + self._turn(now)

    def _turn(self, now: float) -> list[Envelope]:
        """Do the tick once its readings are in, and in lockstep the world's clock and what the boards agreed before it."""
        out: list[Envelope] = []
        while (ended := self.rounds.turn(self.clock.pace, now, self._holds)) is not None:
            phase, late = ended
            self.counters["late"] += late
            if phase == "agreed":
                out += self._act(now)
        return out

    def _holds(self, fact: str) -> bool:
        """Whether the "readings" of the next tick are there, the world's "clock" for them, and what was "agreed" before it.

        A robot that comes in the middle of a run does not wait for what was agreed before it came.
        """
        clock, readings = self.clock.followed, self._readings.next
        if fact == "readings":
            return readings is not None
        if clock is None or readings is None:
            return False
        if fact == "readings and clock":
            return clock.run == readings.run and clock.tick >= readings.tick
        if clock.tick == self._joined:
            return True
        settled = ((sub_team, clock.settled.get(sub_team, [])) for sub_team in self.peer.sub_teams)
        return all(self._agreed.arrived(sub_team, clock.tick - 1, subjects) for sub_team, subjects in settled)

    def _act(self, now: float) -> list[Envelope]:
        readings, self._readings.next = self._readings.next, None
        assert readings is not None, "this phase follows the one that waits for readings"
        if self.clock.pace is Pace.FREE and self.tick < 0:
            log.info("%s: no world gives the clock; going by its readings and Unix time", self.robot)
        if readings.odometry is not None:
            self._speeds.append(math.hypot(readings.odometry.distance, readings.odometry.aside) / readings.odometry.dt)
        speed = fastest(list(self._speeds), steady=self._saves)
        if unknown := sum(not sighting.is_known for sighting in readings.seen):
            self.counters["unknown_kinds"] += unknown
        if isinstance(self.agent, Agent):
            alone = [seen.subject for seen in readings.seen if seen.kind in PARTS and seen.landmark is None]
            parts = sum(not (self.settings.vision.mates and subject.startswith("robot/")) for subject in alone)
            self.counters.update({"unused_parts": parts} if parts else {})
        agreed, kept = self._agreed.collect(), list[str]()
        reports, solo = list[Report](), Solo(robot=self.robot, tick=readings.tick, time=readings.time, beliefs={})
        self._failed += 1
        self._note_boards()
        with self.peer.intake.failures.survive("the robot's tick"):
            reports, solo = self.agent.tick(readings, TeamBeliefs(agreed, self.grid))
            if isinstance(self.agent, Agent):
                unnamed = sum(map(is_class, readings.subjects)) - sum(len(report.unnamed) for report in reports)
                self.counters.update({"unused_unnamed": unnamed} if unnamed else {})
            if self._sender is not None:
                choice = self._sender.choose(reports, readings.time, speed, agreed, self._arrivals)
                reports, kept = choice.reports, sorted(choice.kept)
                self.agent.on_sent(choice)
            self._failed = 0
        if self._failed >= FAILURES:
            self.agent, self._failed = self._new_agent(), 0
        self.counters["ticks"] += 1
        return self.peer.say(Answers(readings.tick, readings.time, reports, solo, kept, speed, self.agent.found()), now)

    def _note_boards(self) -> None:
        """Let the agent know that a board has come since the last tick; not on a poor link, where its answer would cost too much."""
        came, self._arrivals = self.peer.roster.arrivals != self._arrivals, self.peer.roster.arrivals
        if came and not self._saves and isinstance(self.agent, JointAgent):
            self.agent.on_board()
