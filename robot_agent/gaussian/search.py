"""Where a robot is that knows no place, by ranges and bearings alone of known points. Pure."""

import math
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.gaussian.joint import Factor, Joint
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.rings import LEAST, SURE, Line, Ring
from blackboard.opinion.gaussian.vehicle import AXES, BEARING, HEADING, STATES, correct
from blackboard.opinion.grid import Array

SEARCHING = 0.05  # unit / sqrt(s): by which odometry errs while ranges and bearings alone are gathered


@dataclass
class PlaceSearch:
    """Mutable: what was measured since the search began, while the place is not known."""

    robot: str
    _ring: Ring | None = None
    _at: Array = field(default_factory=lambda: np.zeros(2))  # the mean of the unknown place at the newest measurement

    @property
    def is_on(self) -> bool:
        return self._ring is not None

    def forget(self) -> None:
        self._ring = None

    def take(self, joint: Joint, relative: Relative, point: Array, time: float) -> None:
        """Take a range or a bearing of a point at a team time (s). Once all leave one place, the joint takes it as a fix."""
        belief = joint.moments(self.robot)
        if self._ring is None:
            self._ring, self._at = Ring(SEARCHING), belief.mean[AXES]
        self._ring.move(belief.mean[AXES] - self._at)
        self._at = belief.mean[AXES]
        angle = float(belief.mean[HEADING] - belief.mean[BEARING]) + relative.bearing + math.pi
        heading = float(belief.covariance[HEADING, HEADING] + belief.covariance[BEARING, BEARING])
        is_range = relative.kind == "range"
        lasting = sum(bias.sigma**2 for bias in relative.biases)
        variance = relative.range_variance + lasting if is_range else relative.bearing_variance + heading
        self._ring.add(Line(point, relative.range if is_range else angle, variance, LEAST, is_range, time))
        places = self._ring.places()
        if places and places[0].weight > SURE:
            moments, rows = places[0].moments, np.eye(STATES)[AXES]
            correct(joint, Factor(moments.mean - belief.mean[AXES], {self.robot: rows}, moments.covariance))
            self._ring = None
