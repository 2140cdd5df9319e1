"""The physics of the sensors, Sec. VI of the paper: sightings, odometry, compass and fixes. Lengths in the grid's unit.

A robot's own sensor models (`robot_agent.sensing`) are written separately on purpose, so that a wrong model can be tested.
"""

from __future__ import annotations

import math

import numpy as np

from blackboard.config.world import WorldOdometrySection, WorldVisionSection
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.wire.messages import Fix, Odometry, Sighting

# The distances of (VI-.1), in cells: the printed sigma is 0 at the best view, and nothing is seen outside NEAR..FAR.
BEST_VIEW = 7.5
NEAR, FAR = 1.0, 13.0
INNER, OUTER = 3.0, 11.0  # between them sigma is linear in the distance


def vision_sigma(distance: float, gain: float = 1.0, floor: float = 0.5) -> float | None:
    """Standard deviation of a seen position in each coordinate (unit): (VI-.1) times a gain; None where nothing is seen."""
    if not NEAR < distance < FAR:
        return None
    off = abs(distance - BEST_VIEW)
    # (VI-.1): sigma(d) = 8 |d - 7.5| for 3 <= d <= 11, and 20 ln |d - 7.5| for 1 < d < 3 and 11 < d < 13
    sigma = 8.0 * off if INNER <= distance <= OUTER else 20.0 * math.log(off)
    return max(floor, gain * sigma)


def see(
    vision: WorldVisionSection,
    pose: tuple[float, float, float],
    subject: str,
    place: tuple[float, float],
    noise: np.random.Generator,
) -> Sighting | None:
    """The sighting that a robot at (x, y, heading) makes of a subject at a place; None, and no draw from `noise`, if unseen.

    The position relative to the robot has isotropic Gaussian noise, (VI-.1) at the true distance, and is given as range
    and bearing.
    """
    x, y, heading = pose
    dx, dy = place[0] - x, place[1] - y
    sigma = vision_sigma(math.hypot(dx, dy), vision.scale, vision.floor)
    if sigma is None or abs(wrap(math.atan2(dy, dx) - heading)) > vision.half_angle:
        return None
    sx, sy = (float(s) for s in np.array([dx, dy]) + noise.normal(0.0, sigma, 2))
    return Sighting(subject=subject, range=math.hypot(sx, sy), bearing=wrap(math.atan2(sy, sx) - heading))


class Odometer:
    """One robot's odometry and compass, and the fix that it gets each time the way since the last one exceeds `reset_after`."""

    def __init__(self, physics: WorldOdometrySection, noise: np.random.Generator) -> None:
        self.physics = physics
        self.noise = noise
        self.travelled = 0.0  # since the last fix

    def step(self, distance: float, turn: float, dt: float) -> Odometry:
        """The measurement of a true step (unit, radians, s): noise grows with the square root of the way and of the turn."""
        self.travelled += distance
        along, turning = self.noise.normal(0.0, 1.0, 2)
        return Odometry(
            distance=distance + along * self.physics.along * math.sqrt(distance),
            turn=turn + turning * self.physics.turn * math.sqrt(abs(turn)),
            dt=dt,
        )

    def compass(self, heading: float) -> float:
        return wrap(heading + self.noise.normal(0.0, self.physics.compass))

    def fix_if_due(self, place: tuple[float, float]) -> Fix | None:
        """A fix where the way since the last one exceeds `reset_after`."""
        return self.fix(place) if self.travelled > self.physics.reset_after else None

    def fix(self, place: tuple[float, float]) -> Fix:
        """An absolute position with noise of the sigma that it states; the way counts from here again."""
        self.travelled = 0.0
        x, y = (float(c) for c in np.array(place) + self.noise.normal(0.0, self.physics.fix, 2))
        return Fix(position=(x, y), sigma=self.physics.fix)
