"""What a robot's wheels and camera are like, by their physics: noise that is fresh and errors that last.

The defaults are those of the recorded robots, one set for all. Most were measured against ground truth over the 15 minutes of
that recording; chosen instead, by the score of the whole pipeline on stretches of the same recording, were the slip's sigma
(measured .16 to .18), the fresh and the lasting shares of the range error (fresh .016 measured; .028 where .04 stands) and the
bearing's sigma. Units: metres or cells, radians, seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.relation import Bias, Relative
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance
from blackboard.wire.messages import Odometry, Sighting
from robot_agent.config import RobotSection
from robot_agent.sensing import SEEN_FROM, SEEN_TO, position_sigma

#: The lasting errors of the recorded robots.
RECORDED = Nuisance(
    forward=0.90,  # true / told: .87 to .91, less when slow
    turn=0.95,  # .92 to .96
    sigmas=(0.05, 0.03, 0.003, 0.008, 0.25, 0.02),  # drift to one side 0.4 to 4 mrad/s; bearing -.010 to .002 rad
    walks=(0.003, 0.0, 0.0002),
    memory=(300.0, 2.3, 300.0),  # the residual along the way has correlations .65 and .43 after 1 and 2 s
)
STILL = 1e-9  # unit or radians: less is no motion


@dataclass(frozen=True)
class Wheels:
    """How odometry relates to motion."""

    nuisance: Nuisance = RECORDED
    along: float = 0.005  # unit / sqrt(s), beside the slip
    across: float = 0.0035  # unit / sqrt(s)
    heading: float = 0.012  # rad / sqrt(s), straight ahead
    turning: float = 0.11  # rad / sqrt(rad): of what is turned
    starting: float = 0.1  # rad per rad/s by which the turn rate changed since the tick before
    way: float = 0.0  # unit / sqrt(unit): of what is driven
    standing: float = 0.05  # the share of the sigmas that is left while the robot stands

    def motion(self, told: Odometry, before: Odometry | None) -> Motion:
        """A tick's motion with its noise; `before` is the odometry of the tick before."""
        moving = abs(told.distance) > STILL or abs(told.turn) > STILL
        time = told.dt * (1.0 if moving else self.standing**2)
        change = 0.0 if before is None else told.turn / told.dt - before.turn / before.dt
        return Motion(
            distance=told.distance,
            turn=told.turn,
            dt=told.dt,
            moving=told.dt if moving else 0.0,
            along=self.along**2 * time + self.way**2 * abs(told.distance),
            across=self.across**2 * time,
            heading=self.heading**2 * time + self.turning**2 * abs(told.turn) + (self.starting * change) ** 2,
        )


@dataclass(frozen=True)
class Camera:
    """How a sighting relates to where its subject is.

    The range's errors are shares of hypot(floor, range); nearly all of them last, and barcodes less than `together` apart
    (landmarks come in groups) have them in common (correlation .86; 1.5 apart .02).
    """

    floor: float = 0.7  # unit
    fresh: float = 0.02
    lasting: tuple[tuple[float, float], ...] = ((0.02, 300.0), (0.04, 7.0), (0.02, 0.7))  # share, time constant
    bearing: float = 0.016  # radians
    bent: float = 0.2  # share of the turn, and of its change, by which the heading within a tick is not known
    bend: float = 0.05  # rad/s: at most so much
    together: float = 0.6  # unit
    profile: tuple[tuple[float, float], ...] = ()  # see `Relative.profile`; replaces all of these

    def relative(self, robot: str, sighting: Sighting, turned: float, dt: float, group: str) -> Relative:
        """A sighting as a relative belief; `turned` is the turn of the tick, or its change if that is larger."""
        size = math.hypot(self.floor, sighting.range)
        share = min(1.0, sighting.age / dt) if dt > 0 else 0.0
        inside = min(1.0, 4.0 * share * max(0.05, 1.0 - share))  # where the tick's heading is known least: halfway
        bent = min((self.bent * turned) ** 2, (self.bend * dt) ** 2) * inside
        return Relative(
            observer=robot,
            subject=sighting.subject,
            range=sighting.range,
            bearing=sighting.bearing,
            range_variance=(self.fresh * size) ** 2,
            bearing_variance=self.bearing**2 + bent,
            age=sighting.age,
            biases=() if self.profile else tuple(Bias(s * size, seconds) for s, seconds in self.lasting),
            group=group,
            profile=self.profile,
        )


@dataclass(frozen=True)
class Sensors:
    """A robot's sensors as it models them."""

    wheels: Wheels = Wheels()
    camera: Camera = Camera()
    compass: float = 0.03  # radians, for one reading


def sensors_of(settings: RobotSection) -> Sensors:
    """The sensors of a robot that is configured by [robot].

    vision "position": (VI-.1) times its gain over the distances at which something is seen, and the odometry's sigmas.
    vision "range-bearing": the physics above, which holds for wheels and cameras like the recorded robots'.
    """
    vision, wheels = settings.vision, settings.odometry
    if vision.kind != "position":
        return Sensors()
    distances = np.linspace(SEEN_FROM + 0.01, SEEN_TO - 0.01, 49)
    profile = tuple(zip(distances.tolist(), np.square(position_sigma(distances, vision)).tolist(), strict=True))
    return Sensors(
        Wheels(
            Nuisance(forward=wheels.distance_scale, turn=wheels.turn_scale),
            along=wheels.along,
            across=wheels.across,
            heading=wheels.turn,
            turning=0.0,
            starting=0.0,
            standing=wheels.standing,
        ),
        replace(Camera(), profile=profile),
    )


def simulated(along: float, turn: float, compass: float, profile: tuple[tuple[float, float], ...]) -> Sensors:
    """Sensors whose only errors are fresh ones: the way's (`along`, unit / sqrt(unit)), the turn's (rad / sqrt(rad))."""
    wheels = Wheels(Nuisance(), along=0.0, across=0.0, heading=0.0, turning=turn, starting=0.0, way=along, standing=0.0)
    return Sensors(wheels, replace(Camera(), profile=profile), compass)
