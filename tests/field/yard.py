"""A yard with four unlike robots that step when they like, played in virtual time. `python -m tests.field.yard FIRST PAST`.

Each has sensors, rates and errors of its own, and none is described in the scenario. Beside it is one filter with all readings and the
true models. Metres, radians, seconds.
"""

import heapq
import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from blackboard.board.service import board_of
from blackboard.client.agreed import Agreed, TeamNews
from blackboard.config import Scenario
from blackboard.net.scheduler import Scheduler
from blackboard.opinion.gaussian.joint import Moments
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Sighting
from robot_agent.driven import Driven, SinceStep, driven
from tests.field.play import SETTLED, Score

WIDTH, HEIGHT, WALL = 30.0, 18.0, 1.0
BALL = "object/ball"
START = (0.2, 0.2, 0.05)  # sigmas of the starting pose that a robot is given: x, y (m), heading (rad)
WALK = 0.2  # of the ball, per sqrt(s)
FLAT = 1e4  # variance (m^2) of a position before anything was measured
CELL = 0.5


@dataclass(frozen=True)
class Kit:
    """What a robot is: sigmas of its errors and how often (s) its sensors say something; 0: it has no such sensor."""

    hertz: float
    speed: float  # m/s
    along: float  # of the way, per sqrt(m)
    turn: float  # of the turn, per sqrt(s)
    way: float = 1.0  # what the wheels tell of a way of 1
    gps: float = 0.0
    gps_every: float = 1.0
    compass: float = 0.0
    range: float = 0.0
    bearing: float = 0.0
    reach: float = 12.0
    view: float = math.pi  # half of the angle
    seen_every: float = 0.5
    ranging: float = 0.0  # to mates alone
    ranged_every: float = 0.5
    own: bool = False  # it has a filter of its own, without what it sees
    late: float = 0.3  # share of a step by which steps jitter


KITS = {
    "gnss": Kit(10.0, 1.0, 0.05, 0.03, gps=0.5, compass=0.05),
    "wheel": Kit(12.0, 0.6, 0.04, 0.02, range=0.15, bearing=0.03, view=1.2, seen_every=0.25),
    "tag": Kit(5.0, 0.5, 0.06, 0.03, compass=0.08, ranging=0.1, ranged_every=0.4),
    "own": Kit(8.0, 0.8, 0.05, 0.03, gps=0.8, gps_every=2.0, range=0.2, bearing=0.04, reach=8.0, own=True),
}


@dataclass(frozen=True)
class Step:
    """What the sensors of a robot say of its step that ends at a time."""

    time: float
    robot: str
    distance: float
    turn: float
    dt: float
    start: tuple[float, float, float] | None = None
    gps: tuple[float, float] | None = None
    compass: float | None = None
    seen: tuple[tuple[str, float, float], ...] = ()
    ranged: tuple[tuple[str, float], ...] = ()


