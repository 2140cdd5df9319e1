"""What is measured absolutely, a fix and a compass: a pose to begin with, and corrections of a robot in a joint.

Other people's GPS and compasses err in ways that nobody told. Two fixes in a row, less the way between them by odometry, show the
independent noise of each; two headings do so, less the turn. (Their distance from the belief would also hold errors that last.)
Where the noise is larger than claimed, it counts. Where it is surely smaller, the claimed variance of fixes stays, and the rest of it
counts as an error that lasts, as of satellites and their reflections. A reading beyond the gate moves the belief as one at the gate
does, and one that is twice as far off not at all (Hampel, JASA 69, 1974).

Where fixes err by far more than they claim, the filter takes their errors for a wrong scale of the wheels. So fixes change no scale
until their noise is known. Such a model is called cut (Plummer, Statistics and Computing 25(1), 2015).

Compass and antenna may be mounted otherwise than told (`mounts`); that is left out where the robot's model has no lasting errors.

No two measurements are equal to the last bit: a receiver that sees no satellite repeats its last fix, and many drivers publish that.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.increment import NOTHING
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.mounts import (
    Beyond,
    CompassReading,
    Mount,
    add_with_heading,
    at_most,
    compass_of,
    heading_factor,
    surely,
)
from blackboard.opinion.gaussian.relation import bias_block
from blackboard.opinion.gaussian.vehicle import (
    AXES,
    CURVED_TURN,
    CURVED_WAY,
    FLAT,
    FORWARD,
    HEADING,
    STATES,
    TURN,
    Motion,
    Nuisance,
    correct,
    drive,
    turn_ties,
    wrap,
)
from blackboard.wire.messages import Fix, Readings
from robot_agent.gaussian.drifting import Drifting
from robot_agent.gaussian.factors import NoiseFactor, NoiseFactors
from robot_agent.gaussian.mounts import Antenna

#: Seconds after which the lasting error of a fix is another one, an Ornstein-Uhlenbeck process as of receivers at rest (Sensors
#: 20(21), 6050, 2020): between what is best for errors that last 5 s and 60 s, on development seeds (docs/notes/wrong-models.md).
LASTS = 30.0
FARTHEST = 4.0  # times the squared distance of the gate: farther off, a reading says nothing


def starting_pose(readings: Readings, compass: float) -> Moments | None:
    """The pose (x, y, heading) that a fix and a compass (its sigma by the model, radians) give, its position flat without a fix.

    None without a heading.
    """
    fix, covariance = readings.fix, np.zeros((3, 3))
    if fix is not None and fix.heading is not None:
        heading, sigma = fix.heading, fix.heading_sigma
    elif readings.compass is not None:
        heading, sigma = readings.compass, readings.compass_sigma or compass
    else:
        return None
    place = (0.0, 0.0) if fix is None else fix.position
    covariance[AXES, AXES] = np.eye(2) * (FLAT if fix is None else fix.sigma**2)
    covariance[HEADING, HEADING] = sigma**2
    return Moments(np.array([*place, heading]), covariance)


def place_factor(joint: Joint, robot: Block, fix: Fix, variance: float = 1.0, lasting: float = 0.0) -> Factor:
    """A fix as a measurement of a robot's block; `variance` is independent, `lasting` lasts, both relative to the claimed variance."""
    belief, rows = joint.moments(robot), np.eye(STATES)[AXES]
    off, noise = np.array(fix.position) - belief.mean[AXES], np.eye(2) * fix.sigma**2 * variance
    variances, ties = belief.covariance.diagonal(), belief.covariance[AXES, HEADING]
    # Where place and heading are not correlated, the fix has no information on the heading.
    of_place = bool(ties @ ties <= NOTHING * variances[AXES].sum() * variances[HEADING])
    if not lasting:
        return Factor(off, {robot: rows}, noise, of_place=of_place)
    error = bias_block(str(robot), "fix", LASTS)
    known = joint.moments(error).mean if error in joint else np.zeros(2)
    by = np.eye(2) * fix.sigma * math.sqrt(lasting)
    unknown = Moments(np.zeros(2), np.eye(2))
    return Factor(off - by @ known, {robot: rows, error: by}, noise, {error: unknown}, of_place=of_place)


