"""A field with robots and a ball of its own: how they really move, and what their sensors say. Nothing here is of the product.

Metres, radians, seconds. Errors are drawn from the numbers of a `Truth`.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT = 10.0, 8.0
WALL = 0.5  # metres that a robot keeps from a wall
ROBOTS = ("r1", "r2", "r3")
BALL = "object/ball"

Point = tuple[float, float] | np.ndarray


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


class Arena:
    """Mutable: robots that drive from goal to goal, a ball, and what sensors measure of them."""

    def __init__(
        self, random: np.random.Generator, robots: Iterable[str], low: Point, high: Point, near: float = 0.5
    ) -> None:
        """Goals are between the corners `low` and `high`; a robot has reached one that is `near`."""
        self.random, self.low, self.high, self.near = random, low, high, near
        robots = tuple(robots)
        self.poses = {r: np.array([*random.uniform(low, high), random.uniform(-3, 3)]) for r in robots}
        self.goals = {r: random.uniform(low, high) for r in robots}
        self.ball = np.zeros(2)

    def start(self, robot: str, truth: Truth) -> tuple[float, float, float]:
        """The start pose that a robot is given: the true one with an error drawn from `start` and `start_heading`."""
        sigmas = truth.start, truth.start, truth.start_heading
        x, y, heading = self.poses[robot] + self.random.normal(size=3) * sigmas
        return float(x), float(y), float(heading)

    def drive(
        self, robot: str, truth: Truth, dt: float, speed: float = 0.5, turning: float = 1.0
    ) -> tuple[float, float]:
        """Move a robot on towards its goal; way and turn as its wheels measure them. It slows down to turn."""
        pose, draw = self.poses[robot], self.random.normal
        while math.dist(pose[:2], self.goals[robot]) < self.near:
            self.goals[robot] = self.random.uniform(self.low, self.high)
        dx, dy = self.goals[robot] - pose[:2]
        off = math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
        turn = float(np.clip(off, -turning * dt, turning * dt))
        distance = speed * (1.0 if abs(off) < 1.0 else 0.2) * dt
        pose[:2] += distance * np.array([math.cos(pose[2] + turn / 2), math.sin(pose[2] + turn / 2)])
        pose[2] = math.remainder(pose[2] + turn, math.tau)
        return distance + draw() * truth.along * math.sqrt(distance), turn + draw() * truth.turn * math.sqrt(dt)

    def fix(self, robot: str, truth: Truth) -> tuple[float, float]:
        """The place that a robot's GPS measures."""
        x, y = self.poses[robot][:2] + self.random.normal(size=2) * truth.gps
        return float(x), float(y)

    def around(self, robot: str) -> dict[str, tuple[float, float]]:
        """The true range and bearing of the mates and the ball, by subject."""
        pose, around = self.poses[robot], {}
        things = {f"robot/{r}": other[:2] for r, other in self.poses.items() if r != robot} | {BALL: self.ball}
        for subject, place in things.items():
            dx, dy = place - pose[:2]
            around[subject] = math.hypot(dx, dy), math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
        return around

    def seen(self, robot: str, truth: Truth) -> tuple[Seen, ...]:
        """The mates and the ball that a robot's camera sees now."""
        draw = self.random.normal
        return tuple(
            Seen(subject, max(0.0, far + draw() * truth.range), bearing + draw() * truth.bearing)
            for subject, (far, bearing) in self.around(robot).items()
            if far < truth.reach and abs(bearing) < truth.view
        )


def bounced(place: np.ndarray, velocity: np.ndarray, size: Point) -> tuple[np.ndarray, np.ndarray]:
    """A place beyond the walls, and the velocity that led there, as walls throw them back. One corner is the origin."""
    low, high = place < 0.0, place > size
    back = np.where(low, -place, np.where(high, 2 * np.asarray(size) - place, place))
    return back, np.where(low | high, -velocity, velocity)


class World(Arena):
    """Mutable; `steps` moves it on."""

    def __init__(self, seed: int, truth: Truth = Truth(), robots: tuple[str, ...] = ROBOTS) -> None:
        self.truth, self.robots, self.time = truth, robots, 0.0
        super().__init__(np.random.default_rng(seed), robots, (WALL, WALL), (WIDTH - WALL, HEIGHT - WALL))
        self.ball = self.random.uniform((2, 2), (WIDTH - 2, HEIGHT - 2))
        angle = self.random.uniform(-math.pi, math.pi) if truth.rolls else 0.0
        self.velocity = truth.rolls * np.array([math.cos(angle), math.sin(angle)])  # of the ball

    def steps(self, seconds: float) -> Iterator[Mapping[str, Said]]:
        """What each robot's sensors say, step by step, the starts first."""
        for number in range(round(seconds / self.truth.dt)):
            yield {robot: self._step(robot, number) for robot in self.robots}
            self._roll()
            self.time += self.truth.dt

    def _step(self, robot: str, number: int) -> Said:
        truth, dt = self.truth, self.truth.dt
        if number == 0:
            return Said(0.0, 0.0, dt, start=self.start(robot, truth))
        distance, turn = self.drive(robot, truth, dt)
        has_fix = robot in truth.gps_of and number % round(truth.gps_every / dt) == 0
        fix = self.fix(robot, truth) if has_fix else None
        is_looking = (number + 1) % round(truth.seen_every / dt) == 0
        return Said(distance, turn, dt, gps=fix, seen=self.seen(robot, truth) if is_looking else ())

    def _roll(self) -> None:
        truth = self.truth
        if truth.rolls:
            self.ball, self.velocity = bounced(self.ball + self.velocity * truth.dt, self.velocity, (WIDTH, HEIGHT))
            return
        self.ball = self.ball + self.random.normal(size=2) * truth.ball * math.sqrt(truth.dt)
        self.ball = np.clip(self.ball, self.low, self.high)
