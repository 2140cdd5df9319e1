"""How large the error along a robot's way is, estimated on line: wheels differ, and so do floors. Pure.

Every span of at least `SPAN` seconds of motion is judged once: by how much did what was seen meanwhile move the place that odometry
alone had led to? Where all models hold, that correction has the covariance P - P', where P is that of the place by odometry alone and
P' that of the belief afterwards. The error along the way adds s^2 A to P, where A is what the physics of the wheels says
(`Wheels.along`), and s is looked for: its logarithm has a mean and a sigma over a grid of factors, by their likelihood and a
log-normal prior. While the mean is within two sigmas of 0, which may be luck, the physics hold.

Spans are judged, not ticks, because errors that follow each other are alike: their sum over seconds is what leads a robot without
landmarks astray. For the same reason s is never taken for less than 1: what is alike over minutes looks small over a span.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import AXES, Motion, Nuisance, drive
from blackboard.opinion.grid import Array

SPAN = 16.0  # seconds of motion, at least
LONGEST = 64.0  # seconds of motion after which a span is begun anew: too little was seen
INFORMED = 0.25  # of the variance along the way by odometry alone: P' must be smaller for a span to be judged
FARTHEST = 9.0  # variances (by the present s): a larger squared correction, as by a misread barcode, counts as this
MEMORY = 40.0  # spans after which what was seen has faded to 1 / e
LOGS = np.arange(-3.0, 3.01, 0.25)  # binary logarithms of s
SURE = 2.0  # sigmas of log s above 0 from which on s is used: before, it may be luck
PRIOR = -0.5 * LOGS**2  # the logarithm of the log-normal prior of s: one sigma is a factor of 2


@dataclass
class AlongNoise:
    """Mutable. Each tick `judge` the belief after the tick before, then `move`; `variance` is s^2."""

    robot: str
    nuisance: Nuisance
    variance: float = 1.0
    _seen: Array = field(default_factory=lambda: np.zeros(len(LOGS)))  # the log-likelihood of each factor, faded
    _led: Joint | None = None  # the robot's block since the span began, by odometry alone
    _bare: Joint | None = None  # the same without the error along the way
    _moving: float = 0.0  # seconds of motion in the span
    _by_team: bool = False  # whether the span began with the team's belief

    def give_up(self) -> None:
        """Judge nothing of this span, because the belief was given up or a motion was not measured."""
        self._led = self._bare = None

    def judge(self, belief: Moments, *, by_team: bool) -> None:
        """Take a belief of the whole block, shape (9,) and (9, 9): of the robot alone, or of its team.

        A span that is long enough, and at whose end enough was seen, is weighed. One that began with the team's belief is judged
        by the team's only, because a robot alone knows less.
        """
        if self._led is None or self._bare is None or self._moving > LONGEST:
            self._begin(belief, by_team)
        elif self._moving >= SPAN and by_team >= self._by_team:
            led, bare = self._led.moments(self.robot), self._bare.moments(self.robot)
            sizes, axes = np.linalg.eigh((led.covariance - bare.covariance)[AXES, AXES])
            way, added = axes[:, -1], float(sizes[-1])
            by_odometry, without, after = (float(way @ it.covariance[AXES, AXES] @ way) for it in (led, bare, belief))
            if added > 0 and after < INFORMED * by_odometry:
                self._weigh(float(way @ (belief.mean - led.mean)[AXES]) ** 2, max(0.0, without - after), added)
                self._begin(belief, by_team)

    def move(self, motion: Motion) -> None:
        """Lead the span on by a motion, whose `along` is that of the wheels' physics."""
        if self._led is not None and self._bare is not None:
            drive(self._led, self.robot, motion, self.nuisance)
            drive(self._bare, self.robot, replace(motion, along=0.0), self.nuisance)
            self._moving += motion.moving

    def _begin(self, belief: Moments, by_team: bool) -> None:
        self._led, self._bare, self._moving, self._by_team = Joint(), Joint(), 0.0, by_team
        self._led.add(self.robot, belief)
        self._bare.add(self.robot, belief)

    def _weigh(self, squared: float, rest: float, added: float) -> None:
        """Take a squared correction along the way; its variance is `rest + s^2 added`. All in unit ** 2."""
        squared = min(squared, FARTHEST * (rest + self.variance * added))
        variances = rest + 4.0**LOGS * added
        self._seen = self._seen * np.exp(-1 / MEMORY) - 0.5 * (squared / variances + np.log(variances))
        logs = PRIOR + self._seen
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        mean = float(weights @ LOGS)
        sigma = math.sqrt(float(weights @ (LOGS - mean) ** 2))
        self.variance = 4.0**mean if mean > SURE * sigma else 1.0
