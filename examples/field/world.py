"""A field with robots and a ball of its own: how they really move, and what their sensors say. Nothing here is of the product.

Metres, radians, seconds. Errors are drawn from the numbers of a `Truth`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

WIDTH, HEIGHT = 10.0, 8.0
WALL = 0.5  # metres that a robot keeps from a wall


@dataclass(frozen=True)
class Truth:
    """The sigmas of all errors, and how often a sensor says something (s)."""

    along: float = 0.05  # of the way, per sqrt(m)
    turn: float = 0.03  # of the turn, per sqrt(s)
    gps: float = 0.3
    gps_every: float = 1.0
    gps_of: tuple[str, ...] = ("r1",)
    range: float = 0.1
    bearing: float = 0.03
    reach: float = 4.0  # how far a robot sees
    view: float = math.pi  # half of the angle that it sees
    seen_every: float = 0.5
    start: float = 0.1
    start_heading: float = 0.05
    ball: float = 0.3  # of the ball's random walk, per sqrt(s)
    rolls: float = 0.0  # m/s: in place of walking the ball rolls, and the walls throw it back
    dt: float = 0.1


@dataclass(frozen=True)
class Seen:
    subject: str
    range: float
    bearing: float


@dataclass(frozen=True)
class Said:
    """What the sensors of one robot say of one step."""

    distance: float
    turn: float
    dt: float
    start: tuple[float, float, float] | None = None
    gps: tuple[float, float] | None = None
    seen: tuple[Seen, ...] = ()


@dataclass
class World:
    """Mutable; `steps` moves it on."""

    seed: int
    truth: Truth = field(default_factory=Truth)
    robots: tuple[str, ...] = ("r1", "r2", "r3")

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)
        low, high = (WALL, WALL), (WIDTH - WALL, HEIGHT - WALL)
        self.poses = {r: np.array([*self.random.uniform(low, high), self.random.uniform(-3, 3)]) for r in self.robots}
        self.goals = {r: self.random.uniform(low, high) for r in self.robots}
        self.ball = self.random.uniform((2, 2), (WIDTH - 2, HEIGHT - 2))
        angle = self.random.uniform(-math.pi, math.pi) if self.truth.rolls else 0.0
        self.velocity = self.truth.rolls * np.array([math.cos(angle), math.sin(angle)])  # of the ball
        self.time = 0.0

    def steps(self, seconds: float) -> Iterator[Mapping[str, Said]]:
        """What each robot's sensors say, step by step, the starts first."""
        for number in range(round(seconds / self.truth.dt)):
            yield {robot: self._step(robot, number) for robot in self.robots}
            self._roll()
            self.time += self.truth.dt

    def _step(self, robot: str, number: int) -> Said:
        truth, draw = self.truth, self.random.normal
        pose, dt = self.poses[robot], self.truth.dt
        if number == 0:
            start = pose + draw(size=3) * [truth.start, truth.start, truth.start_heading]
            return Said(0.0, 0.0, dt, start=(float(start[0]), float(start[1]), float(start[2])))
        while math.dist(pose[:2], self.goals[robot]) < 0.5:
            self.goals[robot] = self.random.uniform((WALL, WALL), (WIDTH - WALL, HEIGHT - WALL))
        dx, dy = self.goals[robot] - pose[:2]
        off = math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
        turn = float(np.clip(off, -1.0 * dt, 1.0 * dt))
        distance = (0.5 if abs(off) < 1.0 else 0.1) * dt
        pose[0] += distance * math.cos(pose[2] + turn / 2)
        pose[1] += distance * math.sin(pose[2] + turn / 2)
        pose[2] = math.remainder(pose[2] + turn, math.tau)
        measured = distance + draw() * truth.along * math.sqrt(distance), turn + draw() * truth.turn * math.sqrt(dt)
        gps = None
        if robot in truth.gps_of and number % round(truth.gps_every / dt) == 0:
            place = pose[:2] + draw(size=2) * truth.gps
            gps = float(place[0]), float(place[1])
        sightings = tuple(self._seen(robot)) if (number + 1) % round(truth.seen_every / dt) == 0 else ()
        return Said(*measured, dt, gps=gps, seen=sightings)

    def _seen(self, robot: str) -> Iterator[Seen]:
        pose, draw = self.poses[robot], self.random.normal
        things = {f"robot/{r}": self.poses[r][:2] for r in self.robots if r != robot} | {"object/ball": self.ball}
        for subject, place in things.items():
            dx, dy = place - pose[:2]
            bearing = math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
            if math.hypot(dx, dy) < self.truth.reach and abs(bearing) < self.truth.view:
                distance = max(0.0, math.hypot(dx, dy) + draw() * self.truth.range)
                yield Seen(subject, distance, bearing + draw() * self.truth.bearing)

    def _roll(self) -> None:
        if self.truth.rolls:
            place = self.ball + self.velocity * self.truth.dt
            low, high = np.array([0.0, 0.0]), np.array([WIDTH, HEIGHT])
            self.velocity = np.where((place < low) | (place > high), -self.velocity, self.velocity)
            self.ball = np.where(place < low, -place, np.where(place > high, 2 * high - place, place))
            return
        self.ball = self.ball + self.random.normal(size=2) * self.truth.ball * math.sqrt(self.truth.dt)
        self.ball = np.clip(self.ball, (WALL, WALL), (WIDTH - WALL, HEIGHT - WALL))
