"""How a robot's compass and the antenna of its fixes are mounted, which nobody told: found by all else that it measures. Pure.

A compass may be turned, and so reads the same angle too much for good. An antenna may stand ahead of the point on which the robot
turns, or beside it. The robot's own joint holds such errors as blocks, with a prior by which they are small. Once that is
contradicted, it becomes a wide one (`priors`). With a wide one from the start, exact sensors would be worth little until the robot
has moved.

What contradicts a prior is counted since the sensor's noise was last found to be larger. With too little, any mount seems to be seen.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.priors import by_wide_prior, widen
from blackboard.opinion.gaussian.relation import QUARTER
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Array
from robot_agent.gaussian.factors import NoiseFactor

KNOWN = 0.3  # sigma of the binary logarithm of a sensor's noise, up to which its mount is judged
MORE = 1.5  # times the variance of that noise: what was seen before says nothing


@dataclass
class Mount:
    """Mutable. Each reading is `with_errors`, with the noise that was found (`on_noise`); `judge` them in each tick."""

    robot: str
    parts: tuple[str, ...]  # names of the errors, as a status tells them
    small: float  # sigma of the prior of each, unit or radians
    wide: float  # the same once that is contradicted
    found: frozenset[int] = frozenset()  # indices of the parts that have the wide prior
    # Variances of the sensor's noise, over what it claims: with which its mount has been judged, and at most, to one sigma.
    _noise: float = 1.0
    _most: float = math.inf  # infinite: not known well enough

    @property
    def block(self) -> Block:
        """The name of the errors in the robot's joint."""
        return ("mount", self.robot, self.parts)

    def errors(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """Those that were found, and their sigmas, by name."""
        known = self.known(joint)
        return {
            self.parts[part]: (float(known.mean[part]), math.sqrt(float(known.covariance[part, part])))
            for part in sorted(self.found)
        }

    def known(self, joint: Joint) -> Moments:
        """What is known of the errors."""
        return joint.moments(self.block) if self.block in joint else self._prior()

    def with_errors(self, factor: Factor, rows: Array, known: Moments) -> Factor:
        """A measurement that errs by these, of which this is known, too; `rows` are its derivatives, shape (m, parts)."""
        return replace(
            factor,
            residual=factor.residual - rows @ known.mean,
            jacobians={**factor.jacobians, self.block: rows},
            priors={**factor.priors, self.block: known},
        )

    def on_noise(self, joint: Joint, noise: NoiseFactor, variance: float) -> None:
        """So noisy was the sensor found to be, and this `variance`, over what it claims, counts until more is known."""
        self._most = max(variance, float(4.0 ** (noise.mean + noise.sigma))) if noise.sigma <= KNOWN else math.inf
        if variance > MORE * self._noise:
            self._noise, self.found = variance, frozenset()
            if self.block in joint:
                joint.drop(self.block)

    def judge(self, joint: Joint) -> bool:
        """Replace the prior that is contradicted most, even with the most noise that may be. Whether there was one."""
        if self.block not in joint:
            return False
        known, at = joint.moments(self.block), joint.blocks[self.block].start
        farthest, worst = quantile(GATE, 1) * self._most / self._noise, None
        for part in sorted(set(range(len(self.parts))) - self.found):
            now = float(known.mean[part]), float(known.covariance[part, part])
            beyond, mean, variance = by_wide_prior((0.0, self.small**2), now, (0.0, self.wide))
            if beyond > farthest:
                farthest, worst = beyond, (part, mean, variance)
        if worst is None:
            return False
        part, mean, variance = worst
        widen(joint, at + part, variance, joint.regression(at + part) * (mean - joint.mean[at + part]))
        self.found |= {part}
        return True

    def _prior(self) -> Moments:
        sigmas = [self.wide if part in self.found else self.small for part in range(len(self.parts))]
        return Moments(np.zeros(len(sigmas)), np.diag(np.square(sigmas)))


def compass_of(robot: str) -> Mount:
    """A robot's compass: small ones beside motors and batteries err by 10 degrees, and north may be another one than the map's."""
    return Mount(robot, ("compass bias",), 0.001, 0.2)


class Antenna(Mount):
    """Mutable: the arm from the point on which a robot turns to the antenna of its fixes, in units."""

    def __init__(self, robot: str) -> None:
        super().__init__(robot, ("antenna ahead", "antenna left"), 0.01, 0.5)

    def measured(self, joint: Joint, factor: Factor, arm: Moments) -> Factor:
        """A measurement of the robot's place, linearised at a joint, as one of the antenna's, with what is known of the arm."""
        turned = _rotation(float(joint.moments(self.robot).mean[HEADING]))
        by_robot = factor.jacobians[self.robot].copy()
        by_robot[:, HEADING] += QUARTER @ turned @ arm.mean
        factor = replace(factor, jacobians={**factor.jacobians, self.robot: by_robot})
        return self.with_errors(factor, turned, arm)

    def swung(self, joint: Joint, before: float, now: float) -> Moments:
        """How far the antenna has moved around the robot from a heading (rad) to another one, shape (2,), unit."""
        by, arm = _rotation(now) - _rotation(before), self.known(joint)
        return Moments(by @ arm.mean, by @ arm.covariance @ by.T)


def _rotation(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])
