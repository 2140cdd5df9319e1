"""How large the noise of wheels and camera is, estimated on line, larger or smaller than the model says. Pure.

Each kind of noise has a factor s of its sigma. Its logarithm has a mean and a sigma over a grid, by the likelihood of what was seen
and a log-normal prior. Where somebody gave the model, s is the median: the prior holds back what may be luck. Where the model is a
guess, s^2 is its expected value, so that doubt counts as noise. Errors that follow each other are alike and look smaller than they
are. So few sightings are judged: one of each landmark in `ALIKE` seconds. A fix or a compass may claim to be far better than it is,
so there the prior is Student's t.

The wheels are judged by spans of motion: where did what was seen meanwhile put the robot, compared with odometry alone? With P the
covariance of the pose by odometry alone and P' that of the belief afterwards, a correction d along an axis of both is worth a
measurement d / (1 - P' / P) of variance P P' / (P - P'). Short spans show jitter soon, and long ones an error that is alike for
seconds: the larger counts, by what is sure of it to one sigma.

The camera's is judged by landmarks only. The wheels' has a lower bound (`Sensors.least_noise`), because what is alike over minutes
looks small over a span, and what the whole team shares looks small to all of them. Wheels that nobody described guess the noise
along the way only: a heading that is believed too well turns the whole team, and without landmarks nobody sees it.

Noise across the way is found only of a robot that nobody described at all: it may be a boat, or skid. The prior is Student's t, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.cameras import CameraFound, scaled
from blackboard.opinion.gaussian.joint import Factor, Innovation, Joint, Moments
from blackboard.opinion.gaussian.relation import QUARTER, Relative
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, POSE, RANGE, Motion, Nuisance, drive_alike, wrap
from blackboard.opinion.grid import Array
from robot_agent.gaussian.sensors import Camera

ALIKE = 8.0  # seconds in which the errors of the sightings of one landmark are alike
#: As how many times its sigma a reading counts whose error lasts seconds. The mean of n readings a second apart, with
#: correlations of .76, .66, .57, .. (measured of a camera's ranges), errs 1.75 (n = 4) to 2.26 (n = 8) times as much as of
#: independent ones.
COUNTED = 2.0
#: Seconds of motion, at least: a jitter shows soon, and an error that lasts for seconds in long spans only.
SPANS = (1.0, 4.0, 16.0)
LONGEST = 64.0  # seconds of motion after which a span is begun anew: too little was seen
INFORMED = 0.1  # share by which what was seen moves a pose from where odometry led it, at least
TINY = 1e-9  # a share of odometry's variances; and unit^2 or radians^2: no measurement is more exact
MEMORY = 40.0  # samples after which what was seen has faded to 1 / e
LOGS = np.arange(-3.0, 3.01, 0.25)  # binary logarithms of s
CLAIMED_LOGS = np.arange(-3.0, 10.01, 0.25)  # where the model is only claimed
TAILS = 2.0  # degrees of freedom of a claim's prior, Student's t: a factor of 300 is 5 nats less likely than 1, not 34
#: The correlation of the logarithms of two kinds of noise that are found together: one floor and one pair of wheels make both.
#: None where one model was given and the other is a guess.
TOGETHER = 0.8


@dataclass
class NoiseFactor:
    """Mutable: the factor of one kind of noise; `variance` is s^2, at least `least`."""

    least: float = 0.0
    given: bool = True  # whether somebody gave the model; otherwise its doubt counts, too
    mean: float = 0.0  # of the binary logarithm of s
    sigma: float = 1.0
    _expected: float = 1.0  # s^2

    @property
    def variance(self) -> float:
        """Relative to the model's."""
        if not self.given:
            return max(self.least, self._expected)
        return max(self.least, float(4.0**self.mean))

    def take(self, weights: Array, logs: Array) -> None:
        """Its posterior is this, shape (n,), over these logarithms of s, shape (n,)."""
        self._expected = float(weights @ 4.0**logs)
        self.mean = float(weights @ logs)
        self.sigma = float(np.sqrt(weights @ (logs - self.mean) ** 2))