class World:
    """Mutable: how all really move."""

    def __init__(self, seed: int, kits: dict[str, Kit] = KITS) -> None:
        self.random, self.kits = np.random.default_rng(seed), kits
        low, high = (WALL, WALL), (WIDTH - WALL, HEIGHT - WALL)
        self.low, self.high = low, high
        self.poses = {r: np.array([*self.random.uniform(low, high), self.random.uniform(-3, 3)]) for r in kits}
        self.goals = {r: self.random.uniform(low, high) for r in kits}
        self.ball = self.random.uniform((8, 5), (22, 13))
        self.moved = 0.0
        self.due: dict[tuple[str, str], float] = defaultdict(float)

    def steps(self, seconds: float) -> Iterator[Step]:
        """In the order of their ends; the first of each robot is its start."""
        queue = [(float(self.random.uniform(0, 0.1)), robot, 0.0) for robot in self.kits]
        heapq.heapify(queue)
        first = set(self.kits)
        while queue[0][0] < seconds:
            time, robot, before = heapq.heappop(queue)
            walked = WALK * math.sqrt(time - self.moved)
            self.ball = np.clip(self.ball + self.random.normal(size=2) * walked, self.low, self.high)
            self.moved = time
            if robot in first:
                first.discard(robot)
                start = self.poses[robot] + self.random.normal(size=3) * START
                yield Step(time, robot, 0.0, 0.0, 0.0, start=tuple(start))
            else:
                yield self._step(robot, time, time - before)
            kit = self.kits[robot]
            pause = (1 + kit.late * self.random.uniform(-1, 1)) / kit.hertz
            heapq.heappush(queue, (time + pause, robot, time))

    def _step(self, robot: str, time: float, dt: float) -> Step:
        kit, draw, pose = self.kits[robot], self.random.normal, self.poses[robot]
        while math.dist(pose[:2], self.goals[robot]) < 1.0:
            self.goals[robot] = self.random.uniform(self.low, self.high)
        dx, dy = self.goals[robot] - pose[:2]
        off = math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
        turn = float(np.clip(off, -dt, dt))
        distance = kit.speed * (1.0 if abs(off) < 1.0 else 0.2) * dt
        pose[:2] += distance * np.array([math.cos(pose[2] + turn / 2), math.sin(pose[2] + turn / 2)])
        pose[2] = math.remainder(pose[2] + turn, math.tau)
        step = kit.way * (distance + draw() * kit.along * math.sqrt(distance)), turn + draw() * kit.turn * math.sqrt(dt)
        gps = compass = None
        if kit.gps and self._is_due(robot, "gps", kit.gps_every, time):
            place = pose[:2] + draw(size=2) * kit.gps
            gps = float(place[0]), float(place[1])
        if kit.compass:
            compass = math.remainder(pose[2] + draw() * kit.compass, math.tau)
        sightings, ranged = [], []
        if kit.range and self._is_due(robot, "seen", kit.seen_every, time):
            for subject, (far, bearing) in self._around(robot).items():
                if far < kit.reach and abs(bearing) < kit.view:
                    sightings.append((subject, max(0.0, far + draw() * kit.range), bearing + draw() * kit.bearing))
        if kit.ranging and self._is_due(robot, "ranged", kit.ranged_every, time):
            for subject, (far, _) in self._around(robot).items():
                if subject != BALL:
                    ranged.append((subject, max(0.0, far + draw() * kit.ranging)))
        return Step(time, robot, *step, dt, gps=gps, compass=compass, seen=tuple(sightings), ranged=tuple(ranged))

    def _is_due(self, robot: str, what: str, every: float, time: float) -> bool:
        if time < self.due[robot, what]:
            return False
        self.due[robot, what] = time + every
        return True

    def _around(self, robot: str) -> dict[str, tuple[float, float]]:
        pose = self.poses[robot]
        things = {f"robot/{r}": self.poses[r][:2] for r in self.kits if r != robot} | {BALL: self.ball}
        around = {}
        for subject, place in things.items():
            dx, dy = place - pose[:2]
            around[subject] = math.hypot(dx, dy), math.remainder(math.atan2(dy, dx) - pose[2], math.tau)
        return around


