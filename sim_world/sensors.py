"""The physics of the sensors, Sec. VI of the paper: what is seen, and what the wheels say. Units are the grid's."""

from __future__ import annotations

import math

import numpy as np

from blackboard.wire.messages import Fix, Odometry, Sighting
from sim_world.scenario import OdometrySection, VisionSection

BEST = 7.5  # the distance of the best view; all four numbers from (VI-.1)
NEAR, FAR = 1.0, 13.0  # nothing is seen outside
INNER, OUTER = 3.0, 11.0  # between them the linear branch


def vision_sigma(distance: float, gain: float = 1.0, floor: float = 0.5) -> float | None:
    """Standard deviation of a seen position in each coordinate, or None where nothing is seen; the log is natural."""
    if not NEAR < distance < FAR:
        return None
    off = abs(distance - BEST)
    sigma = 8.0 * off if INNER <= distance <= OUTER else 20.0 * math.log(off)  # (VI-.1)
    return max(floor, gain * sigma)


def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def see(
    vision: VisionSection,
    pose: tuple[float, float, float],
    subject: str,
    place: tuple[float, float],
    noise: np.random.Generator,
) -> Sighting | None:
    """What a robot at (x, y, heading) sees of a subject at a place, or None; draws from `noise` only if it sees it.

    The position relative to the robot has an isotropic Gaussian error of (VI-.1) at the true distance, and is told as
    range and bearing.
    """
    x, y, heading = pose
    dx, dy = place[0] - x, place[1] - y
    sigma = vision_sigma(math.hypot(dx, dy), vision.scale, vision.floor)
    if sigma is None or abs(wrap(math.atan2(dy, dx) - heading)) > vision.half_angle:
        return None
    sx, sy = (float(s) for s in np.array([dx, dy]) + noise.normal(0.0, sigma, 2))
    return Sighting(subject=subject, range=math.hypot(sx, sy), bearing=wrap(math.atan2(sy, sx) - heading))


class Odometer:
    """One robot's wheels, compass, and the fix that resets them each time the way exceeds `reset_after`."""

    def __init__(self, physics: OdometrySection, noise: np.random.Generator) -> None:
        self.physics = physics
        self.noise = noise
        self.travelled = 0.0  # since the last reset

    def step(self, distance: float, turn: float, dt: float) -> Odometry:
        """The wheels' word on a true step: errors grow with the square root of the way, along the motion."""
        self.travelled += distance
        along, turning = self.noise.normal(0.0, 1.0, 2)
        return Odometry(
            distance=distance + along * self.physics.along * math.sqrt(distance),
            turn=turn + turning * self.physics.turn * math.sqrt(abs(turn)),
            dt=dt,
        )

    def compass(self, heading: float) -> float:
        return wrap(heading + self.noise.normal(0.0, self.physics.compass))

    def reset(self, place: tuple[float, float]) -> Fix | None:
        """A Fix, if one is due."""
        return self.fix(place) if self.travelled > self.physics.reset_after else None

    def fix(self, place: tuple[float, float]) -> Fix:
        """An absolute position with an honest error; the distance counts from here again."""
        self.travelled = 0.0
        x, y = (float(c) for c in np.array(place) + self.noise.normal(0.0, self.physics.fix, 2))
        return Fix(position=(x, y), sigma=self.physics.fix)
