"""How noisy a robot's wheels are, by spans of motion: where did what was seen meanwhile lead it, against odometry alone? Pure.

With P the covariance by odometry alone and P' that of the belief afterwards, a correction d along an axis of both is worth a
measurement d / (1 - P' / P) of variance P P' / (P - P'). Short spans show jitter soon, and long ones an error that is alike for
seconds.

An `OwnSpan` asks the robot's own filter, which holds the sum of the fresh noise as states beside the robot. So it also knows that
an error of a landmark's range was the same at the beginning of the span. A `BeliefSpan` has a belief of the pose at both ends, as
the team's. Such errors are not told there: where they are large, noise looks smaller than it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, POSE, STATES, Motion, Nuisance, drive_alike, wrap
from blackboard.opinion.grid import Array
from robot_agent.gaussian.factors import NoiseFactor, NoiseFactors

LONGEST = 64.0  # seconds of motion after which a span is begun anew: too little was seen
INFORMED = 0.1  # share by which what was seen moves a belief from where odometry led it, at least
TINY = 1e-9  # a share of odometry's variances; and unit^2 or radians^2: no measurement is more exact
KINDS = ("along", "across", "heading")  # of the fresh noise of a motion


class _Measured(NamedTuple):
    """What was seen in a span as one measurement of n directions of 3 states: `rows` (n, 3), its `error` (n,) and `noise` (n, n)."""

    rows: Array
    error: Array
    noise: Array


def _measured(apart: Array, before: Array, after: Array) -> _Measured:
    """The measurement that moves a mean by `apart`, (3,), and leads from one covariance, (3, 3), to another, where it informs."""
    whiten = np.linalg.inv(np.linalg.cholesky(before + np.eye(3) * TINY))
    left, axes = np.linalg.eigh(whiten @ after @ whiten.T)
    gain = 1.0 - left
    rows, gain = (axes.T @ whiten)[gain > INFORMED], gain[gain > INFORMED]
    return _Measured(rows, rows @ apart / gain, np.diag(1.0 / gain - 1.0 + TINY))


@dataclass
class Span:
    """Mutable: some seconds of motion, after which the wheels are judged, and the factors that such spans show, by kind of noise."""

    robot: str
    seconds: float  # of motion, at least
    given: tuple[bool, bool, bool] = (True, True, True)  # as `WheelNoise.given`
    least: tuple[float, float] = (1.0, 1.0)  # as `WheelNoise.least`
    kinds: dict[str, NoiseFactor] = field(init=False)
    _together: NoiseFactors = field(init=False)  # along and heading
    _aside: NoiseFactors | None = None  # across
    _moving: float = 0.0  # seconds of motion in the span
    _doubted: bool = False  # whether a fix in it was beyond the gate

    def __post_init__(self) -> None:
        along, heading, across = self.given
        self.kinds = {"along": NoiseFactor(self.least[0], along), "heading": NoiseFactor(self.least[1], heading)}
        self._together = NoiseFactors(tuple(self.kinds.values()))
        if not across:
            self.kinds["across"] = NoiseFactor(1.0)
            self._aside = NoiseFactors((self.kinds["across"],), wild=True)

    def give_up(self) -> None:
        """Judge nothing of this span."""
        raise NotImplementedError

    def doubt(self) -> None:
        """A fix was beyond the gate, so this span says nothing of noise across the way."""
        self._doubted = True

    def _weigh(self, seen: _Measured, led: Array, made: Mapping[str, Array], noise: Mapping[str, float]) -> None:
        """Take what was seen of states whose covariance by odometry alone is `led`, (3, 3).

        `made` is the part of it that noise as large as the model's makes, (3, 3), by kind; `noise` are the factors of the variances
        that the span was led with.
        """
        self._weigh_some(self._together, ("along", "heading"), seen, led, made, noise)
        if self._aside is not None and not self._doubted:
            self._weigh_some(self._aside, ("across",), seen, led, made, noise)

    def _weigh_some(
        self,
        factors: NoiseFactors,
        kinds: Sequence[str],
        seen: _Measured,
        led: Array,
        made: Mapping[str, Array],
        noise: Mapping[str, float],
    ) -> None:
        """Weigh the factors of some kinds; the noise of the others is taken for what was found.

        A large error of the heading adds to the covariance more than in proportion, so the difference `rest` may have a negative
        eigenvalue. That is set to 0: it would give one factor all the weight.
        """
        own = np.array([made[kind] for kind in kinds])
        rest = led - np.tensordot([noise[kind] for kind in kinds], own, 1)
        variances, axes = np.linalg.eigh(rest)
        if variances[0] < 0:
            rest = (axes * np.maximum(variances, 0.0)) @ axes.T
        added = np.array([seen.rows @ unit @ seen.rows.T for unit in own])
        factors.weigh(seen.error, seen.rows @ rest @ seen.rows.T + seen.noise, added)


@dataclass
class OwnSpan(Span):
    """Mutable: by the robot's own filter, which keeps the sums of the noise by kind, unit and radians, as a block."""

    _joint: Joint | None = None  # that has the block
    #: Variances of the sums by odometry alone, by kind: with the noise that was found, and with the model's.
    _led: Array = field(default_factory=lambda: np.zeros(3))
    _model: Array = field(default_factory=lambda: np.zeros(3))

    def give_up(self) -> None:
        """Judge nothing of this span."""
        self._joint = None

    @property
    def block(self) -> tuple[str, float]:
        """The name of the sums in the filter's joint."""
        return ("noise", self.seconds)

    def judge(self, joint: Joint, noise: Mapping[str, float]) -> None:
        """Take what the filter has seen; `noise` are the factors of the variances that the span was led with, by kind."""
        if self._joint is not joint or self._moving > LONGEST:
            self._begin(joint)
        elif self._moving >= self.seconds:
            sums = joint.moments(self.block)
            seen = _measured(sums.mean, np.diag(self._led), sums.covariance)
            if len(seen.rows):
                made = {kind: np.diag(self._model * (np.array(KINDS) == kind)) for kind in self.kinds}
                self._weigh(seen, np.diag(self._led), made, noise)
                self._begin(joint)

    def move(self, joint: Joint, motion: Motion, angle: float, noise: Mapping[str, float]) -> None:
        """The robot has been driven, in a direction (radians), by a motion with the noise that was found."""
        if self._joint is joint:
            c, s = np.cos(angle), np.sin(angle)
            by = np.zeros((STATES, 3))
            by[POSE] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
            added = np.array([motion.along, motion.across, motion.heading])
            joint.keep(self.robot, by, np.diag(added), self.block)
            self._led = self._led + added
            self._model = self._model + added / [noise.get(kind, 1.0) for kind in KINDS]
            self._moving += motion.moving

    def _begin(self, joint: Joint) -> None:
        if self.block in joint:
            joint.drop(self.block)
        joint.add(self.block, Moments(np.zeros(3), np.zeros((3, 3))))
        self._joint, self._moving, self._doubted = joint, 0.0, False
        self._led, self._model = np.zeros(3), np.zeros(3)