class Filter:
    """An extended Kalman filter of the readings of some robots, with the true models: x, y, heading of each, then x, y of the ball."""

    def __init__(self, kits: dict[str, Kit]) -> None:
        self.kits = kits
        self.at = {f"robot/{robot}": slice(3 * i, 3 * i + 3) for i, robot in enumerate(kits)}
        n = 3 * len(kits)
        self.at[BALL] = slice(n, n + 2)
        self.mean, self.covariance = np.zeros(n + 2), np.eye(n + 2) * FLAT
        self.mean[n:] = WIDTH / 2, HEIGHT / 2
        self.time = 0.0
        self.ball_seen = False

    def of(self, subject: str) -> Moments:
        at = self.at[subject]
        return Moments(self.mean[at].copy(), self.covariance[at, at].copy())

    def step(self, step: Step) -> None:
        at, kit = self.at[f"robot/{step.robot}"], self.kits[step.robot]
        self.covariance[self.at[BALL], self.at[BALL]] += np.eye(2) * WALK**2 * (step.time - self.time)
        self.time = step.time
        if step.start is not None:
            self.mean[at], self.covariance[at, at] = step.start, np.diag(np.square(START))
        else:
            self._drive(at, kit, step)
        if step.gps is not None:
            self._correct(np.array(step.gps) - self.mean[at][:2], {at.start: np.eye(2, 3)}, np.eye(2) * kit.gps**2)
        if step.compass is not None:
            off = math.remainder(step.compass - self.mean[at][2], math.tau)
            self._correct(np.array([off]), {at.start: np.array([[0.0, 0.0, 1.0]])}, np.eye(1) * kit.compass**2)
        for subject, far, bearing in step.seen:
            if subject in self.at:
                self._see(at, kit, subject, far, bearing)
        for subject, far in step.ranged:
            if subject in self.at:
                self._range(at, kit, subject, far)

    def _drive(self, at: slice, kit: Kit, step: Step) -> None:
        x, y, heading = self.mean[at]
        distance = step.distance / kit.way
        c, s = math.cos(heading + step.turn / 2), math.sin(heading + step.turn / 2)
        self.mean[at] = x + distance * c, y + distance * s, heading + step.turn
        transition = np.eye(len(self.mean))
        transition[at, at][:2, 2] = -distance * s, distance * c
        by = np.array([[c, -distance * s / 2], [s, distance * c / 2], [0, 1]])
        noise = np.diag([kit.along**2 * abs(distance), kit.turn**2 * step.dt])
        self.covariance = transition @ self.covariance @ transition.T
        self.covariance[at, at] += by @ noise @ by.T

    def _see(self, at: slice, kit: Kit, subject: str, far: float, bearing: float) -> None:
        its = self.at[subject]
        if subject == BALL and not self.ball_seen:
            angle = self.mean[at][2] + bearing
            self.mean[its] = self.mean[at][:2] + far * np.array([math.cos(angle), math.sin(angle)])
            self.ball_seen = True
        dx, dy = self.mean[its][:2] - self.mean[at][:2]
        d = max(math.hypot(dx, dy), 1e-6)
        place = np.array([[dx / d, dy / d], [-dy / d**2, dx / d**2]])
        off = math.remainder(bearing - math.atan2(dy, dx) + self.mean[at][2], math.tau)
        mine = np.column_stack([-place, [0.0, -1.0]])
        self._correct(
            np.array([far - d, off]), {its.start: place, at.start: mine}, np.diag([kit.range**2, kit.bearing**2])
        )

    def _range(self, at: slice, kit: Kit, subject: str, far: float) -> None:
        its = self.at[subject]
        dx, dy = self.mean[its][:2] - self.mean[at][:2]
        d = max(math.hypot(dx, dy), 1e-6)
        place = np.array([[dx / d, dy / d]])
        self._correct(np.array([far - d]), {its.start: place, at.start: -place}, np.eye(1) * kit.ranging**2)

    def _correct(self, residual: np.ndarray, parts: dict[int, np.ndarray], noise: np.ndarray) -> None:
        rows = np.zeros((len(residual), len(self.mean)))
        for start, part in parts.items():
            rows[:, start : start + part.shape[1]] = part
        gain = self.covariance @ rows.T @ np.linalg.inv(rows @ self.covariance @ rows.T + noise)
        self.mean = self.mean + gain @ residual
        rest = np.eye(len(self.mean)) - gain @ rows
        self.covariance = rest @ self.covariance @ rest.T + gain @ noise @ gain.T


@dataclass
class Options:
    told: bool = False  # whether the odometry comes with sigmas; all other measurements do
    late: float = 0.02  # seconds from a step's end to the call


def readings(step: Step, kit: Kit, options: Options, own: Filter | None) -> SinceStep:
    sigmas = (
        {"distance_sigma": kit.way * kit.along * math.sqrt(abs(step.distance) + 1e-9), "turn_sigma": kit.turn * math.sqrt(step.dt)}
        if options.told and step.dt
        else {}
    )  # fmt: skip
    fix = compass = None
    if step.start is not None:
        fix = Fix(position=step.start[:2], sigma=START[0], heading=step.start[2], heading_sigma=START[2])
    elif step.gps is not None:
        fix = Fix(position=step.gps, sigma=kit.gps)
    if step.compass is not None:
        compass = step.compass, kit.compass
    odometry = Odometry(distance=step.distance, turn=step.turn, dt=step.dt, **sigmas) if step.dt else None
    sightings = tuple(
        Sighting(
            subject=subject,
            range=far,
            bearing=math.remainder(bearing, math.tau),
            range_sigma=kit.range,
            bearing_sigma=kit.bearing,
        )
        for subject, far, bearing in step.seen
    )
    ranged = tuple(
        Seen(subject=subject, kind="range", values=(far,), covariance=(kit.ranging**2,)) for subject, far in step.ranged
    )
    if own is None:
        return SinceStep(odometry, compass, fix, sightings, ranged)
    return SinceStep(
        odometry or Odometry(distance=0.0, turn=0.0, dt=1 / kit.hertz),
        None,
        None,
        sightings,
        ranged,
        posterior=own.of(f"robot/{step.robot}"),
    )