@dataclass
class NoiseFactors:
    """Mutable: the factors of kinds of noise that make one error together, by the likelihood of each combination.

    The prior of their logarithms is normal, one sigma of which is a factor of 2, or Student's t where they are only claimed. A given
    model is its median; a guess is what the prior expects s^2 to be.
    """

    kinds: tuple[NoiseFactor, ...]
    wild: bool = False  # whether the model is only claimed, and may be wrong by a factor of a thousand
    _logs: Array = field(init=False)  # binary logarithms of s, shape (n,)
    _prior: Array = field(init=False)  # logarithms, shape (n,) * kinds
    _seen: Array = field(init=False)  # the log-likelihood of each combination, faded, as `_prior`
    _variances: Array = field(init=False)  # of each combination, shape (n ** kinds, kinds)

    def __post_init__(self) -> None:
        number = len(self.kinds)
        self._logs = CLAIMED_LOGS if self.wild else LOGS
        combined = np.stack(np.meshgrid(*[self._logs] * number, indexing="ij"), axis=-1)
        apart = combined - [0.0 if kind.given else -np.log(2) for kind in self.kinds]
        alike = TOGETHER if len({kind.given for kind in self.kinds}) == 1 else 0.0
        # A factor below its bound is used as the bound, so it has the bound's likelihood and says no more of the other kind.
        least = [kind.least if alike else 0.0 for kind in self.kinds]
        correlation = alike + (1 - alike) * np.eye(number)
        squared = np.sum(apart @ np.linalg.inv(correlation) * apart, axis=-1)
        self._prior = -0.5 * (TAILS + number) * np.log1p(squared / TAILS) if self.wild else -0.5 * squared
        self._seen = np.zeros_like(self._prior)
        self._variances = np.maximum(least, 4.0 ** combined.reshape(-1, number))

    def weigh(self, error: Array, rest: Array, added: Array) -> None:
        """Take an error, shape (n,), whose covariance is `rest`, (n, n), and s^2 times `added`, (kinds, n, n), of each kind."""
        variances = np.array([kind.variance for kind in self.kinds])
        present = float(error @ np.linalg.solve(rest + np.tensordot(variances, added, 1), error))
        farthest = quantile(GATE, len(error))  # farther off, as by a misread barcode, counts as this
        nearer = farthest / max(farthest, present)
        covariances = rest + np.tensordot(self._variances, added, 1)
        squared = nearer * np.einsum("i,kij,j->k", error, np.linalg.inv(covariances), error)
        likelihood = -0.5 * (squared + np.linalg.slogdet(covariances)[1])
        self._seen = self._seen * np.exp(-1 / MEMORY) + likelihood.reshape(self._seen.shape)
        logs = self._prior + self._seen
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        for axis, kind in enumerate(self.kinds):
            kind.take(weights.sum(axis=tuple(other for other in range(len(self.kinds)) if other != axis)), self._logs)


class _Measured(NamedTuple):
    """What was seen in a span as one measurement of n directions of the pose: `rows` (n, 3), its `error` (n,) and `noise` (n, n)."""

    rows: Array
    error: Array
    noise: Array


def _measured(led: Moments, belief: Moments) -> _Measured:
    """The measurement that leads from the pose by odometry alone to that of the belief, in the directions that it informs."""
    apart = (belief.mean - led.mean)[POSE]
    apart[HEADING] = wrap(float(apart[HEADING]))
    whiten = np.linalg.inv(np.linalg.cholesky(led.covariance[POSE, POSE] + np.eye(3) * TINY))
    left, axes = np.linalg.eigh(whiten @ belief.covariance[POSE, POSE] @ whiten.T)
    gain = 1.0 - left
    rows, gain = (axes.T @ whiten)[gain > INFORMED], gain[gain > INFORMED]
    return _Measured(rows, rows @ apart / gain, np.diag(1.0 / gain - 1.0 + TINY))


