"""A robot that has a filter of its own: what its posteriors gained over their predictions is evidence. Pure.

The posterior before and the odometry make a prediction; the posterior over that is the likelihood of what the robot's own filter took
in between. So what the team gets of it is counted once, however the filter works. What came from the team must not be in it: it
would be counted again with each posterior. `Independence` notices that, because then what was gained says what the team believed.
"""

import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, MEDIAN, quantile
from blackboard.opinion.gaussian.increment import Increment, along_axes, likelihood
from blackboard.opinion.gaussian.joint import Block, Joint, Moments, squared_distance
from blackboard.opinion.gaussian.mounts import surely
from blackboard.opinion.gaussian.vehicle import HEADING, POSE, Motion, Nuisance, drive, entering, wrap
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Odometry, Readings
from robot_agent.gaussian.factors import NoiseFactor, NoiseFactors
from robot_agent.gaussian.filter import FilterResult, FirstHand
from robot_agent.gaussian.landmarks import Named

WINDOW = 60  # gains that are remembered
FEWEST = 20  # gains before anything is said of them
ALIKE = 0.05  # of the median squared distance to be expected: nearer to the team's belief is no measurement, but that belief
WEIGHTY = 0.05  # share of the team's variance that a gain removes, at least; of smaller ones the distance says nothing
SLIGHT = 1e-3  # share of a variance that is too little to be a gain
ROUNDING = 1e-9  # of the largest entry of a covariance
FLOAT = 1e-13  # of the largest entry of a covariance that was computed here: 64-bit rounding
JUMP = 2.0  # times the 99.9 % quantile: a posterior so far from its prediction begins anew
FLATTEST = 1.8  # kurtosis along an axis of a uniform distribution: particles below have several hypotheses


@dataclass
class Independence:
    """Mutable: how far what was gained is from what the team believed, over what is to be expected of independent evidence.

    `ratio` is the median of the squared distances over that of chi-squared. With true covariances it is at most about 1, because the
    nearer of two distances counts: good filters had .14 to .68. Where sensors err by more than their filter knows it is larger (1.9,
    2.6). Where all covariances are 4 or 16 times too small it was .02 to .21: the team then believes little else. None until enough
    was gained.
    """

    gains: int = 0
    # The factor by which posteriors move farther than their variances allow.
    shift: NoiseFactor = field(default_factory=NoiseFactor)
    _ratios: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))
    _shifts: NoiseFactors = field(init=False)

    def __post_init__(self) -> None:
        self._shifts = NoiseFactors((self.shift,))

    @property
    def ratio(self) -> float | None:
        return statistics.median(self._ratios) if len(self._ratios) >= FEWEST else None

    @property
    def fed_back(self) -> bool:
        """Whether what the team believed comes back as evidence; none is taken then."""
        return self.ratio is not None and self.ratio < ALIKE

    @property
    def too_small(self) -> float:
        """The factor by which the filter's variances are surely too small; 1: they are not."""
        return max(1.0, surely(*self.shift.log))

    def on_posterior(self, prediction: Moments, posterior: Moments) -> None:
        """Take by how far a posterior is from its prediction, both of a robot's block.

        Along an axis in which the variance falls by v, the mean moves by N(0, v) if the filter's variances are right.
        """
        _, moved, gain = along_axes(prediction, posterior, WEIGHTY / (1 - WEIGHTY))
        for error in moved * np.sqrt((1 + gain) / gain):
            self._shifts.weigh(np.array([error]), np.zeros((1, 1)), np.ones((1, 1, 1)))

    def judge(self, robot: Block, gain: Increment, shown: Moments, moved: Moments) -> None:
        """Take a gain against what the robot was shown last of the team's belief, and the same moved on to now; blocks of 9 states.

        The nearer one counts, because nobody knows whether who takes it for a measurement moves it on.
        """
        joint = Joint()
        joint.add(robot, moved)
        factor = likelihood(joint, robot, gain)
        if factor is None:
            return
        innovation = joint.innovation(factor)
        removed = 1.0 - float(np.trace(np.linalg.solve(innovation.covariance, factor.noise))) / innovation.freedom
        if removed < WEIGHTY:
            return
        apart = moved.mean - shown.mean
        apart[HEADING] = wrap(float(apart[HEADING]))
        before = innovation.residual + factor.jacobians[robot] @ apart
        squared = min(innovation.squared, squared_distance(before, innovation.covariance))
        self.gains += 1
        self._ratios.append(squared / quantile(MEDIAN, innovation.freedom))


