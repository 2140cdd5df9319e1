"""A robot's private first-hand filter: readings in; the sum of motions, an evidence increment and relative beliefs out.

It rests on the robot's own readings alone and takes nothing back from the team. What the team believes may be given as
the place to linearise at: that is no evidence. A robot whose heading is known and whose position is not starts with a flat
position; one that knows neither has no Gaussian belief, and its caller keeps a grid until that has one hypothesis (`enter`).
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.coalitions import KNOWN
from blackboard.opinion.gaussian.distrust import Distrust
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment, gained
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.priors import contradicted, replace_prior
from blackboard.opinion.gaussian.relation import Relative, forget_biases
from blackboard.opinion.gaussian.speeds import Speeds
from blackboard.opinion.gaussian.vehicle import (
    ANYWHERE,
    AXES,
    CURVED_TURN,
    FLAT,
    FORWARD,
    HEADING,
    POSE,
    STATES,
    TURN,
    Motion,
    X,
    correct,
    drive,
    entering,
    wrap,
)
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Fix, Readings, Sighting
from robot_agent.gaussian.absolute import AbsoluteSensors, headings, starting_pose
from robot_agent.gaussian.findings import findings
from robot_agent.gaussian.jitter import Jitter
from robot_agent.gaussian.landmarks import Landmarks, Misses, Named, blurred
from robot_agent.gaussian.mishaps import Mishaps
from robot_agent.gaussian.noise import CameraNoise, WheelNoise
from robot_agent.gaussian.roaming import Roaming
from robot_agent.gaussian.search import PlaceSearch
from robot_agent.gaussian.sensors import Sensors
from robot_agent.gaussian.unsent import Unsent
from robot_agent.untold import ALL_TOLD, NOTHING, Untold

Seen = list[tuple[Relative, Array]]  # sightings of landmarks, or of other known points, with their places

REOPENED, REOPENED_HEADING = 1.0, 0.5  # sigmas, unit and radians, of a belief that was given up for the team's
#: Squared distances (`_squared`) of the team's place within which it is linearised there, or begun anew there.
NEAR, ABSURD = (30.0, 1e4)
LARGEST = 1e7  # of a place (unit) and of its variances: boards refuse more
ADRIFT = (
    0.5  # times its usual speed: the odometry is wrong where fixes move away from it faster; slower, its scale may be
)
HEADED = (
    0.3  # radians: with a worse known heading fixes move away from the odometry, because it leads in a wrong direction
)
STRAYED = 0.7  # radians: a robot without a compass that may have turned more, unmeasured, has no Gaussian belief


@dataclass(frozen=True, eq=False)
class FilterResult(Evidence):
    """The evidence of a tick, and what the robot itself needs to know of the tick."""

    motion: Motion = field(default_factory=Motion)  # of the tick alone
    #: What was gained since the evidence that was sent last; the same as `increment` if that was a tick ago.
    unsent: Increment | None = None


@dataclass
class FirstHand:
    """Mutable; `step` once per tick. `robot` is its subject, `robot/r1`."""

    robot: str
    sensors: Sensors = field(default_factory=Sensors)
    epoch: int = -1  # before the first readings
    joint: Joint = field(default_factory=Joint)
    untold: Untold = ALL_TOLD  # its unmeasured motion
    travelled: Motion = field(default_factory=Motion)
    _newest_motion: Motion = field(default_factory=Motion)  # in the newest tick
    _last: Readings | None = None
    #: Whether the heading is not known from own readings yet. The mean is then the team's: only a place to linearise at.
    _is_lent: bool = False
    widened: tuple[int, ...] = ()  # states of its lasting errors whose prior was contradicted
    #: How far it may have turned unmeasured, in radians: since the newest odometry, or since it took its heading from the team.
    _unmeasured: float = 0.0
    _turned: float = 0.0  # radians: the turn of the tick, or its change if that is larger
    _groups: dict[str, tuple[float, float]] = field(default_factory=dict)  # first landmark of a group -> its place
    _misses: Misses = field(default_factory=Misses)
    _unsent: Unsent = field(init=False)
    _search: PlaceSearch = field(init=False)
    wheels: WheelNoise = field(init=False)
    speeds: Speeds = field(default_factory=Speeds)
    distrust: Distrust = field(default_factory=Distrust)
    _usual: Array = field(default_factory=lambda: np.zeros(2))  # how fast it moves while its odometry is not believed
    jumped: bool = False  # whether the odometry jumped in the newest tick
    mishaps: Mishaps = field(init=False)
    camera: CameraNoise = field(default_factory=CameraNoise)
    landmarks: Landmarks = field(init=False)
    jitter: Jitter = field(default_factory=Jitter)
    absolute: AbsoluteSensors = field(init=False)
    roaming: Roaming = field(default_factory=Roaming)

    def __post_init__(self) -> None:
        self._unsent, self._search = Unsent(self.robot), PlaceSearch(self.robot)
        self.landmarks = Landmarks(self.sensors.landmarks, self.sensors.camera.together)
        self.wheels = self._wheel_noise()
        self.mishaps = Mishaps(self.robot, self.sensors.wheels.nuisance)
        self.absolute = AbsoluteSensors(self.robot, self.sensors.wheels.nuisance)

    @property
    def known(self) -> bool:
        """Whether there is a Gaussian belief."""
        return self.robot in self.joint

    @property
    def belief(self) -> Moments | None:
        """The whole block, shape (12,) and (12, 12)."""
        return self.joint.moments(self.robot) if self.known else None

    def step(self, readings: Readings, at: Moments | None = None) -> FilterResult:
        """Take the readings of a tick. `at` is what the team believed a tick ago, the robot's whole block: no evidence.

        The filter linearises there, and judges by it how large the error along the way is.
        """
        readings = self.absolute.without_repeated(readings)
        self.untold = self.untold.after(readings)
        if self.untold.is_all and readings.fix is not None:
            self.roaming.on_fix(readings.time, readings.fix)
        if self.epoch < 0:
            self.restart(readings.time)
        self._unmeasured += self.untold.lapse.turn
        if self.known and self._unmeasured > STRAYED and readings.compass is None:
            self._lose_heading(readings, at)
        if readings.odometry is not None:
            self._unmeasured = 0.0
        self._judge_wheels(at)
        epoch = self.epoch
        self._widen_priors(readings.time)
        since = math.inf if self._last is None else readings.time - self._last.time
        motion = self._move(readings, at).after(self._newest_motion, since)
        moved = None if at is None or not self.known else self._team_moved(at, motion)
        self._lend(moved)
        named = self._named(readings, moved, motion)
        landmarks, others = self._sightings(named, motion.dt)
        motion = self._newest_motion = self._with_mishaps(motion, landmarks, readings.fix)
        by_compass = self.absolute.reading(self.joint, readings, self.sensors.compass)
        if by_compass is not None and self.known:
            self.absolute.on_compass(self.joint, by_compass, readings.time, self._joints()[1:])
        prediction = self.belief
        self._unsent.predict(prediction)
        team = None if moved is None else moved.mean
        apart = math.inf if team is None else self._squared(team)
        # A place far from the own belief would make any sighting contradict it. Where no heading was ever known, two sightings of one
        # landmark would seem to tell it, if they were linearised elsewhere than the motion between.
        linear = team if apart <= NEAR and not self._is_lent else None
        self._take(readings, landmarks, motion, linear, named)
        if self.known and self.robot in self.distrust:
            self.distrust.judge(self.robot, self.joint.moments(self.robot), self._usual)
        increment, unsent = self._gained(prediction), self._gained(self._unsent.before)
        others += self._unnamed(readings, motion.dt)
        if self._gave_up(readings, team, apart, landmarks, motion) or self.epoch != epoch:
            increment = unsent = None
        said = self.travelled, self.sensors.wheels.nuisance, self.belief, increment, others, readings.time
        camera = self.camera.found(self.sensors.camera)
        return FilterResult(
            self.robot,
            self.epoch,
            readings.tick,
            *said,
            camera=camera,
            compass=self.absolute.reading(self.joint, readings, self.sensors.compass),
            motion=motion,
            unsent=unsent,
        )

    def _named(self, readings: Readings, team: Joint | None, motion: Motion) -> Named:
        """Recognise landmarks by where the team, if it is plausible, or else the own belief has the robot."""
        if not self.known:
            return Named(readings)
        plausible = team is not None and self._is_plausible(team.moments(self.robot))
        expected = team if team is not None and plausible else self.joint
        return self.landmarks.named(readings, self.robot, expected, motion, self._seen(motion.dt))

    def _sightings(self, named: Named, dt: float) -> tuple[Seen, tuple[Relative, ...]]:
        """The sightings of a tick of `dt` seconds that say what they are of: of landmarks, and of all else."""
        readings = named.readings
        newest = {s.subject: s for s in sorted(readings.sightings, key=lambda s: -s.age) if not is_class(s.subject)}
        relatives = self._relatives(newest, dt, named.blurs)
        told = [(relative, newest[name].landmark) for name, relative in relatives.items()]
        told += [
            (self.sensors.relative(self.robot, sighting), sighting.landmark)
            for sighting in readings.seen
            if sighting.is_known and not is_class(sighting.subject)
        ]
        landmarks = [(relative, np.array(place)) for relative, place in told if place is not None]
        return landmarks, tuple(relative for relative, place in told if place is None)

    def _with_mishaps(self, motion: Motion, landmarks: Seen, fix: Fix | None) -> Motion:
        """The motion of a tick with the noise of wheels that turned while the robot stood."""
        told = partial(self._places_told, landmarks, fix)
        if self.known and (noise := self.mishaps.judge(self.joint, told, motion)) is not None:
            self._drive(noise)
            return replace(motion.plus(noise), before=motion.before)
        return motion

    def _take(self, readings: Readings, landmarks: Seen, motion: Motion, linear: Array | None, named: Named) -> None:
        """Take the fix, the compass and the landmarks of a tick, or begin with what they say."""
        if not self.known:
            self._start(readings)
        elif self.absolute.take(self.joint, readings, self.sensors.compass) and not landmarks:
            self.mishaps.fitted(self.joint.moments(self.robot))
        if self.absolute.doubtful:
            self.wheels.doubt()
        if self.known:
            self._sight(landmarks, motion, linear, readings.time, named)

    def _gained(self, before: Moments | None) -> Increment | None:
        """The likelihood of this tick's measurements: the belief after the tick, divided by the one `before` it. None: nothing."""
        after = self.belief
        return None if before is None or after is None else gained(before, after)

    def _unnamed(self, told: Readings, dt: float) -> tuple[Relative, ...]:
        """The sightings of a tick of `dt` seconds that name a class alone, numbered among all without a name."""
        unnamed = self.sensors.unnamed(self.robot, told, self._turned, dt)
        return tuple(self.camera.scaled(seen) if seen.kind == "range-bearing" else seen for seen in unnamed)

    def _places_told(self, seen: Seen, fix: Fix | None, joint: Joint, motions: Mapping[str, Motion]) -> list[Factor]:
        """What landmarks and the fix of a tick measure of a place, linearised at a joint."""
        factors = [linearise(joint, relative, motions, place) for relative, place in seen if relative.places]
        return factors if fix is None else [*factors, self.absolute.fix_factor(joint, fix, self.joint)]

    def _gave_up(self, readings: Readings, team: Array | None, apart: float, seen: Seen, motion: Motion) -> bool:
        """Whether the belief was given up: as absurd, or because fixes, a compass or landmarks contradict it.

        The team may believe what the robot told it. So it begins there only if the landmarks that are `seen` do not contradict that.
        """
        if self.known and _is_absurd(self.joint):
            self.restart(readings.time)
            return True
        adrift = self._adrift(readings.fix)
        contradicted = self.known and (adrift > 0 or self.absolute.contradicts(readings.time))
        if not contradicted and not self.lost():
            return False
        self._distrust(adrift)
        self.mishaps.moved = 1.0
        self._unsent.forget()
        if contradicted:
            self._reopen(self._as_told(readings))
            return True
        self.camera = CameraNoise()  # it was judged from a wrong place
        if team is not None and apart <= ABSURD:
            self._reopen(team)
            told = [linearise(self.joint, relative, {self.robot: motion}, place) for relative, place in seen]
            beyond = [self.joint.innovation(factor).squared > quantile(GATE, len(factor.residual)) for factor in told]
            if 2 * sum(beyond) <= len(beyond):
                return True
        self.restart(readings.time)
        self._start(readings)
        return True

    def _adrift(self, fix: Fix | None) -> float:
        """The speed (unit / s) at which fixes move away from the odometry; 0 where a scale or the heading may explain it."""
        if fix is None or not self.known or self.robot in self.distrust or self.untold.is_all:
            return 0.0
        speed = self.absolute.drifting.speed(fix.sigma)
        is_headed = self.joint.moments(self.robot).covariance[HEADING, HEADING] < HEADED**2
        return speed if is_headed and speed >= ADRIFT * self.speeds.usual(self.robot)[0] else 0.0

    def _distrust(self, speed: float) -> None:
        """Do not believe the odometry for now: the robot may move in any way, at its usual speed, or at this one (unit / s)."""
        self._usual = np.maximum(self.speeds.usual(self.robot), [speed, 0.0])
        if self._usual[0]:
            self.distrust.begin(self.robot)
            self.absolute.forget_noise()

    def _judge_wheels(self, at: Moments | None) -> None:
        """By the beliefs after the tick before: the own one, and the team's where it is plausible."""
        if self.wheels.least != self.sensors.least_noise(self.camera.is_judged):
            self.wheels = self._wheel_noise()
        if not self.known:
            self.wheels.give_up()
        else:
            self.wheels.judge(self.joint, at if at is not None and self._is_plausible(at) else None)

    def _widen_priors(self, time: float) -> None:
        """Replace the priors of the sensors' lasting errors that measurements contradict by wide ones (`priors`), each once.

        The wheels' scales keep theirs: the noise of wheels is a guess, and more of it, or an over-confident fix, looks like a scale.
        `time` is the team time in seconds.
        """
        if not self.known:
            return
        nuisance, block = self.sensors.wheels.nuisance, self.joint.moments(self.robot)
        entered = entering(Moments(block.mean[POSE], block.covariance[POSE, POSE]), nuisance)
        worst = contradicted(block, entered, nuisance, (FORWARD, TURN, *self.widened))
        if worst is not None:
            replace_prior(self.joint, self.joint.blocks[self.robot].start + worst.state, worst.mean, worst.variance)
            self.widened = (*self.widened, worst.state)
        has_odometry = not self.untold.is_all and self.robot not in self.distrust
        is_elsewhere = has_odometry and self.absolute.antenna.judge(self.joint)
        # Boards cannot correct the increments that were worked out with the wrong lever arm, so they begin anew with this robot.
        if is_elsewhere:
            self._begin_epoch(time)
        is_askew = has_odometry and self.absolute.compass.judge(self.joint)
        if worst is not None or is_elsewhere or is_askew:
            self.wheels.give_up()
            self.mishaps.forget()
            self._unsent.forget()

    def _begin_epoch(self, time: float) -> None:
        """A new epoch begins at a team time (s).

        Epochs are numbered by the milliseconds of team time at which they began, so that they also grow where the process
        is started again.
        """
        self.epoch = max(self.epoch + 1, round(1000 * time))
        self.travelled = Motion()

    def _wheel_noise(self) -> WheelNoise:
        """An estimate of the noise of its wheels that nothing has been learned in yet."""
        wheels = self.sensors.wheels
        return WheelNoise(self.robot, wheels.nuisance, wheels.given, self.sensors.least_noise(self.camera.is_judged))

    def _seen(self, dt: float) -> Callable[[Sighting], Relative]:
        """How a sighting of a tick of `dt` seconds is told alone."""
        return lambda sighting: self.camera.scaled(self.sensors.camera.relative(self.robot, sighting, self._turned, dt))

    def _relatives(
        self, newest: Mapping[str, Sighting], dt: float, blurs: Mapping[str, tuple[float, float]]
    ) -> dict[str, Relative]:
        """The sightings of a tick of `dt` seconds as the camera's model has them, by name; landmarks of a group share an error."""
        camera, names = self.sensors.camera, sorted(newest)
        places = {name: newest[name].landmark for name in names}
        groups = {n: camera.group(self._groups, n, place) for n, place in places.items() if place is not None}
        alike = Counter(groups.values())
        relatives = {}
        for name in names:
            group = groups.get(name, "")
            seen = camera.relative(self.robot, newest[name], self._turned, dt, group, alike[group] or 1)
            relatives[name] = self.camera.scaled(seen)
            if name in blurs:
                relatives[name] = blurred(relatives[name], *blurs[name])
        return relatives

    def found(self, team: Moments | None = None) -> dict[str, float]:
        """What was found out of its wheels and its camera, by name (`findings`); nothing where none of it is unknown.

        Of errors that last that is what the team knows, if it has told the robot's whole block: mates see them, too.
        """
        belief, jumped = self.belief, {"jumped": 1.0} if self.jumped else {}
        if belief is None:
            return {"moved": 1.0} if self.mishaps.moved else {}
        if not any(self.sensors.wheels.nuisance.sigmas):
            return jumped
        found = findings(
            team or belief, self.wheels, self.camera, self.absolute, self.mishaps, self.absolute.errors(self.joint)
        )
        return jumped | found | ({"moved": 1.0} if self.robot in self.distrust else {})

    def silent(self) -> None:
        """The evidence of the newest tick was not sent: what is gained in the next one is gained over what was known before it."""
        if self.known:
            self._unsent.silent()

    # --- lost and found -------------------------------------------------------------------------------------------------

    def lost(self) -> bool:
        """Whether landmarks have contradicted the belief for long enough: a gross inconsistency."""
        return self._misses.contradict()

    def restart(self, time: float) -> None:
        """Forget the belief: a new epoch begins at a team time (s), on new evidence alone."""
        self._begin_epoch(time)
        self.joint, self._last, self._unmeasured = Joint(), None, 0.0
        self.widened = ()
        self._groups, self._misses = {}, Misses()
        self._unsent.forget()
        self._search.forget()
        self.wheels.give_up()
        self.mishaps.forget()
        self.absolute.forget()

    def enter(self, pose: Moments) -> None:
        """Begin with a pose (x, y, heading), shape (3,) and (3, 3), as from a grid. ValueError: there is a belief already."""
        self._is_lent = bool(pose.covariance[HEADING, HEADING] >= ANYWHERE)
        self.joint.add(self.robot, entering(pose, self.sensors.wheels.nuisance))

    def _lose_heading(self, readings: Readings, at: Moments | None) -> None:
        """The heading is unknown. Take the team's pose of the tick before (`at`) if that knows it; else begin anew with odometry."""
        heading = math.inf if at is None else at.covariance[HEADING, HEADING] + self.untold.lapse.turn**2
        if at is not None and heading <= STRAYED**2 and self._squared(at.mean) <= ABSURD:
            self._reopen(at.mean)
        elif readings.odometry is not None:
            self.restart(readings.time)

    def _reopen(self, at: Array) -> None:
        """Go on, in the same epoch, from where the team believes the robot to be, but hardly trusting it.

        What is gained over a prediction is evidence whatever the prediction was, so no increment counts the team's belief.
        """
        pose = Moments(at[POSE], np.diag([REOPENED**2, REOPENED**2, REOPENED_HEADING**2]))
        self.joint, self._misses, self._unmeasured, self.widened = Joint(), Misses(), 0.0, ()
        self.wheels.give_up()
        self.mishaps.forget()
        self.absolute.forget()
        self.joint.add(self.robot, entering(pose, self.sensors.wheels.nuisance))

    def _as_told(self, readings: Readings) -> Array:
        """The own pose, shape (3,), with place and heading of the fix and the compass where there are any."""
        pose = self.joint.moments(self.robot).mean[POSE].copy()
        if readings.fix is not None:
            pose[AXES] = readings.fix.position
        for heading, _ in headings(readings, self.sensors.compass).values():
            pose[HEADING] = heading
        return pose

    # --- inside ---------------------------------------------------------------------------------------------------------

    def _move(self, readings: Readings, at: Moments | None) -> Motion:
        """Predict with the odometry, and with the unmeasured motion before it, or in place of it."""
        before, told, blind = self._last, readings.odometry, self._blind(readings, at)
        self._last, self.jumped = readings, False
        if blind != Motion():
            self.wheels.give_up()
        if told is None:
            self._drive(blind)
            return blind
        earlier = None if before is None else before.odometry
        motion = self.sensors.wheels.motion(told, earlier)
        motion = self._learning_from(motion, self.jitter.significance(told))
        scaled = self._without_jump(self.wheels.scaled(motion))
        if self.known and self.robot in self.distrust:
            scaled = self.distrust.on_motion(self.robot, scaled, motion.dt, self.sensors.wheels.nuisance, self._usual)
            self.wheels.give_up()
        motion = scaled.plus(blind)
        self._turned = max(abs(told.turn), abs(told.turn - (told if earlier is None else earlier).turn))
        heading = self._heading()
        self._drive(motion)
        if self.known:
            self.wheels.move(self.joint, scaled, heading + wrap(self._heading() - heading) / 2)
            forget_biases(self.joint, motion.dt)
        return motion

    def _without_jump(self, motion: Motion) -> Motion:
        """The same motion, or what `Speeds` makes of it if it jumps."""
        if (belief := self.belief) is None:
            return motion
        doubted = self.speeds.on_motion(self.robot, motion, motion.dt, belief.covariance)
        self.jumped = doubted is not motion
        return doubted

    def _heading(self) -> float:
        """Radians; 0 where there is no belief."""
        return float(self.joint.mean[self.joint.blocks[self.robot]][HEADING]) if self.known else 0.0

    def _blind(self, readings: Readings, at: Moments | None) -> Motion:
        """The process noise of unmeasured motion; `at` is where the team had the robot a tick ago.

        While odometry is silent a robot goes on in one direction, so sigmas add up instead of variances. What they add to is at most
        the sigma of the belief: sightings since then have told where it went.
        """
        lapse = self.untold.lapse
        if self.untold.is_all:
            return self.roaming.motion(0.0 if self._last is None else readings.time - self._last.time)
        if lapse == NOTHING:
            return Motion()
        place = heading = 0.0
        belief = (at or self.belief) if readings.odometry is None else None
        if belief is not None:
            earlier = self.untold.whole.less(lapse)
            place = min(earlier.way, math.sqrt(np.trace(belief.covariance[AXES, AXES]) / 2))
            heading = min(earlier.turn, math.sqrt(belief.covariance[HEADING, HEADING]), math.pi)
        way, turn = lapse.way * (lapse.way + 2 * place), min(math.pi, heading + lapse.turn) ** 2 - heading**2
        return Motion(along=way, across=way, heading=turn)

    def _learning_from(self, motion: Motion, share: float) -> Motion:
        """The same motion, of whose turn the scale of turns on a curve is learned from a share only.

        The rest is turned by the scale as it is known now; that the scale may be wrong counts as noise of the heading.
        """
        if (belief := self.belief) is None or share == 1.0 or not belief.covariance[CURVED_TURN, CURVED_TURN]:
            return motion
        rest = (1.0 - share) * motion.driven
        more = rest * float(belief.mean[CURVED_TURN]) / self.sensors.wheels.nuisance.turn
        unknown = rest**2 * float(belief.covariance[CURVED_TURN, CURVED_TURN])
        return replace(motion, turn=motion.turn + more, driven=motion.driven - rest, heading=motion.heading + unknown)

    def _drive(self, motion: Motion) -> None:
        """Move all that is believed."""
        self.travelled = self.travelled.plus(motion)
        for joint in self._joints():
            drive(joint, self.robot, motion, self.sensors.wheels.nuisance)
        self.absolute.move(motion)

    def _joints(self) -> list[Joint]:
        """The belief, and the one without what was not sent, as far as there are such."""
        return [joint for joint in (self.joint if self.known else None, self._unsent.joint) if joint is not None]

    def _lend(self, team: Joint | None) -> None:
        """A belief that knows neither place nor heading takes the team's pose for its mean: what is gained is gained over it."""
        if team is None or not self._is_lent:
            return
        covariance = self.joint.moments(self.robot).covariance
        self._is_lent = bool(covariance[HEADING, HEADING] > STRAYED**2)
        if not self._is_lent or self._search.is_on or covariance[X, X] < FLAT / 2:
            return
        for joint in self._joints():
            mean = joint.moments(self.robot).mean.copy()
            mean[POSE] = team.mean[POSE]
            joint.move(self.robot, mean, np.eye(STATES), np.zeros((STATES, STATES)))

    def _squared(self, at: Array) -> float:
        """The squared Mahalanobis distance of a pose from the own belief, whose variances count as at least 1."""
        belief = self.joint.moments(self.robot)
        apart = at[POSE] - belief.mean[POSE]
        apart[HEADING] = wrap(float(apart[HEADING]))
        return float(apart @ np.linalg.solve(belief.covariance[POSE, POSE] + np.eye(3), apart))

    def _is_plausible(self, at: Moments) -> bool:
        """Whether a team's belief is near to the own one, and none of its numbers absurd."""
        largest = max(np.abs(at.mean).max(), np.abs(at.covariance).max())
        return bool(largest <= ABSURD) and self._squared(at.mean) <= NEAR

    def _team_moved(self, at: Moments, motion: Motion) -> Joint:
        """Where the team's belief of a tick ago has come to."""
        moved = Joint()
        moved.add(self.robot, at)
        drive(moved, self.robot, motion, self.sensors.wheels.nuisance)
        return moved

    def _start(self, readings: Readings) -> None:
        if (pose := starting_pose(readings, self.sensors.compass)) is not None:
            self.enter(pose)
            self.absolute.begin(self.joint, readings)

    def _is_flat(self) -> bool:
        covariance = self.joint.moments(self.robot).covariance
        return bool(np.trace(covariance[AXES, AXES]) > KNOWN)

    def _sight(self, seen: Seen, motion: Motion, at: Array | None, time: float, named: Named) -> None:
        """Landmarks; what is beyond the gate is not taken, and counted, as is what is not on the map.

        What is known but roughly to be this landmark says nothing of the camera.
        """
        missed = named.strange
        for relative, place in seen:
            if not relative.places and self._is_flat():
                self._search.take(self.joint, relative, place, time)
                continue
            factor = linearise(self.joint, relative, {self.robot: motion}, place, at)
            innovation = self.joint.innovation(factor)
            if not any(named.blurs.get(relative.subject, ())):
                self.camera.judge(relative, factor, innovation, time)
            if innovation.squared > quantile(GATE, len(factor.residual)):  # a misread barcode
                missed += 1
            else:
                correct(self.joint, factor)
        if seen or named.strange:
            told = [(relative.subject, relative.kind) for relative, _ in seen]
            self._misses.on_tick([*told, *(("?", str(number)) for number in range(named.strange))], missed)
        if seen and not missed and not self._is_flat():
            self.mishaps.fitted(self.joint.moments(self.robot))
            self.absolute.fits()


def _is_absurd(joint: Joint) -> bool:
    """Whether a belief is beyond what any robot knows, as after odometry of a million units."""
    return not max(np.abs(joint.mean).max(), np.abs(joint.covariance.diagonal()).max()) <= LARGEST
