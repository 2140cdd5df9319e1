"""A field played in virtual time: the product's robots and boards on a bus, beside the oracle. `python -m tests.field.play SEEDS`."""

import math
import sys
import time
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from blackboard.board.service import board_of
from blackboard.client.agreed import Agreed, TeamNews
from blackboard.config import Scenario
from blackboard.net.scheduler import Scheduler
from blackboard.opinion.gaussian.joint import Moments
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Sighting
from examples.field.central import Central
from examples.field.world import HEIGHT, WIDTH, Said, Truth, World
from robot_agent.driven import Driven, SinceStep, driven

CHI = {0.5: 1.386, 0.95: 5.991}
SETTLED = 5.0  # seconds after which errors count


@dataclass
class Score:
    """Errors (unit) of one subject's place, and whether the 95 % region held it."""

    squared: list[float] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    logs: list[float] = field(default_factory=list)  # nats: the log density at the truth

    def add(self, mean: np.ndarray, covariance: np.ndarray, truth: np.ndarray) -> None:
        apart = np.asarray(mean)[:2] - truth[:2]
        spread = np.asarray(covariance)[:2, :2]
        self.squared.append(float(apart @ apart))
        self.distances.append(float(apart @ np.linalg.solve(spread, apart)))
        self.logs.append(-0.5 * self.distances[-1] - 0.5 * math.log(np.linalg.det(spread)) - math.log(2 * math.pi))

    def take(self, other: "Score") -> None:
        """Take in all of another one."""
        self.squared += other.squared
        self.distances += other.distances
        self.logs += other.logs

    @property
    def log_score(self) -> float:
        return float(np.mean(self.logs)) if self.logs else math.nan

    @property
    def rmse(self) -> float:
        return math.sqrt(np.mean(self.squared)) if self.squared else math.nan

    def coverage(self, level: float = 0.95) -> float:
        return float(np.mean(np.array(self.distances) <= CHI[level])) if self.distances else math.nan


Scores = dict[str, dict[str, Score]]  # by who believes, and of what


def new_scores() -> Scores:
    return defaultdict(lambda: defaultdict(Score))


def add_all(totals: Scores, played: Scores) -> None:
    for who, scores in played.items():
        for name, score in scores.items():
            totals[who][name].take(score)


def note(scores: Scores, robot: str, pose: Moments | None, truth: np.ndarray, central: Central, alone: Central) -> None:
    """Judge a robot's place as its team, one filter with all readings, and one with its own have it, where the team does."""
    if pose is not None:
        scores["team"][robot].add(pose.mean, pose.covariance, truth)
        for who, oracle in (("central", central), ("alone", alone)):
            scores[who][robot].add(*oracle.of(f"robot/{robot}"), truth)


def show(totals: Scores) -> None:
    for name in totals["team"]:
        team, central, alone = (totals[who].get(name) or Score() for who in ("team", "central", "alone"))
        print(
            f"{name:6} team {team.rmse:.3f} central {central.rmse:.3f} alone {alone.rmse:.3f} ratio {team.rmse / central.rmse:.3f} "
            f"log {team.log_score:.3f} c50 {team.coverage(0.5):.3f} c95 {team.coverage():.3f} | central c95 {central.coverage():.3f}"
        )


def team_on(
    size: tuple[float, float], members: Iterable[str], board: Mapping[str, object], cell: float = 0.25, **more: object
) -> Scenario:
    """A board and its robots on a field of this size; `more` tables are the scenario's."""
    grid = {"shape": [round(side / cell) for side in size], "cell": cell, "unit": "m"}
    team = {"name": "t", "sub_teams": {"a": [*members]}}
    return Scenario({"team": team, "grid": grid, "board": {"fusion": "joint", **board}, **more})


def new_scenario(truth: Truth, *, told: bool = False, **board: object) -> Scenario:
    """`told`: the robots' odometry is in the scenario."""
    robot = {"robot": {"odometry": {"along": 0.05, "across": 0.0, "turn": truth.turn}}} if told else {}
    return team_on((WIDTH, HEIGHT), ("r1", "r2", "r3"), {"objects_drift": truth.ball, **board}, **robot)