@dataclass
class BeliefSpan(Span):
    """Mutable: by a belief of the robot's whole block at both ends of the span, the robot's own or its team's."""

    nuisance: Nuisance = field(default_factory=Nuisance)
    _led: Joint | None = None  # the robot's block since the span began, by odometry alone
    _without: dict[str, Joint] = field(default_factory=dict)  # the same without the noise of a kind
    _by_team: bool = False  # whether the span began with the team's belief

    def give_up(self) -> None:
        """Judge nothing of this span."""
        self._led = None

    def judge(self, belief: Moments, noise: Mapping[str, float], *, by_team: bool) -> None:
        """Take a belief; `noise` are the factors of the variances that the span was led with, by kind.

        A span that began with the team's belief is judged by the team's only, because a robot alone knows less.
        """
        if self._led is None or self._moving > LONGEST:
            self._begin(belief, by_team)
        elif self._moving >= self.seconds and by_team >= self._by_team:
            led, informed = self._led.moments(self.robot), False
            made = {}  # kind -> covariance of the pose that noise as large as the model's makes
            for kind, joint in self._without.items():
                without = joint.moments(self.robot)
                axis = np.zeros(len(led.mean))
                if kind == "heading":
                    axis[HEADING] = 1.0
                else:
                    axis[AXES] = np.linalg.eigh((led.covariance - without.covariance)[AXES, AXES])[1][:, -1]
                by_odometry, rest, after = (
                    float(axis @ moments.covariance @ axis) for moments in (led, without, belief)
                )
                informed |= by_odometry > rest and 1.0 - after / by_odometry > INFORMED
                made[kind] = (led.covariance - without.covariance)[POSE, POSE] / noise[kind]
            if informed:
                apart = (belief.mean - led.mean)[POSE]
                apart[HEADING] = wrap(float(apart[HEADING]))
                seen = _measured(apart, led.covariance[POSE, POSE], belief.covariance[POSE, POSE])
                self._weigh(seen, led.covariance[POSE, POSE], made, noise)
                self._begin(belief, by_team)

    def move(self, motion: Motion, without: Mapping[str, Motion]) -> None:
        """Lead the span on by a motion with the noise that was found, and by the same without the noise of each kind."""
        if self._led is not None:
            others = [(joint, without[kind]) for kind, joint in self._without.items()]
            drive_alike([(self._led, motion), *others], self.robot, self.nuisance)
            self._moving += motion.moving

    def _begin(self, belief: Moments, by_team: bool) -> None:
        self._led, self._moving, self._by_team, self._doubted = Joint(), 0.0, by_team, False
        self._without = {kind: Joint() for kind in self.kinds}
        for joint in (self._led, *self._without.values()):
            joint.add(self.robot, belief)