@dataclass
class Given(FirstHand):
    """Mutable; `give` a posterior before the `step` of its tick. Fixes, compass and landmarks of readings are the own filter's."""

    posterior: Moments | None = None  # (x, y, heading), shape (3,) and (3, 3)
    #: What of the step's odometry was driven after the posterior. It comes between two steps.
    after: Odometry | None = None
    independence: Independence = field(default_factory=Independence)
    #: Of the noise: along and across the way, of the heading, per second.
    _rates: tuple[float, float, float] | None = None
    gain: Increment | None = None  # of the newest posterior, whether it is sent or not
    _newest: Moments | None = None  # the last posterior, of an earlier step
    _since: Motion = field(default_factory=Motion)  # the motion since then, with the variances that the team was told
    _idle: bool = False  # whether the newest posterior took nothing in

    def give(self, posterior: Moments | None, after: Odometry | None = None) -> None:
        """Take a posterior for the next step; None: it has none now, as while there are several hypotheses.

        `after`: what of the step's odometry the robot drove after it.
        """
        self.posterior, self.after = posterior, after

    def step(self, readings: Readings, at: Moments | None = None) -> FilterResult:
        if self.epoch < 0:
            self.restart(readings.time)
        given = self.posterior
        if given is not None and self.after is not None:
            given = self._moved(given, self._noisy(self.after, None))
        self.posterior = self.after = None
        self.untold = self.untold.after(readings)
        motion = self._motion(readings, given, at)
        prediction = self.belief
        if given is not None and prediction is not None and _has_jumped(prediction, given):
            self.restart(readings.time)
            motion, prediction, self._last, self._newest = Motion(), None, readings, None
        self._unsent.predict(prediction)
        if given is not None:
            self.joint = Joint()
            self.joint.add(self.robot, entering(given, Nuisance()))
            self._newest, self._since = given, Motion()
        self.gain = self._gained(prediction)
        if self.gain is not None and prediction is not None and self.belief is not None:
            self.independence.on_posterior(prediction, self.belief)
        told_of = not self.independence.fed_back
        increment, unsent = (self.gain, self._gained(self._unsent.before)) if told_of else (None, None)
        increment, unsent = (self._widened(one) for one in (increment, unsent))
        _, others = self._sightings(Named(readings), motion.dt)
        others += self._unnamed(readings, motion.dt)
        said = self.travelled, self.sensors.wheels.nuisance, self.belief, increment, others, readings.time
        return FilterResult(self.robot, self.epoch, readings.tick, *said, motion=motion, unsent=unsent)

    def _widened(self, gain: Increment | None) -> Increment | None:
        """A gain with its information divided by the factor by which the filter's variances are too small."""
        if gain is None:
            return None
        share = 1.0 / self.independence.too_small
        return replace(gain, information=share * gain.information, vector=share * gain.vector)

    def enter(self, pose: Moments) -> None:
        """A pose from a grid is of no use: the own filter knows better."""

    def _gained(self, before: Moments | None) -> Increment | None:
        return None if self._idle else super()._gained(before)

    def _motion(self, readings: Readings, given: Moments | None, at: Moments | None) -> Motion:
        """Predict with the odometry. Its noise is the own filter's, as far as the caller or earlier posteriors have told it.

        A posterior that is nowhere sharper than the one before, moved on without noise, took nothing in: what it lost is the noise
        of the way since then, of which some has been told in steps without a posterior.
        Where the noise is told, it is moved on with that, because a filter that takes something in at each step loses as much.
        """
        told, before, self._last = readings.odometry, self._last, readings
        self._idle = False
        if told is None:
            motion = self._blind(readings, at)
            self._drive(motion)
            return motion
        motion = self._noisy(told, None if before is None else before.odometry)
        self._turned = abs(told.turn)
        if self._newest is not None and given is not None:
            whole, spent = self._since.then(motion), self._since
            still = replace(whole, along=0.0, across=0.0, heading=0.0)
            is_told = told.distance_sigma is not None and told.turn_sigma is not None
            self._idle = not _is_sharper(given, self._moved(self._newest, whole if is_told else still))
            if self._idle:
                lost = _lost(self._moved(self._newest, still), still.turn, given)
                along, across, heading = np.maximum(lost - (spent.along, spent.across, spent.heading), 0.0).tolist()
                motion = replace(motion, along=along, across=across, heading=heading)
                if whole.way or whole.turn:
                    along, across, heading = (np.maximum(lost, 0.0) / whole.dt).tolist()
                    self._rates = along, across, heading
        self._since = self._since.then(motion)
        self.travelled = self.travelled.plus(motion)
        for joint in self._joints():
            drive(joint, self.robot, motion, self.sensors.wheels.nuisance, bent=False)
        return motion

    def _noisy(self, told: Odometry, before: Odometry | None) -> Motion:
        """Odometry as a motion. Its noise is what it says itself, else what was learned of the own filter, else the wheels' model."""
        motion = self.sensors.wheels.motion(told, before)
        if self._rates is None or told.distance_sigma is not None or told.turn_sigma is not None:
            return motion
        along, across, heading = (rate * told.dt for rate in self._rates)
        return replace(motion, along=along, across=across, heading=heading)

    def _moved(self, posterior: Moments, motion: Motion) -> Moments:
        """A posterior (x, y, heading), predicted over a motion."""
        ahead = Joint()
        ahead.add(self.robot, entering(posterior, Nuisance()))
        drive(ahead, self.robot, motion, self.sensors.wheels.nuisance, bent=False)
        moments = ahead.moments(self.robot)
        return Moments(moments.mean[POSE], moments.covariance[POSE, POSE])


