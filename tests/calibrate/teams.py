"""A simulated team whose wheels and cameras are known: straight ways, curves, spins and stops among landmarks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blackboard.wire.messages import Odometry, Readings, Sighting

FINE, TICK = 0.05, 0.25  # seconds: of the motion, and of the readings
PLACES = [(-2.0, -2.0), (8.0, -2.0), (8.0, 8.0), (-2.0, 8.0), (3.0, 11.0), (3.0, -5.0), (3.0, 3.0)]
#: Seconds, speed and turn rate that are told.
DRIVES = [
    (4, 0.3, 0.0), (3, 0.2, 0.8), (3, 0.3, 0.0), (2, 0.0, 0.7), (2, 0.0, 0.0), (3, 0.3, 0.0), (3, 0.2, -0.8),
    (2, 0.0, -0.6),
]  # fmt: skip


@dataclass(frozen=True)
class Robot:
    """What a robot's wheels do of what they are told, and what its camera makes of what is there."""

    way: float = 1.0
    arc_way: float = 1.0
    spin: float = 1.0
    arc_turn: float = 1.0
    lag: float = 0.0
    range: float = 1.0  # read over true
    bias: float = 0.0
    bearing: float = 0.0
    along: float = 0.02
    turn: float = 0.02
    range_sigma: float = 0.05
    bearing_sigma: float = 0.01
    misread: float = 0.0


def team(
    robots: Sequence[Robot], seconds: float, seed: int, names: Sequence[int] = range(len(PLACES))
) -> list[Readings]:
    """What robots r1, r2, ... measure. `names` has for each place the number of the landmark that is seen there."""
    rng, readings = np.random.default_rng(seed), list[Readings]()
    steps, each = round(seconds / FINE), round(TICK / FINE)
    ways = np.array([_way(robot, steps, 5.0 * n, rng) for n, robot in enumerate(robots)])  # (N, steps + 1, 3)
    for tick in range(steps // each + 1):
        at = tick * each
        for n, robot in enumerate(robots):
            commands = [_told(FINE * k + 5.0 * n) for k in range(at - each, at)] if tick else []
            odometry = Odometry(
                distance=sum(a for a, _ in commands) * FINE, turn=sum(b for _, b in commands) * FINE, dt=TICK
            )
            readings.append(
                Readings(
                    run="x",
                    robot=f"r{n + 1}",
                    tick=tick,
                    time=tick * TICK,
                    odometry=odometry if tick else None,
                    sightings=_seen(robot, n, ways[:, at], tick, names, rng) if tick else [],
                )
            )
    return readings


def _told(time: float) -> tuple[float, float]:
    """The speed and the turn rate that are told at a time."""
    left = time % sum(seconds for seconds, _, _ in DRIVES)
    for seconds, speed, rate in DRIVES:
        if left < seconds:
            return speed, rate
        left -= seconds
    return DRIVES[-1][1:]


def _way(robot: Robot, steps: int, begun: float, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    x, y, heading = 1.0 + 2 * rng.random(), 1.0 + 2 * rng.random(), 6.0 * rng.random()
    way = [(x, y, heading)]
    for step in range(steps):
        speed, rate = _told(max(0.0, FINE * (step + 0.5) - robot.lag) + begun)
        curve = bool(speed and rate)
        moving = math.sqrt(FINE) if speed or rate else 0.0
        distance = speed * FINE * (robot.arc_way if curve else robot.way) + robot.along * moving * rng.normal()
        turn = rate * FINE * (robot.arc_turn if curve else robot.spin) + robot.turn * moving * rng.normal()
        x += distance * math.cos(heading + turn / 2)
        y += distance * math.sin(heading + turn / 2)
        heading += turn
        way.append((x, y, heading))
    return way


def _seen(
    robot: Robot, n: int, poses: np.ndarray, tick: int, names: Sequence[int], rng: np.random.Generator
) -> list[Sighting]:
    x, y, heading = poses[n]
    there = [(f"landmark/{name}", place, PLACES[name]) for place, name in zip(PLACES, names, strict=True)]
    mates = [(f"robot/r{other + 1}", poses[other][:2], None) for other in range(len(poses)) if other != n]
    sightings = []
    for number, (subject, place, known) in enumerate([*there, *mates]):
        away = math.dist(place, (x, y))
        angle = (math.atan2(place[1] - y, place[0] - x) - heading + math.pi) % (2 * math.pi) - math.pi
        if abs(angle) > 1.0 or (tick + number) % 4:
            continue
        distance = robot.range * away + robot.bias + robot.range_sigma * rng.normal()
        angle += robot.bearing + robot.bearing_sigma * rng.normal()
        if rng.random() < robot.misread:
            distance, angle = 10 * rng.random(), 6 * rng.random() - 3
        sightings.append(Sighting(subject=subject, range=max(0.0, distance), bearing=angle, landmark=known))
    return sightings
