"""Mounting errors of a robot's compass and GPS antenna, estimated from all else that the robot measures. Pure.

A compass that is mounted askew reads too large an angle, always by the same amount. An antenna may be ahead of the robot's centre of
rotation, or to its side. The robot's own filter holds these errors as states. Their prior says that they are small. Once measurements
contradict it, a wide prior takes its place (`priors`). A wide one from the start would make exact sensors useless until the robot has
moved.

Noise that is larger than assumed looks like a mounting error. So the evidence is dropped whenever a sensor is found to be noisier.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.priors import by_wide_prior, replace_prior
from blackboard.opinion.gaussian.relation import QUARTER
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Array
from robot_agent.gaussian.factors import NoiseFactor

KNOWN = 0.3  # The mount is judged once the binary logarithm of the sensor's noise has this sigma or less.
MORE = 1.5  # The evidence is dropped where the variance of the noise is found to be larger by this factor.


@dataclass
class Mount:
    """Mutable: the mounting errors of one sensor. Call `with_errors` and `on_noise` for each reading, and `judge` once a tick."""

    robot: str
    parts: tuple[str, ...]  # the names of the errors in the robot's status
    small: float  # sigma of each error by the first prior, unit or radians
    wide: float  # sigma of each error by the wide prior
    found: frozenset[int] = frozenset()  # indices of the errors that have the wide prior
    # The variance of the sensor's noise, as a factor of what the sensor claims.
    _noise: float = 1.0  # as it was when the evidence was last dropped
    _most: float = math.inf  # one sigma above the estimate; infinite while the noise is not known well enough

    @property
    def block(self) -> Block:
        """The name of their block in the robot's joint."""
        return ("mount", self.robot, self.parts)

    def errors(self, joint: Joint) -> dict[str, tuple[float, float]]:
        """The errors that have the wide prior, each with its sigma, by name."""
        known = self.known(joint)
        return {
            self.parts[part]: (float(known.mean[part]), math.sqrt(float(known.covariance[part, part])))
            for part in sorted(self.found)
        }

    def known(self, joint: Joint) -> Moments:
        """Mean and covariance of the errors, shape (parts,) and (parts, parts)."""
        return joint.moments(self.block) if self.block in joint else self._prior()

    def with_errors(self, factor: Factor, rows: Array, known: Moments) -> Factor:
        """The same measurement with these errors as further states; `rows` are its derivatives by them, shape (m, parts)."""
        return replace(
            factor,
            residual=factor.residual - rows @ known.mean,
            jacobians={**factor.jacobians, self.block: rows},
            priors={**factor.priors, self.block: known},
        )

    def on_noise(self, joint: Joint, noise: NoiseFactor, variance: float) -> None:
        """Take the estimate of the sensor's noise; the filter uses this `variance`, a factor of what the sensor claims."""
        self._most = max(variance, float(4.0 ** (noise.mean + noise.sigma))) if noise.sigma <= KNOWN else math.inf
        if variance > MORE * self._noise:
            self._noise, self.found = variance, frozenset()
            if self.block in joint:
                joint.drop(self.block)

    def judge(self, joint: Joint) -> bool:
        """Give the error whose prior is contradicted most the wide prior. False: none is, if the noise is as large as it may be."""
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
        replace_prior(joint, at + part, mean, variance)
        self.found |= {part}
        return True

    def _prior(self) -> Moments:
        sigmas = [self.wide if part in self.found else self.small for part in range(len(self.parts))]
        return Moments(np.zeros(len(sigmas)), np.diag(np.square(sigmas)))


def compass_of(robot: str) -> Mount:
    """The mount of a robot's compass. Motors and batteries nearby turn small ones by 10 degrees; magnetic north is not the map's."""
    return Mount(robot, ("compass bias",), 0.001, 0.2)


class Antenna(Mount):
    """Mutable: the lever arm, from a robot's centre of rotation to the antenna of its GPS, in the grid's unit."""

    def __init__(self, robot: str) -> None:
        super().__init__(robot, ("antenna ahead", "antenna left"), 0.01, 0.5)

    def measured(self, joint: Joint, factor: Factor, arm: Moments) -> Factor:
        """A measurement of the robot's place, linearised at a joint, turned into one of the antenna's place."""
        turned = _rotation(float(joint.moments(self.robot).mean[HEADING]))
        by_robot = factor.jacobians[self.robot].copy()
        by_robot[:, HEADING] += QUARTER @ turned @ arm.mean
        factor = replace(factor, jacobians={**factor.jacobians, self.robot: by_robot})
        return self.with_errors(factor, turned, arm)

    def swung(self, joint: Joint, before: float, now: float) -> Moments:
        """How far a turn from one heading (rad) to another has moved the antenna: shape (2,) and (2, 2), unit."""
        by, arm = _rotation(now) - _rotation(before), self.known(joint)
        return Moments(by @ arm.mean, by @ arm.covariance @ by.T)


def _rotation(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])