def _lost(prediction: Moments, turn: float, given: Moments) -> Array:
    """By how much a posterior's variances exceed those of its prediction: along and across the way, and of the heading.

    `turn` (rad) is that of the way. What a badly known heading adds in a filter that is not linear counts as noise of the way.
    """
    way = float(prediction.mean[HEADING]) - turn / 2
    c, s = np.cos(way), np.sin(way)
    frame = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.diag(frame @ (given.covariance - prediction.covariance) @ frame.T)


def _is_sharper(given: Moments, prediction: Moments) -> bool:
    """Whether a posterior is anywhere sharper than its prediction, by more than the filters may differ by rounding."""
    slack = ROUNDING * np.abs(given.covariance).max() + FLOAT * np.abs(prediction.covariance).max()
    scale = np.linalg.cholesky(prediction.covariance + slack * np.eye(3))
    share = np.linalg.solve(scale, np.linalg.solve(scale, given.covariance).T)
    return bool(np.linalg.eigvalsh(share)[0] < 1.0 - SLIGHT)


def _has_jumped(prediction: Moments, given: Moments) -> bool:
    """Whether a posterior is so far from its prediction that no evidence led there: its filter has begun anew."""
    apart = given.mean - prediction.mean[POSE]
    apart[HEADING] = wrap(float(apart[HEADING]))
    squared = float(apart @ np.linalg.solve(prediction.covariance[POSE, POSE] + 1e-12 * np.eye(3), apart))
    return squared > JUMP * quantile(GATE, 3)


def of_particles(particles: Array, weights: Sequence[float] | Array | None = None) -> Moments | None:
    """Mean and covariance of particles (x, y, heading), shape (N, 3); None where they have several hypotheses.

    Along no axis may they be spread more evenly than a uniform distribution, as two clusters are.
    """
    share = np.full(len(particles), 1.0 / len(particles)) if weights is None else np.asarray(weights) / np.sum(weights)
    middle = float(np.angle(share @ np.exp(1j * particles[:, 2])))
    turned = wrap(particles[:, 2] - middle)
    points = np.column_stack([particles[:, :2], turned])
    mean = share @ points
    away = points - mean
    covariance = (away * share[:, None]).T @ away
    sizes, axes = np.linalg.eigh(covariance)
    along = away @ axes
    wide = sizes > 1e-12 * max(float(sizes.max()), 1e-12)
    kurtosis = (share @ along**4)[wide] / sizes[wide] ** 2
    if (kurtosis < FLATTEST).any():
        return None
    mean[2] = wrap(float(mean[2] + middle))
    return Moments(mean, covariance + 1e-12 * np.eye(3))