@dataclass
class Span:
    """Mutable: some seconds of motion, after which the wheels are judged, and the factors that such spans show, by kind of noise."""

    robot: str
    nuisance: Nuisance
    seconds: float  # of motion, at least
    given: tuple[bool, bool, bool] = (True, True, True)  # as `WheelNoise.given`
    least: tuple[float, float] = (1.0, 1.0)  # as `WheelNoise.least`
    kinds: dict[str, NoiseFactor] = field(init=False)
    _together: NoiseFactors = field(init=False)  # along and heading
    _aside: NoiseFactors | None = None  # across
    _led: Joint | None = None  # the robot's block since the span began, by odometry alone
    _without: dict[str, Joint] = field(default_factory=dict)  # the same without the noise of a kind
    _moving: float = 0.0  # seconds of motion in the span
    _by_team: bool = False  # whether the span began with the team's belief
    _doubted: bool = False  # whether a fix in it was beyond the gate

    def __post_init__(self) -> None:
        along, heading, across = self.given
        self.kinds = {
            "along": NoiseFactor(self.least[0], along),
            "heading": NoiseFactor(self.least[1], heading),
        }
        self._together = NoiseFactors(tuple(self.kinds.values()))
        if not across:
            self.kinds["across"] = NoiseFactor(1.0)
            self._aside = NoiseFactors((self.kinds["across"],), wild=True)

    def give_up(self) -> None:
        """Judge nothing of this span."""
        self._led = None

    def doubt(self) -> None:
        """A fix was beyond the gate, so this span says nothing of noise across the way."""
        self._doubted = True

    def judge(self, belief: Moments, noise: Mapping[str, float], *, by_team: bool) -> None:
        """Take a belief as `WheelNoise.judge`; `noise` are the factors of the variances that the span was led with, by kind."""
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
                seen = _measured(led, belief)
                self._weigh(self._together, ("along", "heading"), led, seen, made, noise)
                if self._aside is not None and not self._doubted:
                    self._weigh(self._aside, ("across",), led, seen, made, noise)
                self._begin(belief, by_team)

    def move(self, motion: Motion, without: Mapping[str, Motion]) -> None:
        """Lead the span on by a motion with the noise that was found, and by the same without the noise of each kind."""
        if self._led is not None:
            others = [(joint, without[kind]) for kind, joint in self._without.items()]
            drive_alike([(self._led, motion), *others], self.robot, self.nuisance)
            self._moving += motion.moving

    def _weigh(
        self,
        factors: NoiseFactors,
        kinds: Sequence[str],
        led: Moments,
        seen: _Measured,
        made: Mapping[str, Array],
        noise: Mapping[str, float],
    ) -> None:
        """Weigh the factors of some kinds; the noise of the others is taken for what was found.

        A large error of the heading adds to the covariance more than in proportion, so the difference `rest` may have a negative
        eigenvalue. That is set to 0: it would give one factor all the weight.
        """
        own = np.array([made[kind] for kind in kinds])
        rest = led.covariance[POSE, POSE] - np.tensordot([noise[kind] for kind in kinds], own, 1)
        variances, axes = np.linalg.eigh(rest)
        if variances[0] < 0:
            rest = (axes * np.maximum(variances, 0.0)) @ axes.T
        added = np.array([seen.rows @ unit @ seen.rows.T for unit in own])
        factors.weigh(seen.error, seen.rows @ rest @ seen.rows.T + seen.noise, added)

    def _begin(self, belief: Moments, by_team: bool) -> None:
        self._led, self._moving, self._by_team, self._doubted = Joint(), 0.0, by_team, False
        self._without = {kind: Joint() for kind in self.kinds}
        for joint in (self._led, *self._without.values()):
            joint.add(self.robot, belief)


