"""The lever arm of a GPS antenna. Pure."""

import math
from dataclasses import replace

import numpy as np

from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.mounts import Mount
from blackboard.opinion.gaussian.relation import QUARTER
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Array


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
