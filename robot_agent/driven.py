"""A robot whose program gives it its readings by calls, in the program's own process. Pure.

It is the robot process (`robot_agent.service`) without Readings on the wire. The program hands over its measurements since the
last step, and a step makes one tick of them.
"""

import logging
import math
import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from blackboard.config import Scenario
from blackboard.opinion.classes import LANDMARK
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import KEPT, Nuisance
from blackboard.opinion.grid import Array
from blackboard.process.reactions import Cue
from blackboard.process.team_clock import Pace
from blackboard.wire.envelope import Envelope
from blackboard.wire.evidence import Seen
from blackboard.wire.gaussians import one_way
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting
from blackboard.wire.types import MAX_OPINIONS, Message
from robot_agent.config import VisionSection, settings_of, table_of
from robot_agent.extrapolated import Extrapolated
from robot_agent.gaussian.agent import JointAgent
from robot_agent.gaussian.own import Given, Independence, of_particles
from robot_agent.gaussian.sensors import Camera, Sensors, Wheels, sensors_of, wheels_of
from robot_agent.service import AgentService

#: All that a program's own robot needs.
__all__ = ["Driven", "Independence", "Pose", "SinceStep", "driven", "of_particles"]

log = logging.getLogger(__name__)

#: What a robot's sensors are like where no scenario describes them. `sigmas` are of errors that last (`vehicle.Nuisance`):
#: - scale of ways .1. The radius of a wheel is from a data sheet. Odometry without calibration errs by some percent
#:   (Borenstein and Feng, IEEE Trans. Robotics and Automation 12(6), 1996), and commands in place of odometry by more;
#: - scale of turns .15. The effective track of wide or slipping wheels is not the distance between them (Mandow et al., IROS 2007).
#:   With a smaller sigma a wrong scale of turns is mistaken for an error of the way or of the camera;
#: - bearing .02 rad. A camera is mounted to about one degree;
#: - scale of ranges .05, as of calibrated cameras and radios.
#: Larger errors are found by `opinion.gaussian.priors`. Fresh errors of the way are a share of the speed, so that they fit small
#: robots and cars. Those across the way are as large as those along it, because the robot may skid.
UNKNOWN_WHEELS = Wheels(
    Nuisance(sigmas=(0.1, 0.15, 0.003, 0.02, 0.0, 0.05), walks=(0.003, 0.003, 0.0001)),
    along=0.002,
    across=0.002,
    heading=0.02,
    turning=0.05,
    slip=0.05,
    given=(False, False, False),
    starting=0.0,
)

#: The same sigmas where a scenario describes the wheels, and says nothing of their lasting errors or the camera's: about what is left
#: after a calibration by hand (Borenstein and Feng). With sigmas of 0, wheels 5 % off or a camera 2 degrees askew went unnoticed.
DESCRIBED = Nuisance(sigmas=(0.02, 0.03, 0.0, 0.01, 0.0, 0.02), walks=(0.003, 0.003))


BENDS = 0.5 / math.sqrt(3)  # `Wheels.bends`: a turn begins or ends at any time within a step
PIECES = 50  # of odometry, before it is judged which time they cover
TOO_SMALL = 2.0  # the factor by which variances of an own filter are too small, above which a warning says so
GUESSED = 10  # steps that see something without odometry, after which that is said
SILENT = 1.0  # seconds without any odometry, after which that is said
LACKING, UNIT = 0.7, 20.0  # times the time that passed: less leaves motion out, more is of another unit


@dataclass(frozen=True)
class SinceStep:
    """What a robot's sensors measured since its last step."""

    odometry: Odometry | None = None
    compass: tuple[float, float | None] | None = None  # heading and sigma, radians
    fix: Fix | None = None
    sightings: tuple[Sighting, ...] = ()  # ranges with bearings
    seen: tuple[Seen, ...] = ()  # of other kinds
    posterior: Moments | None = None  # of a filter of the robot's own
    after: Odometry | None = None  # what of the odometry came after the posterior

    def plus(self, later: "SinceStep") -> "SinceStep":
        """Both: one way follows the other, turns add up, of place and heading the newest counts."""
        before, fix = self.fix, later.fix or self.fix
        if fix is not None and fix.heading is None and before is not None and before.heading is not None:
            told = {"heading": before.heading, "heading_sigma": before.heading_sigma}
            fix = fix.model_copy(update=told)  # the newest heading still counts where the newer fix has none
        return SinceStep(
            _both_ways(self.odometry, later.odometry),
            later.compass or self.compass,
            fix,
            (*self.sightings, *later.sightings)[-MAX_OPINIONS:],
            (*self.seen, *later.seen)[-MAX_OPINIONS:],
            *self._posterior_and(later),
        )

    def _posterior_and(self, later: "SinceStep") -> tuple[Moments | None, Odometry | None]:
        """The newest posterior of both, and what was driven after it."""
        if later.posterior is not None or self.posterior is None:
            return later.posterior, later.after
        return self.posterior, _both_ways(self.after, later.odometry)

    def readings(self, run: str, robot: str, tick: int, time: float) -> Readings:
        """All of it as the readings of a tick at a team time (s)."""
        heading, sigma = self.compass or (None, None)
        return Readings(
            run=run,
            robot=robot,
            tick=tick,
            time=time,
            odometry=self.odometry,
            compass=heading,
            compass_sigma=sigma,
            fix=self.fix,
            sightings=list(self.sightings),
            seen=list(self.seen),
        )


