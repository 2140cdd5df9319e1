"""A yard with four unlike robots that step when they like, played in virtual time. `python -m tests.field.yard FIRST PAST`.

Each has sensors, rates and errors of its own, and none is described in the scenario. Beside it is one filter with all readings and the
true models. Metres, radians, seconds.
"""

import heapq
import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from blackboard.wire import evidence
from examples.field.central import Central
from examples.field.world import BALL, Arena, Said, Seen, Truth
from robot_agent.driven import SinceStep
from tests.field.play import SETTLED, Robots, Scores, add_all, gathered, new_scores, note, posterior, show, team_on

WIDTH, HEIGHT, WALL = 30.0, 18.0, 1.0
LATE = 0.02  # seconds after its end at which a robot hears of a step


@dataclass(frozen=True, kw_only=True)
class Kit(Truth):
    """What a robot is: sigmas of its errors and how often (s) its sensors say something; 0: it has no such sensor."""

    hertz: float
    speed: float  # m/s
    gps: float = 0.0
    compass: float = 0.0
    range: float = 0.0
    bearing: float = 0.0
    reach: float = 12.0
    ranging: float = 0.0  # to mates alone
    ranged_every: float = 0.5
    own: bool = False  # it has a filter of its own, without what it sees
    late: float = 0.3  # share of a step by which steps jitter
    start: float = 0.2
    ball: float = 0.2


KITS = {
    "gnss": Kit(hertz=10.0, speed=1.0, gps=0.5, compass=0.05),
    "wheel": Kit(hertz=12.0, speed=0.6, along=0.04, turn=0.02, range=0.15, bearing=0.03, view=1.2, seen_every=0.25),
    "tag": Kit(hertz=5.0, speed=0.5, along=0.06, compass=0.08, ranging=0.1, ranged_every=0.4),
    "own": Kit(hertz=8.0, speed=0.8, gps=0.8, gps_every=2.0, range=0.2, bearing=0.04, reach=8.0, own=True),
}


@dataclass(frozen=True, kw_only=True)
class Step(Said):
    """What the sensors of a robot say of its step that ends at a time."""

    time: float
    robot: str
    compass: float | None = None
    ranged: tuple[tuple[str, float], ...] = ()


class World(Arena):
    """Mutable: how all really move."""

    def __init__(self, seed: int, kits: dict[str, Kit] = KITS) -> None:
        self.kits = kits
        super().__init__(np.random.default_rng(seed), kits, (WALL, WALL), (WIDTH - WALL, HEIGHT - WALL), near=1.0)
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
            walked = self.kits[robot].ball * math.sqrt(time - self.moved)
            self.ball = np.clip(self.ball + self.random.normal(size=2) * walked, self.low, self.high)
            self.moved = time
            if robot in first:
                first.discard(robot)
                yield Step(0.0, 0.0, 0.0, time=time, robot=robot, start=self.start(robot, self.kits[robot]))
            else:
                yield self._step(robot, time, time - before)
            kit = self.kits[robot]
            pause = (1 + kit.late * self.random.uniform(-1, 1)) / kit.hertz
            heapq.heappush(queue, (time + pause, robot, time))

    def _step(self, robot: str, time: float, dt: float) -> Step:
        kit, draw = self.kits[robot], self.random.normal
        distance, turn = self.drive(robot, kit, dt, kit.speed)
        gps = compass = None
        if kit.gps and self._is_due(robot, "gps", kit.gps_every, time):
            gps = self.fix(robot, kit)
        if kit.compass:
            compass = math.remainder(self.poses[robot][2] + draw() * kit.compass, math.tau)
        seen, ranged = tuple[Seen, ...](), tuple[tuple[str, float], ...]()
        if kit.range and self._is_due(robot, "seen", kit.seen_every, time):
            seen = self.seen(robot, kit)
        if kit.ranging and self._is_due(robot, "ranged", kit.ranged_every, time):
            mates = [(mate, far) for mate, (far, _) in self.around(robot).items() if mate != BALL]
            ranged = tuple((mate, max(0.0, far + draw() * kit.ranging)) for mate, far in mates)
        return Step(distance, turn, dt, time=time, robot=robot, gps=gps, compass=compass, seen=seen, ranged=ranged)

    def _is_due(self, robot: str, what: str, every: float, time: float) -> bool:
        if time < self.due[robot, what]:
            return False
        self.due[robot, what] = time + every
        return True