class Yard(Scheduler):
    """A board and a team of robots that are driven by a world."""

    def __init__(self, world: World, options: Options, began: float = 0.0, **board: object) -> None:
        super().__init__(now=1_700_000_000.0 + began)
        self.world, self.options = world, options
        robots = list(world.kits)
        chosen = Scenario(
            {
                "team": {"name": "t", "sub_teams": {"a": robots}},
                "grid": {"shape": [round(WIDTH / CELL), round(HEIGHT / CELL)], "cell": CELL, "unit": "m"},
                "board": {"fusion": "joint", **board},
            }
        )
        self.agreed: dict[str, Agreed] = {}
        self.robots: dict[str, Driven] = {}
        self.board = board_of(chosen, "a", "board-a")
        self.join(self.board)
        for robot in robots:
            news = TeamNews(chosen.grid, lambda agreed: self.agreed.update({agreed.subject: agreed})).take
            driven_robot = driven(
                news, chosen, team="t", sub_teams=["a"], robot=robot, grid=chosen.grid, joint=chosen.board.fusion == "joint"
            )  # fmt: skip
            self.robots[robot] = driven_robot
            self.join(driven_robot)

    def play(self, seconds: float) -> dict[str, dict[str, Score]]:
        """Scores by who believes (`team`, `central`, `alone`) and robot."""
        world = self.world
        central = Filter(world.kits)
        alone = {robot: Filter({robot: kit}) for robot, kit in world.kits.items()}
        scores: dict[str, dict[str, Score]] = defaultdict(lambda: defaultdict(Score))
        begin = self.now + 1.0
        self.run_to(begin)
        for step in world.steps(seconds):
            robot, kit = step.robot, world.kits[step.robot]
            truth = world.poses[robot].copy()
            central.step(step)
            alone[robot].step(step)
            self.run_to(max(self.now, begin + step.time + self.options.late))
            since = readings(step, kit, self.options, alone[robot] if kit.own else None)
            pose, out = self.robots[robot].step(since, self.now, begin + step.time)
            self.send(self.robots[robot], out)
            if step.time < SETTLED:
                continue
            subject = f"robot/{robot}"
            best = central.of(subject)
            if pose is not None:
                scores["team"][robot].add(pose.mean, pose.covariance, truth)
                scores["central"][robot].add(best.mean, best.covariance, truth)
                its = alone[robot].of(subject)
                scores["alone"][robot].add(its.mean, its.covariance, truth)
            ball = self.agreed.get(BALL)
            if ball is not None and robot == next(iter(world.kits)):
                mean, covariance = ball.belief.mean(), ball.belief.covariance() + np.eye(2) * CELL**2 / 12
                scores["team"][BALL].add(mean, covariance, world.ball)
                best = central.of(BALL)
                scores["central"][BALL].add(best.mean, best.covariance, world.ball)
        return scores


def main(seeds: list[int], options: Options, seconds: float = 90.0) -> None:
    totals: dict[str, dict[str, Score]] = defaultdict(lambda: defaultdict(Score))
    for seed in seeds:
        yard = Yard(World(seed), options, began=0.2 * (0.618 * seed % 1.0))
        played = yard.play(seconds)
        for name, team in played["team"].items():
            best = played["central"][name]
            print(
                f"{seed} {name:6} team {team.rmse:.3f} central {best.rmse:.3f} ratio {team.rmse / best.rmse:.2f} "
                f"c95 {team.coverage():.2f} | {best.coverage():.2f}",
                flush=True,
            )
        for who, scores in played.items():
            for name, score in scores.items():
                totals[who][name].take(score)
    for name in totals["team"]:
        team, central, alone = (totals[who].get(name) or Score() for who in ("team", "central", "alone"))
        print(
            f"{name:6} team {team.rmse:.3f} central {central.rmse:.3f} alone {alone.rmse:.3f} ratio {team.rmse / central.rmse:.3f} "
            f"c50 {team.coverage(0.5):.3f} c95 {team.coverage():.3f} | central c50 {central.coverage(0.5):.3f} c95 {central.coverage():.3f}"
        )


if __name__ == "__main__":
    main(list(range(int(sys.argv[1]), int(sys.argv[2]))), Options(told="told" in sys.argv))