@dataclass
class WheelNoise:
    """Mutable. Each tick `judge` the belief after the tick before, then `move`."""

    robot: str
    nuisance: Nuisance
    #: Whether somebody gave the model of the noise along the way, of the heading, and across the way, which is found only if not.
    given: tuple[bool, bool, bool] = (True, True, True)
    #: Lower bounds of the factors of the variances along the way and of the heading (`Sensors.least_noise`).
    least: tuple[float, float] = (1.0, 1.0)
    spans: tuple[Span, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.spans = tuple(Span(self.robot, self.nuisance, seconds, self.given, self.least) for seconds in SPANS)

    @property
    def found(self) -> dict[str, NoiseFactor]:
        """Of each kind, by the spans that surely show the most."""
        return {
            kind: max((span.kinds[kind] for span in self.spans), key=lambda factor: factor.mean - factor.sigma)
            for kind in self.spans[0].kinds
        }

    def give_up(self) -> None:
        """Judge nothing of these spans, because the belief was given up or a motion was not measured."""
        for span in self.spans:
            span.give_up()

    def doubt(self) -> None:
        """A fix was beyond the gate: it may err more than it claims, which is not to be taken for a robot that slips."""
        for span in self.spans:
            span.doubt()

    def scaled(self, motion: Motion) -> Motion:
        """A motion whose noise is that of the model, with that which was found."""
        return replace(motion, **{kind: getattr(motion, kind) * noise for kind, noise in self._variances().items()})

    def judge(self, belief: Moments, *, by_team: bool) -> None:
        """Take a belief of the whole block, shape (12,) and (12, 12): of the robot alone, or of its team.

        A span that is long enough, and at whose end enough was seen, is weighed. One that began with the team's belief is judged
        by the team's only, because a robot alone knows less.
        """
        noise = self._variances()
        for span in self.spans:
            span.judge(belief, noise, by_team=by_team)

    def move(self, motion: Motion) -> None:
        """Lead the spans on by a motion with the noise that was found."""
        without = {kind: replace(motion, **{kind: 0.0}) for kind in self.spans[0].kinds}
        for span in self.spans:
            span.move(motion, without)

    def _variances(self) -> dict[str, float]:
        return {kind: factor.variance for kind, factor in self.found.items()}


@dataclass
class CameraNoise:
    """Mutable. `judge` each sighting of a landmark before it is taken; `scaled` gives one the noise that was found."""

    range: NoiseFactor = field(default_factory=NoiseFactor)
    bearing: NoiseFactor = field(default_factory=NoiseFactor)
    _factors: tuple[NoiseFactors, NoiseFactors] = field(init=False)
    #: Group -> team time (s) of its last sighting that was judged.
    _judged: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._factors = NoiseFactors((self.range,)), NoiseFactors((self.bearing,))

    @property
    def is_judged(self) -> bool:
        """Whether a sighting of a landmark has been judged yet."""
        return bool(self._judged)

    def found(self, model: Camera) -> CameraFound | None:
        """The estimate of the camera's noise that goes into the evidence. None where the camera has a profile: then there is none."""
        if model.profile:
            return None
        ranges, bearings = ((factor.mean, factor.sigma) for factor in (self.range, self.bearing))
        return CameraFound((model.floor, model.share, model.bearing), ranges, bearings)

    def scaled(self, relative: Relative) -> Relative:
        """A sighting whose noise is that of the model, with that which was found."""
        return scaled(relative, self.range.variance, self.bearing.variance)

    def judge(self, relative: Relative, measured: Factor, innovation: Innovation, time: float) -> None:
        """Take a sighting of a landmark, as a factor, and what it says beyond what was expected, at a team time (s)."""
        group = relative.group or relative.subject
        if relative.kind != "range-bearing" or not relative.biases or time - self._judged.get(group, -np.inf) < ALIKE:
            return
        self._judged[group] = time
        u = measured.jacobians[relative.observer][:, RANGE]
        u = u / np.linalg.norm(u)
        for factors, axis in zip(self._factors, (u, QUARTER @ u), strict=True):
            total, fresh = float(axis @ innovation.covariance @ axis), float(axis @ measured.noise @ axis)
            once = fresh / COUNTED**2
            rest, added = np.array([[max(0.0, total - fresh)]]), np.array([[[once / factors.kinds[0].variance]]])
            factors.weigh(axis[np.newaxis] @ innovation.residual, rest, added)