def gathered(said: Said, truth: Truth, sigmas: bool) -> SinceStep:
    """What a robot is told; with `sigmas` how exact its odometry is, too."""
    own = {}
    if sigmas:
        own = {
            "distance_sigma": truth.along * math.sqrt(abs(said.distance)),
            "turn_sigma": truth.turn * math.sqrt(said.dt),
        }
    fix = None
    if said.start is not None:
        fix = Fix(position=said.start[:2], sigma=truth.start, heading=said.start[2], heading_sigma=truth.start_heading)
    elif said.gps is not None:
        fix = Fix(position=said.gps, sigma=truth.gps)
    return SinceStep(
        None if said.start is not None else Odometry(distance=said.distance, turn=said.turn, dt=said.dt, **own),
        None,
        fix,
        tuple(
            Sighting(
                subject=s.subject,
                range=s.range,
                bearing=math.remainder(s.bearing, math.tau),
                range_sigma=truth.range,
                bearing_sigma=truth.bearing,
            )
            for s in said.seen
        ),
    )


def posterior(said: Said, truth: Truth, sigmas: bool, own: Central, robot: str) -> SinceStep:
    """The same of a robot with a filter of its own, which took what the sensors said but the sightings."""
    step = gathered(said, truth, sigmas)
    mean, covariance = own.of(f"robot/{robot}")
    still = Odometry(distance=0.0, turn=0.0, dt=said.dt)
    return SinceStep(step.odometry or still, None, None, step.sightings, posterior=Moments(mean, covariance))


def parts_alone(since: SinceStep, kind: Literal["range", "bearing"]) -> SinceStep:
    """The same with the ranges, or the bearings, of its sightings alone."""
    seen = []
    for sighting in since.sightings:
        value, sigma = getattr(sighting, kind), getattr(sighting, f"{kind}_sigma")
        seen.append(Seen(subject=sighting.subject, kind=kind, values=(value,), covariance=(sigma**2,)))
    return replace(since, sightings=(), seen=tuple(seen))


class Robots(Scheduler):
    """A board and the robots of a scenario on one bus, which begins `began` seconds after a board's period does."""

    def __init__(self, chosen: Scenario, began: float = 0.0) -> None:
        super().__init__(now=1_700_000_000.0 + began)
        self.cell = chosen.grid.cell
        self.agreed: dict[str, Agreed] = {}
        self.robots: dict[str, Driven] = {}
        self.board = board_of(chosen, "a", "board-a")
        self.join(self.board)
        for robot in chosen.team.robots:
            news = TeamNews(chosen.grid, lambda agreed: self.agreed.update({agreed.subject: agreed})).on_news
            joint = chosen.board.fusion == "joint"
            named = {"team": "t", "sub_teams": ["a"], "robot": robot, "grid": chosen.grid, "joint": joint}
            self.robots[robot] = driven(news, chosen, **named)
            self.join(self.robots[robot])

    def note_ball(self, scores: Scores, name: str, truth: np.ndarray, central: Central) -> None:
        """Judge what is agreed on about the ball, if anything is."""
        if (ball := self.agreed.get("object/ball")) is not None:
            mean, covariance = ball.belief.mean(), ball.belief.covariance() + np.eye(2) * self.cell**2 / 12
            scores["team"][name].add(mean, covariance, truth)
            scores["central"][name].add(*central.of("object/ball"), truth)


