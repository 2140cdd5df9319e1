"""The simulated world: where robots and objects really are, and what the sensors measure. Random numbers are an argument.

Robots and people travel at constant speed from waypoint to waypoint, turning at most `turn_rate`: in a step they turn, then go
straight along the new heading. Objects stand or do a random walk, reflected half a unit before the walls.

Every robot, object and person has random streams of its own, drawn from the seed by name (a sighting's by observer and
subject). So one more robot changes nothing about the others, except that they may see it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from blackboard.config.world import ObjectSection, WorldSection
from blackboard.errors import UserError
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Readings, Truth
from sim_world.sensors import Odometer, see

Streams = Callable[[str], np.random.Generator]  # name of a stream -> its generator, at its beginning
Place = tuple[float, float]

MAX_ROBOTS = 64  # each takes memory and time in every tick
WALL = 0.5  # unit: objects turn back this far from the edge


@dataclass
class Walker:
    """The true state of what goes from waypoint to waypoint."""

    x: float
    y: float
    heading: float
    waypoint: Place
    speed: float  # unit/s
    rng: np.random.Generator

    @property
    def place(self) -> Place:
        return self.x, self.y


@dataclass
class Body(Walker):
    """A robot as it really is."""

    odometer: Odometer
    start_fix_due: bool  # whether its next readings hold a fix of the place where it starts; never for a lost robot


class World:
    """The simulated world, a `sim_world.sources.SensorSource`."""

    def __init__(self, settings: WorldSection, grid: Grid, robots: Sequence[str], dt: float, streams: Streams) -> None:
        """`dt` is the length of a tick in seconds. UserError: no room to turn, or an object that starts outside."""
        self.settings, self.grid, self.dt, self.streams = settings, grid, dt, streams
        self.lower = grid.origin
        self.upper = tuple(o + n * grid.cell for o, n in zip(grid.origin, grid.shape, strict=True))
        speeds = {"world.speed: robots": settings.speed}
        if settings.people.count:
            speeds["world.people.speed: people"] = settings.people.speed
        for who, speed in speeds.items():
            radius = self._radius(speed)
            if min(u - o for o, u in zip(self.lower, self.upper, strict=True)) < 8 * radius:
                raise UserError(f"{who} that turn on {radius:g} have no room on this grid; lower the speed")
        self.bodies: dict[str, Body] = {}
        self.objects: dict[str, Place] = {}
        self.velocities: dict[str, Place] = {}  # of the objects that roll
        self._noise = cache(streams)  # goes on where it was left
        for name, thing in sorted(settings.objects.items()):
            self.objects[name] = self._start(name, thing)
            if thing.rolls:
                self.velocities[name] = _along(streams(f"way/{name}").uniform(-math.pi, math.pi), thing.rolls)
        names = [f"p{i + 1}" for i in range(settings.people.count)]
        self.people = {name: self._walker(f"person/{name}", settings.people.speed) for name in names}
        for robot in robots:
            self.admit(robot)

    @property
    def robots(self) -> tuple[str, ...]:
        return tuple(sorted(self.bodies))

    def admit(self, robot: str) -> bool:
        if robot not in self.bodies and len(self.bodies) < MAX_ROBOTS:
            odometer = Odometer(self.settings.odometry, self.streams(f"odometer/{robot}"))
            start_fix_due = robot not in self.settings.lost
            walker = self._walker(f"robot/{robot}", self.settings.speed)
            self.bodies[robot] = Body(**vars(walker), odometer=odometer, start_fix_due=start_fix_due)
        return robot in self.bodies

    def judged(self, tick: int) -> bool:
        return tick > 0

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        moved = {name: self._move(body) for name, body in sorted(self.bodies.items())} if tick else {}
        if tick:
            self.objects = {name: self._walk(name, self._roll(name, place)) for name, place in self.objects.items()}
            for _, person in sorted(self.people.items()):
                self._move(person)
        places = {f"robot/{name}": body.place for name, body in sorted(self.bodies.items())}
        places |= {f"object/{name}": place for name, place in self.objects.items()}
        places |= {f"person/{name}": person.place for name, person in self.people.items()}
        headings = {f"robot/{name}": body.heading for name, body in sorted(self.bodies.items())}
        ways = {name: way / self.dt for name, (way, _) in moved.items()}
        velocities = {f"robot/{name}": _along(self.bodies[name].heading, speed) for name, speed in ways.items()}
        velocities |= {f"object/{name}": velocity for name, velocity in self.velocities.items()}
        truth = Truth(
            run=run, tick=tick, time=tick * self.dt, positions=places, headings=headings, velocities=velocities
        )
        return truth, [self._sense(robot, truth, moved.get(robot)) for robot in self.robots]

    # --- motion -------------------------------------------------------------------------------------------------------

    def _move(self, body: Walker) -> tuple[float, float]:
        """Turn towards the waypoint and go; the distance and the turn of this step."""
        most = self.settings.turn_rate * self.dt
        wanted = wrap(math.atan2(body.waypoint[1] - body.y, body.waypoint[0] - body.x) - body.heading)
        turn = min(most, max(-most, wanted))
        distance = body.speed * self.dt
        body.heading = wrap(body.heading + turn)
        body.x += distance * math.cos(body.heading)
        body.y += distance * math.sin(body.heading)
        # A nearer waypoint might be circled for ever.
        if math.dist(body.place, body.waypoint) < 2 * self._radius(body.speed):
            body.waypoint = self._random_place(body.rng, body.speed)
        return distance, turn

    def _roll(self, name: str, place: Place) -> Place:
        """One step of an object that rolls and is thrown back by the walls."""
        if name not in self.velocities:
            return place
        way = [speed * self.dt for speed in self.velocities[name]]
        ends = list(zip(self.lower, self.upper, strict=True))
        x, y = (reflect(c + step, *end) for c, step, end in zip(place, way, ends, strict=True))
        back = [not lo + WALL <= c + step <= hi - WALL for c, step, (lo, hi) in zip(place, way, ends, strict=True)]
        vx, vy = (-speed if turned else speed for speed, turned in zip(self.velocities[name], back, strict=True))
        self.velocities[name] = vx, vy
        return x, y

    def _walk(self, name: str, place: Place) -> Place:
        """One step of an object's random walk."""
        drift = self.settings.objects[name].drift
        if not drift:
            return place
        steps = self._noise(f"object/{name}").normal(0.0, drift * math.sqrt(self.dt), 2)
        x, y = (
            reflect(c + float(s), lo, hi) for c, s, lo, hi in zip(place, steps, self.lower, self.upper, strict=True)
        )
        return x, y

    # --- sensors ------------------------------------------------------------------------------------------------------

    def _sense(self, robot: str, truth: Truth, moved: tuple[float, float] | None) -> Readings:
        """What a robot's sensors measure; `moved` is its distance and turn in this step, None at the start."""
        body = self.bodies[robot]
        odometry = None if moved is None else body.odometer.step(*moved, self.dt)
        fix = body.odometer.fix(body.place) if body.start_fix_due else body.odometer.fix_if_due(body.place)
        body.start_fix_due = False
        pose = (body.x, body.y, body.heading)
        seen = (
            see(self.settings.vision, pose, subject, place, self._noise(f"{robot} sees {subject}"))
            for subject, place in truth.positions.items()
            if subject != f"robot/{robot}"
        )
        return Readings(
            run=truth.run,
            robot=robot,
            tick=truth.tick,
            time=truth.time,
            odometry=odometry,
            compass=body.odometer.compass(body.heading),
            fix=fix,
            sightings=[sighting for sighting in seen if sighting is not None],
        )

    # --- random numbers -----------------------------------------------------------------------------------------------

    def _walker(self, stream: str, speed: float) -> Walker:
        rng = self.streams(stream)
        (x, y), waypoint = self._random_place(rng, speed), self._random_place(rng, speed)
        heading = math.atan2(waypoint[1] - y, waypoint[0] - x)  # towards the inside, so that it never leaves
        return Walker(x, y, heading, waypoint, speed, rng)

    def _radius(self, speed: float) -> float:
        """The radius of the tightest turn at a speed (unit)."""
        return speed / self.settings.turn_rate

    def _random_place(self, rng: np.random.Generator, speed: float) -> Place:
        """A place with room to turn on all sides, for who walks at this speed."""
        margin = 3 * self._radius(speed)
        x, y = (float(rng.uniform(lo + margin, hi - margin)) for lo, hi in zip(self.lower, self.upper, strict=True))
        return x, y

    def _start(self, name: str, thing: ObjectSection) -> Place:
        if thing.start is None:
            return self._random_place(self.streams(f"start/{name}"), self.settings.speed)
        if self.grid.index(thing.start) is None:
            raise UserError(f"world.objects.{name}.start: {thing.start} is outside the grid; give a place inside")
        return thing.start


def _along(heading: float, length: float) -> Place:
    return length * math.cos(heading), length * math.sin(heading)


def reflect(x: float, lower: float, upper: float) -> float:
    """A step over a wall, turned back; steps are small against the room."""
    lo, hi = lower + WALL, upper - WALL
    if x < lo:
        return min(2 * lo - x, hi)
    return max(2 * hi - x, lo) if x > hi else x