def _both_ways(first: Odometry | None, second: Odometry | None) -> Odometry | None:
    return first or second if first is None or second is None else one_way(first, second)


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a robot is at a team time (s): x, y (unit) and heading (radians), shape (3,), and covariance, shape (3, 3)."""

    mean: Array
    covariance: Array
    time: float


@dataclass
class Covered:
    """Mutable: which share of the time a robot's odometry is of while it moves, and what to say where that cannot be."""

    _shares: deque[float] = field(default_factory=lambda: deque(maxlen=PIECES))
    _moved_at: float | None = None  # team time (s) of the newest odometry, if the robot moved in it

    def hear(self, odometry: Odometry | None, time: float) -> str | None:
        """Take the odometry of a step that ends at a team time (s); None: it covers about the time since the one before.

        The robot may have stood in steps without any, so times are compared between two in which it moved.
        """
        if odometry is None:
            if self._moved_at is None or time - self._moved_at <= SILENT:
                return None
            return (
                f"no odometry for {time - self._moved_at:.1f} s, and it moved before: it may have driven anywhere since; "
                "where it stands, give odometry(0, 0, dt)"
            )
        moves = bool(odometry.distance or odometry.turn or odometry.aside)
        if moves and self._moved_at is not None and time > self._moved_at:
            self._shares.append(odometry.dt / (time - self._moved_at))
        self._moved_at = time if moves else None
        share = statistics.median(self._shares) if len(self._shares) == PIECES else 1.0
        if LACKING <= share <= UNIT:
            return None
        what = f"the dt of its odometry is {share:.2g} times the time between its steps"
        if share > UNIT:
            return f"{what}: give seconds, and team time to step(time=) where it does not run in real time"
        return f"{what}: what it drives in the rest is not told, and may lead anywhere; give all of its odometry"