def headings(readings: Readings, compass: float) -> dict[str, tuple[float, float]]:
    """Headings and sigmas (rad) that the readings hold, of the compass (its sigma by the model) and of the fix."""
    told, fix = {}, readings.fix
    if readings.compass is not None:
        told["compass"] = readings.compass, readings.compass_sigma or compass
    if fix is not None and fix.heading is not None:
        told["fix heading"] = fix.heading, fix.heading_sigma
    return told


def take_absolute(joint: Joint, robot: Block, readings: Readings, compass: float) -> None:
    """Correct a robot's block by the fix and by the compass (its sigma by the model, radians), as they claim to be."""
    if readings.fix is not None:
        correct(joint, place_factor(joint, robot, readings.fix))
    for heading, sigma in headings(readings, compass).values():
        correct(joint, heading_factor(joint, robot, heading, sigma))


@dataclass
class AbsoluteSensors:
    """Mutable: fixes and compass of a robot, as far as they can be believed. `move` with each motion, then `take` the readings."""

    robot: str
    nuisance: Nuisance
    fix: NoiseFactor = field(default_factory=NoiseFactor)  # of the independent noise of fixes
    headings: dict[str, NoiseFactor] = field(default_factory=dict)  # of the noise of headings: "compass", "fix heading"
    drifting: Drifting = field(default_factory=Drifting)
    _factors: dict[str, NoiseFactors] = field(default_factory=dict)
    antenna: Antenna = field(init=False)
    compass: Mount = field(init=False)
    _newest: Fix | None = None
    _headed: float = 0.0  # radians: the robot's heading at the newest fix
    _since: Joint | None = None  # the robot's motion since the newest fix, by odometry
    # By sensor, the newest heading, moved on by odometry since, and its claimed variance (rad^2).
    _newest_headings: dict[str, tuple[Joint, float]] = field(default_factory=dict)
    _beyond: dict[str, Beyond] = field(default_factory=dict)  # by sensor

    def __post_init__(self) -> None:
        self.antenna, self.compass = Antenna(self.robot), compass_of(self.robot)

    @property
    def lasting(self) -> float:
        """The share of a fix's claimed variance that counts as a lasting error."""
        return max(0.0, 1.0 - surely(*self.fix.log))

    @property
    def doubtful(self) -> bool:
        """Whether the newest fix was beyond the gate."""
        return "fix" in self._beyond

    @property
    def _is_noise_known(self) -> bool:
        """Whether the independent noise of fixes is known, to a factor of 3 of its sigma."""
        return self.fix.is_judged and self.fix.sigma <= math.log2(3)

    def begin(self, joint: Joint, readings: Readings) -> None:
        """The belief begins with these readings."""
        self._newest = readings.fix
        by_compass = readings.fix is None or readings.fix.heading is None
        if by_compass and self._is_open and readings.compass is not None:
            add_with_heading(joint, self.compass, self.compass.prior(), -1.0)

    def forget(self) -> None:
        """The belief was given up: the next fix is not compared with the one before."""
        self._newest, self._since = None, None
        self._newest_headings.clear()
        self._beyond.clear()
        self.drifting.forget()

    def fits(self) -> None:
        """Landmarks fit the belief, so readings beyond the gate do not speak against it."""
        self._beyond.clear()

    def errors(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """The mounting errors of antenna and compass that were found, each with its sigma, by name."""
        return self.antenna.errors(joint) | self.compass.errors(joint)

    def contradicts(self, time: float) -> bool:
        """Whether, at a team time (s), readings of a sensor have been beyond the gate for long: the belief counts as wrong."""
        return any(replace(beyond, until=time).is_lasting for beyond in self._beyond.values())

    def move(self, motion: Motion) -> None:
        """Move on from the newest fix and headings by odometry."""
        for since in (self._since, *(turned for turned, _ in self._newest_headings.values())):
            if since is not None:
                drive(since, self.robot, motion, self.nuisance)

    def without_repeated(self, readings: Readings) -> Readings:
        """The readings without their fix, if that equals the one before: the receiver repeats it."""
        fix, last = readings.fix, self._newest
        is_again = fix is not None and last is not None and (fix.position, fix.heading) == (last.position, last.heading)
        return readings.model_copy(update={"fix": None}) if is_again else readings

    def fix_factor(self, joint: Joint, fix: Fix, belief: Joint) -> Factor:
        """A fix as a measurement, linearised at a joint, with the noise that was found and the lever arm of the robot's `belief`."""
        factor = place_factor(joint, self.robot, fix, surely(*self.fix.log), self.lasting)
        return self.antenna.measured(joint, factor, self.antenna.known(belief)) if self._is_open else factor

    def take(self, joint: Joint, readings: Readings, compass: float) -> bool:
        """Correct the robot by the fix and by the compass (its sigma by the model, radians), but for what is far beyond the gate.

        A compass that may be askew is taken before (`on_compass`). Whether there is a fix that is not beyond the gate.
        """
        if (fix := readings.fix) is not None:
            self._judge(joint, fix, readings.time)
            self.antenna.on_noise(joint, surely(*self.fix.log), at_most(*self.fix.log))
            before = joint.moments(self.robot)
            self._correct(joint, "fix", self.fix_factor(joint, fix, joint), readings.time)
            if not self._is_noise_known:
                _unlearn_scales(joint, self.robot, before)
        for name, (heading, sigma) in headings(readings, compass).items():
            if name != "compass" or not self._is_open:
                factor = heading_factor(joint, self.robot, heading, sigma)
                self._take_heading(joint, name, heading, factor, readings.time)
        return fix is not None and not self.doubtful

    def reading(self, joint: Joint, readings: Readings, compass: float) -> CompassReading | None:
        """What a compass that may be askew reads, within a turn, with what is known of it; `compass` is its sigma by the model (rad).

        None: there is no reading, or it says nothing.
        """
        sigma = readings.compass_sigma or compass
        if readings.compass is None or not self._is_open or sigma > math.pi:
            return None
        log = self.headings.setdefault("compass", NoiseFactor()).log
        noise, most = (math.sqrt(max(1.0, factor)) for factor in (surely(*log), at_most(*log)))
        bias, tie = next(iter(self.compass.errors(joint).values()), (0.0, 0.0)), 0.0
        if self.compass.block in joint:
            of_heading = joint.regression(joint.blocks[self.compass.block].start)
            tie = float(of_heading[joint.blocks[self.robot]][HEADING])
        return CompassReading(wrap(readings.compass), sigma, noise, most, *bias, tie)

    def on_compass(self, joint: Joint, reading: CompassReading, time: float, others: Collection[Joint] = ()) -> None:
        """Correct the robot by a compass that may be askew, at a team time (s); `others` know nothing of its error."""
        claimed = heading_factor(joint, self.robot, reading.heading, reading.sigma)
        known = self.compass.known(joint)
        self._take_heading(joint, "compass", reading.heading, self.compass.with_errors(claimed, np.eye(1), known), time)
        log = self.headings["compass"].log
        self.compass.on_noise(joint, max(1.0, surely(*log)), at_most(*log))
        sigma = math.sqrt(reading.variance + float(known.covariance[0, 0]))
        for other in others if "compass" not in self._beyond else ():
            correct(other, heading_factor(other, self.robot, reading.heading - float(known.mean[0]), sigma))

    def _take_heading(self, joint: Joint, name: str, read: float, claimed: Factor, time: float) -> None:
        """Take a heading (rad) with the noise that it claims or, if that is larger, with the noise that it is found to have."""
        noise = self.headings.setdefault(name, NoiseFactor())
        self._judge_heading(joint, name, read, float(claimed.noise[0, 0]))
        self._correct(joint, name, claimed.widened(max(1.0, surely(*noise.log))), time)

    @property
    def _is_open(self) -> bool:
        """Whether the robot's model has lasting errors that are not known."""
        return any(self.nuisance.sigmas)

    def _factors_of(self, name: str, noise: NoiseFactor) -> NoiseFactors:
        if name not in self._factors:
            self._factors[name] = NoiseFactors((noise,), wild=True)
        return self._factors[name]

    def forget_noise(self) -> None:
        """Forget what was learned of the noise of fixes, because the odometry that it was learned by was wrong."""
        self.fix = NoiseFactor()
        self._factors.pop("fix", None)

    def _judge(self, joint: Joint, fix: Fix, time: float) -> None:
        """Weigh the noise of fixes by the distance between two in a row, less the way between them by odometry."""
        belief = joint.moments(self.robot)
        if self._newest is not None and self._since is not None:
            led = self._since.moments(self.robot)
            swung = self.antenna.swung(joint, self._headed, float(led.mean[HEADING]))
            error = np.array(fix.position) - np.array(self._newest.position) - led.mean[AXES] - swung.mean
            self.drifting.on_error(time, error)
            fresh = np.eye(2) * (fix.sigma**2 + self._newest.sigma**2)
            self._factors_of("fix", self.fix).weigh(
                error, led.covariance[AXES, AXES] + swung.covariance, fresh[np.newaxis]
            )
        self._headed = float(belief.mean[HEADING])
        self._newest, self._since = fix, Joint.of({self.robot: _beginning(belief, AXES)})

    def _judge_heading(self, joint: Joint, name: str, read: float, variance: float) -> None:
        """Weigh the noise of headings by the difference (rad) of two in a row, less the turn between them by odometry."""
        if name in self._newest_headings:
            since, before = self._newest_headings[name]
            led, spread = since.moments(self.robot).of(HEADING)
            fresh = np.array([[[variance + before]]])
            self._factors_of(name, self.headings[name]).weigh(np.array([wrap(read - led)]), np.array([[spread]]), fresh)
        here = _beginning(joint.moments(self.robot), HEADING)
        here.mean[HEADING] = read
        self._newest_headings[name] = Joint.of({self.robot: here}), variance

    def _correct(self, joint: Joint, name: str, factor: Factor, time: float) -> None:
        """Take a reading at a team time (s), with as much noise as brings it to the gate."""
        expected = joint.expected(factor)
        innovation = expected.innovation(factor)
        beyond = innovation.squared / quantile(GATE, len(factor.residual))
        if beyond <= 1.0:
            self._beyond.pop(name, None)
        else:
            self._beyond[name] = self._beyond[name].plus(time) if name in self._beyond else Beyond(time, time)
            factor = replace(factor, noise=beyond * innovation.covariance - expected.spread)
        if beyond <= FARTHEST:
            correct(joint, factor)


def _beginning(belief: Moments, at: int | slice) -> Moments:
    """What is believed of a robot, with these states known to be 0; shape (12,) and (12, 12)."""
    here = Moments(belief.mean.copy(), belief.covariance.copy())
    here.mean[at] = 0.0
    here.covariance[at] = here.covariance[:, at] = 0.0
    return here


def _unlearn_scales(joint: Joint, robot: Block, before: Moments) -> None:
    """Give the scales of a robot's wheels the moments that they had `before`, shape (12,) and (12, 12); all else follows."""
    scales = [state for state in (FORWARD, TURN, CURVED_WAY, CURVED_TURN) if before.covariance[state, state]]
    known = Moments(before.mean[scales], before.covariance[np.ix_(scales, scales)])
    first = joint.blocks[robot].start
    turn_ties(joint, joint.restore([first + state for state in scales], known))