class Field(Robots):
    """Boards and robots of a scenario, whose robots are driven by a world.

    `own`: they have filters of their own, whose posteriors come in each so many steps, with the odometry since the one before.
    `fed_back`: these take what the team believes for a measurement. `unplaced`: these are not told where they start. All claim
    `cautious` times the noise that their cameras have, and see ranges or bearings `alone`. It begins `began` seconds after a board's
    period does. Robots drive on while their odometry is `silent`, from and until a time (s). What they see they are told so many
    steps `late`.
    """

    def __init__(
        self,
        world: World,
        chosen: Scenario,
        sigmas: bool = True,
        phases: Mapping[str, float] | None = None,
        *,
        own: int = 0,
        fed_back: bool = False,
        unplaced: tuple[str, ...] = (),
        cautious: float = 1.0,
        alone: Literal["range", "bearing"] | None = None,
        began: float = 0.0,
        silent: Mapping[str, tuple[float, float]] | None = None,
        late: int = 0,
    ) -> None:
        super().__init__(chosen, began)
        self.late = {robot: deque[tuple[Sighting, ...]]([()] * late) for robot in world.robots}
        self.silent = dict(silent or {})
        self.world, self.sigmas, self.own, self.fed_back, self.unplaced = world, sigmas, own, fed_back, unplaced
        self.alone = alone
        self.claimed = replace(world.truth, range=cautious * world.truth.range, bearing=cautious * world.truth.bearing)
        self.phases = dict(phases or {})  # robot -> seconds that it steps late
        self.number = 0  # of steps
        self.driven: dict[str, SinceStep] = {}  # odometry since the newest posterior
        self.work: list[float] = []
        self.ages: list[float] = []  # of what is agreed on the ball, in seconds, whenever a robot steps

    def _as_late(self, robot: str, since: SinceStep) -> SinceStep:
        held = self.late[robot]
        held.append(since.sightings)
        age = (len(held) - 1) * self.world.truth.dt
        return replace(since, sightings=tuple(s.model_copy(update={"age": age}) for s in held.popleft()))

    def _slow(self, robot: str, since: SinceStep) -> SinceStep:
        driven = self.driven.get(robot, SinceStep()).plus(SinceStep(since.odometry))
        if self.number and (self.number + 1) % self.own:
            self.driven[robot] = driven
            return replace(since, odometry=None, posterior=None)
        self.driven[robot] = SinceStep()
        return replace(since, odometry=driven.odometry)

    def play(self, seconds: float) -> Scores:
        """Scores by who believes (`team`, `central`, `alone`) and subject."""
        world, truth = self.world, self.world.truth
        central = Central(dict.fromkeys(world.robots, truth))
        alone = {robot: Central({robot: truth}) for robot in world.robots}
        scores = new_scores()
        begin = self.now + 1.0
        self.run_to(begin)
        for self.number, said in enumerate(world.steps(seconds)):
            at = begin + world.time
            central.step(said, truth.dt)
            settled = world.time >= SETTLED
            for robot, step in said.items():
                alone[robot].step({robot: Said(step.distance, step.turn, step.dt, step.start, step.gps)}, step.dt)
                self.run_to(max(self.now, at + self.phases.get(robot, 0.0)))
                since = gathered(step, self.claimed, self.sigmas)
                if robot in self.unplaced and step.start is not None:
                    since = SinceStep()
                if robot in self.silent and self.silent[robot][0] <= world.time < self.silent[robot][1]:
                    since = replace(since, odometry=None)
                if self.own:
                    if self.fed_back and (before := self.robots[robot].pose()) is not None:
                        alone[robot].take(before.mean, before.covariance)
                    since = self._slow(robot, posterior(step, truth, self.sigmas, alone[robot], robot))
                since = self._as_late(robot, since)
                since = since if self.alone is None else parts_alone(since, self.alone)
                if settled and (ball := self.agreed.get("object/ball")) is not None:
                    self.ages.append(self.now - ball.time)
                began = time.thread_time()
                pose, out = self.robots[robot].step(since, self.now, at)
                self.work.append(time.thread_time() - began)
                self.send(self.robots[robot], out)
                if settled:
                    note(scores, robot, pose, world.poses[robot], central, alone[robot])
            ball = self.agreed.get("object/ball")
            if settled:
                self.note_ball(scores, "ball", world.ball, central)
            if settled and ball is not None and ball.velocity is not None:
                scores["team"]["velocity"].add(ball.velocity.mean, ball.velocity.covariance, world.velocity)
        return scores


def main(
    seeds: list[int], told: bool, sigmas: bool, own: bool, fed_back: bool, seconds: float = 90.0, **board: object
) -> None:
    totals = new_scores()
    work, ages, phases = list[float](), list[float](), {"r2": 0.03, "r3": 0.06}
    for seed in seeds:
        world = World(seed)
        began = 0.2 * (0.618 * seed % 1.0)  # no robot knows when a board's periods begin
        chosen = new_scenario(world.truth, told=told, **board)
        field_ = Field(world, chosen, sigmas, phases, own=own, fed_back=fed_back, began=began)
        add_all(totals, field_.play(seconds))
        work += field_.work
        ages += field_.ages
        for robot, driven_robot in field_.robots.items():
            if (judged := driven_robot.independence) is not None:
                print(seed, robot, judged.gains, judged.ratio, judged.fed_back, flush=True)
    show(totals)
    print(f"step: median {1000 * np.median(work):.1f} ms, 95 % {1000 * np.quantile(work, 0.95):.1f} ms")
    print(f"ball's age: mean {np.mean(ages):.3f} s, 95 % {np.quantile(ages, 0.95):.3f} s, most {max(ages):.3f} s")


if __name__ == "__main__":
    main(
        list(range(int(sys.argv[1]), int(sys.argv[2]))),
        *(word in sys.argv for word in ("told", "sigmas", "own", "back")),
    )
