"""How large the noise of wheels and camera is, estimated on line, larger or smaller than the model says. Pure.

Errors that follow each other are alike and look smaller than they are. So few sightings are judged: one of each landmark in `ALIKE`
seconds. The wheels are judged by spans of motion of several lengths (`spans`). Of a robot's own the surest counts, unless another
surely shows more; of those of beliefs, which show too little, the largest.

The camera's is judged by landmarks only. The wheels' has a lower bound (`Sensors.least_noise`), because what is alike over minutes
looks small over a span, and what the whole team shares looks small to all of them. Wheels that nobody described guess the noise
along the way only: a heading that is believed too well turns the whole team, and without landmarks nobody sees it.

Noise across the way is found only of a robot that nobody described at all: it may be a boat, or skid. The prior is Student's t, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from blackboard.opinion.gaussian.cameras import CameraFound, scaled
from blackboard.opinion.gaussian.joint import Factor, Innovation, Joint, Moments
from blackboard.opinion.gaussian.relation import QUARTER, Relative
from blackboard.opinion.gaussian.vehicle import RANGE, Motion, Nuisance
from robot_agent.gaussian.factors import NoiseFactor, NoiseFactors
from robot_agent.gaussian.sensors import Camera
from robot_agent.gaussian.spans import BeliefSpan, OwnSpan, Span

ALIKE = 8.0  # seconds in which the errors of the sightings of one landmark are alike
#: As how many times its sigma a reading counts whose error lasts seconds. The mean of n readings a second apart, with
#: correlations of .76, .66, .57, .. (measured of a camera's ranges), errs 1.75 (n = 4) to 2.26 (n = 8) times as much as of
#: independent ones.
COUNTED = 2.0
#: Seconds of motion, at least: a jitter shows soon, and an error that lasts for seconds in long spans only.
SPANS = (1.0, 4.0, 16.0)


@dataclass
class WheelNoise:
    """Mutable. Each tick `judge` the beliefs after the tick before, then `move`."""

    robot: str
    nuisance: Nuisance
    #: Whether somebody gave the model of the noise along the way, of the heading, and across the way, which is found only if not.
    given: tuple[bool, bool, bool] = (True, True, True)
    #: Lower bounds of the factors of the variances along the way and of the heading (`Sensors.least_noise`).
    least: tuple[float, float] = (1.0, 1.0)
    own: tuple[OwnSpan, ...] = field(init=False)
    believed: tuple[BeliefSpan, ...] = field(init=False)

    def __post_init__(self) -> None:
        model = self.given, self.least
        self.own = tuple(OwnSpan(self.robot, seconds, *model) for seconds in SPANS)
        self.believed = tuple(BeliefSpan(self.robot, seconds, *model, nuisance=self.nuisance) for seconds in SPANS)

    @property
    def spans(self) -> tuple[Span, ...]:
        """All of them."""
        return (*self.own, *self.believed)

    @property
    def found(self) -> dict[str, NoiseFactor]:
        """Of each kind: by the surest of its own spans, or by those of beliefs, which show too little; by what surely shows more."""
        return {kind: self._found(kind) for kind in self.own[0].kinds}

    def _found(self, kind: str) -> NoiseFactor:
        own, believed = ([span.kinds[kind] for span in spans] for spans in (self.own, self.believed))
        largest = _largest(believed)
        return _largest([_surest(own), largest]) if any(factor.is_judged for factor in own) else largest

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

    def judge(self, own: Joint, team: Moments | None) -> None:
        """Take the robot's filter, and its whole block, shape (12,) and (12, 12), as the team believes it, if that is plausible.

        A span that is long enough, and at whose end enough was seen, is weighed.
        """
        noise = self._variances()
        for span in self.own:
            span.judge(own, noise)
        belief = own.moments(self.robot) if team is None else team
        for by_belief in self.believed:
            by_belief.judge(belief, noise, by_team=team is not None)

    def move(self, own: Joint, motion: Motion, angle: float) -> None:
        """The robot's filter was driven, in a direction (radians), by a motion with the noise that was found."""
        noise = self._variances()
        for span in self.own:
            span.move(own, motion, angle, noise)
        nothing: dict[str, dict[str, Any]] = {kind: {kind: 0.0} for kind in self.own[0].kinds}
        without = {kind: replace(motion, **noiseless) for kind, noiseless in nothing.items()}
        for by_belief in self.believed:
            by_belief.move(motion, without)

    def _variances(self) -> dict[str, float]:
        return {kind: factor.variance for kind, factor in self.found.items()}


def _surest(factors: Sequence[NoiseFactor]) -> NoiseFactor:
    """Of those that were judged the one with the smallest sigma, unless another is larger by more than its own sigma."""
    judged = [factor for factor in factors if factor.is_judged]
    surest, largest = min(judged, key=lambda factor: factor.sigma), _largest(judged)
    return largest if largest.at_least > surest.mean else surest


def _largest(factors: Sequence[NoiseFactor]) -> NoiseFactor:
    return max(factors, key=lambda factor: factor.at_least)


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