class Driven(AgentService):
    """An `AgentService` whose owner calls `step`."""

    def __init__(self, news: Callable[[Cue | Message, float], None], *, sensors: Sensors, **arguments: Any) -> None:
        """`news` gets what the peer hears, after it was taken; `arguments` are the others of `AgentService`."""
        self._news, self._sensors = news, sensors
        self._pending = SinceStep()  # what no tick has taken yet
        self._extrapolated = Extrapolated()
        self._guessed = 0  # steps in which it saw something while odometry was extrapolated
        self._said = set[str]()  # the kinds of warnings that were logged
        self._covered: Covered | None = Covered()  # None once it was said what is wrong
        super().__init__(sensors=sensors, hears_readings=False, **arguments)

    def _hear(self, heard: Cue | Message, now: float) -> list[Envelope]:
        out = super()._hear(heard, now)
        self._news(heard, now)
        return out

    def step(
        self, gathered: SinceStep | None, now: float, time: float | None = None
    ) -> tuple[Pose | None, list[Envelope]]:
        """Act on what the sensors measured, at a team time (s) [default: now]: where the robot is, and what is to be sent.

        Where a world gives the clock, it is one step for each of its ticks: what comes after it waits for the next one.
        """
        self._pending = self._pending.plus(gathered or SinceStep())
        followed = self.clock.followed
        done = followed is not None and followed.run == self.run and followed.tick <= self.tick
        if done or self.clock.pace is Pace.WAITING:
            return self.pose(), []
        stamp = self.clock.time(now) if time is None else time
        if followed is None:  # milliseconds, so that the count also grows where the program is started again
            run, tick = f"{self.robot} alone", max(self.tick + 1, int(1000 * now))
        else:
            run, tick = followed.run, followed.tick
        if run != self.run:
            self._begin(run)
            self._extrapolated = Extrapolated()
        if self._pending.posterior is not None:
            self._own().give(self._pending.posterior, self._pending.after)
        if self._covered is not None and (text := self._covered.hear(self._pending.odometry, stamp)) is not None:
            self._covered = None
            self._say_once("covered", text)
        self._extrapolated = self._extrapolated.after(self._pending.odometry, stamp)
        self._warn_of_guessed(self._pending)
        self._pending = replace(self._pending, odometry=self._extrapolated.odometry)
        self._warn_of_old(self._pending)
        self._warn_of_unmapped(self._pending)
        self._wait_with(self._pending.readings(run, self.robot, tick, stamp), now)
        self._pending = SinceStep()
        out = self._turn(now)
        if (independence := self.independence) is not None and independence.fed_back:
            self._say_once(
                "fed back",
                "its beliefs say what the team believed, and count no more while they do: feed nothing back; "
                "if you do not, their covariance may be too small",
            )
        if independence is not None and independence.too_small > TOO_SMALL:
            self._say_once(
                "too small",
                f"its posteriors move as if their variances were {independence.too_small:.2g} times as large: what they gain "
                "counts that much less; give larger covariances",
            )
        return self.pose(), out

    def _say_once(self, what: str, text: str) -> None:
        """Log a warning, if none of its kind was logged before."""
        if what not in self._said:
            self._said.add(what)
            log.warning("%s: %s", self.robot, text)

    def _warn_of_guessed(self, since: SinceStep) -> None:
        """Say once that odometry is extrapolated where the robot sees something."""
        if since.odometry is not None or self._extrapolated.odometry is None or not (since.sightings or since.seen):
            return
        self._guessed += 1
        if self._guessed == GUESSED:
            self._say_once(
                "guessed",
                "it sees something in steps without odometry, and where it was then is extrapolated; "
                "call odometry() in each step, also beside belief()",
            )

    def _warn_of_old(self, since: SinceStep) -> None:
        """Say once that a sighting is older than the motions that are kept. Where the robot was then is guessed."""
        longest = KEPT + (0.0 if since.odometry is None else since.odometry.dt)
        told: list[Sighting | Seen] = [*since.sightings, *since.seen]
        age = max((sighting.age for sighting in told), default=0.0)
        if age > longest:
            self._say_once(
                "old",
                f"see(age={age:g}): its way is kept for {longest:.3g} s, and where it was before is guessed; "
                "tell sightings sooner, and their age in seconds",
            )

    def _warn_of_unmapped(self, since: SinceStep) -> None:
        """Say once that landmarks without names tell nothing where the scenario has no map of them."""
        if not self._sensors.landmarks and any(seen.subject == LANDMARK for seen in since.sightings):
            self._say_once(
                "unmapped",
                f"see({LANDMARK!r}) tells nothing: the scenario has no map; give [robot] landmarks, or see('landmark/NAME', at=...)",
            )

    def _own(self) -> Given:
        """What stands for the robot's own filter, from its first posterior on. Its lasting errors are left to that filter."""
        its = self.agent.filter if isinstance(self.agent, JointAgent) else None
        if not isinstance(its, Given):
            wheels = replace(self._sensors.wheels, nuisance=Nuisance(), bends=0.0)
            sensors = replace(self._sensors, wheels=wheels)
            self._new_agent = partial(JointAgent, self.robot, self.settings, self.grid, sensors=sensors, own=True)
            self.agent = self._new_agent()
            its = self.agent.filter
            assert isinstance(its, Given)
        return its

    @property
    def independence(self) -> Independence | None:
        """Of a robot with a filter of its own: how independent what that gained is of what the team believed."""
        its = self.agent.filter if isinstance(self.agent, JointAgent) else None
        return its.independence if isinstance(its, Given) else None

    def pose(self) -> Pose | None:
        """Where the robot is, as the team has it; None before anything is known."""
        pose: Moments | None = self.agent.pose()
        return None if pose is None else Pose(pose.mean, pose.covariance, self.peer.answers.time)


def sensors_in(scenario: Scenario, robot: str) -> Sensors:
    """The sensors of a robot that gives its readings itself: what a scenario says of it, and else nothing is known."""
    settings = settings_of(scenario, robot)
    configured = sensors_of(settings)
    seen, wheels = VisionSection() == settings.vision, UNKNOWN_WHEELS
    if "odometry" in table_of(scenario, robot):
        wheels = wheels_of(settings.odometry, settings.ranging.scale)
        if not settings.odometry.measured:
            sigmas = tuple(map(max, wheels.nuisance.sigmas, DESCRIBED.sigmas))
            wheels = replace(wheels, nuisance=replace(wheels.nuisance, sigmas=sigmas, walks=DESCRIBED.walks))
    return replace(configured, wheels=replace(wheels, bends=BENDS), camera=Camera() if seen else configured.camera)


def driven(
    news: Callable[[Cue | Message, float], None], scenario: Scenario | None, *, robot: str, **arguments: Any
) -> Driven:
    """A robot by a scenario, if there is one; `arguments` are the others of `AgentService`. UserError: a mistake in the scenario."""
    told = Scenario({}) if scenario is None else scenario
    settings = settings_of(told, robot)
    if "localizer" not in table_of(told, robot):
        settings = settings.model_copy(update={"localizer": "pose"})
    drift, robots = (1.0, 1) if scenario is None else (scenario.board.drift, max(1, len(scenario.team.robots)))
    arguments |= {"drift": drift, "robot": robot, "robots": robots}
    return Driven(news, settings=settings, sensors=sensors_in(told, robot), **arguments)