class Filter(Central):
    """Some robots that step one by one. It takes compasses and ranges, too."""

    def __init__(self, kits: dict[str, Kit]) -> None:
        super().__init__(kits)
        self.kits, self.time = kits, 0.0

    def take_step(self, step: Step) -> None:
        self.step({step.robot: step}, step.time - self.time)
        self.time = step.time
        kit, at = self.kits[step.robot], self._at(f"robot/{step.robot}")
        if step.compass is not None:
            off = math.remainder(step.compass - self.mean[at][2], math.tau)
            self._correct(np.array([off]), np.eye(1, len(self.mean), at.start + 2), np.eye(1) * kit.compass**2)
        for subject, far in step.ranged:
            if self.knows(subject):
                dx, dy = self.of(subject)[0][:2] - self.mean[at][:2]
                d, rows = max(math.hypot(dx, dy), 1e-6), np.zeros((1, len(self.mean)))
                its = self._at(subject)
                rows[0, its.start : its.start + 2] = dx / d, dy / d
                rows[0, at.start : at.start + 2] = -dx / d, -dy / d
                self._correct(np.array([far - d]), rows, np.eye(1) * kit.ranging**2)


def readings(step: Step, kit: Kit, told: bool, own: Filter | None) -> SinceStep:
    """What a robot's sensors measured in a step, all but the odometry with their sigmas; `told`: the odometry with its sigmas, too."""
    since = gathered(step, kit, told)
    if step.compass is not None and own is None:
        since = replace(since, compass=(step.compass, kit.compass))
    elif own is not None:
        since = posterior(step if step.dt else replace(step, dt=1 / kit.hertz), kit, told, own, step.robot)
    ranged = (
        evidence.Seen(subject=subject, kind="range", values=(far,), covariance=(kit.ranging**2,))
        for subject, far in step.ranged
    )
    return replace(since, seen=tuple(ranged))


class Yard(Robots):
    """A board and a team of robots that are driven by a world."""

    def __init__(self, world: World, began: float = 0.0, told: bool = False) -> None:
        super().__init__(team_on((WIDTH, HEIGHT), world.kits, {}, cell=0.5), began)
        self.world, self.told = world, told

    def play(self, seconds: float) -> Scores:
        """Scores by who believes (`team`, `central`, `alone`) and robot."""
        world, scores = self.world, new_scores()
        central, alone = Filter(world.kits), {robot: Filter({robot: kit}) for robot, kit in world.kits.items()}
        begin = self.now + 1.0
        self.run_to(begin)
        for step in world.steps(seconds):
            robot, kit = step.robot, world.kits[step.robot]
            truth = world.poses[robot].copy()
            central.take_step(step)
            alone[robot].take_step(step)
            self.run_to(max(self.now, begin + step.time + LATE))
            since = readings(step, kit, self.told, alone[robot] if kit.own else None)
            pose, out = self.robots[robot].step(since, self.now, begin + step.time)
            self.send(self.robots[robot], out)
            if step.time >= SETTLED:
                note(scores, robot, pose, truth, central, alone[robot])
                if robot == next(iter(world.kits)):
                    self.note_ball(scores, BALL, world.ball, central)
        return scores


def main(seeds: list[int], told: bool, seconds: float = 90.0) -> None:
    totals = new_scores()
    for seed in seeds:
        played = Yard(World(seed), 0.2 * (0.618 * seed % 1.0), told).play(seconds)
        for name, team in played["team"].items():
            best = played["central"][name]
            print(
                f"{seed} {name:6} team {team.rmse:.3f} central {best.rmse:.3f} ratio {team.rmse / best.rmse:.2f} "
                f"c95 {team.coverage():.2f} | {best.coverage():.2f}",
                flush=True,
            )
        add_all(totals, played)
    show(totals)


if __name__ == "__main__":
    main(list(range(int(sys.argv[1]), int(sys.argv[2]))), "told" in sys.argv)
