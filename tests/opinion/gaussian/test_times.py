"""Robots whose ticks end at times of their own: a sighting relates where both were when it was taken."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import gained
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, STATES, Motion, Nuisance, correct, drive, entering, wrap
from blackboard.opinion.grid import Array

PART = 0.01  # seconds: how finely the world moves
TICK = 10  # parts in a tick of a robot
PHASES = {"robot/r1": 0, "robot/r2": 3, "robot/r3": 6}  # parts by which its ticks end later
NAMES = sorted(PHASES)
WAY, TURN = 0.01, 0.01  # noise of the odometry: metres / sqrt(metre), radians / sqrt(second)
FIX, RANGE, BEARING = 0.05, 0.01, 0.01  # sigmas: metres, metres, radians
START = np.diag([0.05, 0.05, 0.03]) ** 2
NUISANCE = Nuisance()


@dataclass
class Part:
    """What happened in one part: the steps of all, as measured, and the ticks that ended with it."""

    steps: dict[str, tuple[float, float]]
    poses: dict[str, Array]
    fixes: dict[str, Array]
    seen: dict[str, dict[str, tuple[float, float]]]  # observer -> subject -> range and bearing


def world(seed: int, seconds: float, tick: int = TICK) -> Iterator[Part]:
    """Three robots drive round with a speed and a turn rate that change; the first one has a fix in every tick of so many parts."""
    chance = np.random.default_rng(seed)
    poses = {name: np.array([3.0 * k, 2.0 * k % 3, 2.0 * k]) for k, name in enumerate(NAMES)}
    for number in range(1, round(seconds / PART) + 1):
        steps, fixes = dict[str, tuple[float, float]](), dict[str, Array]()
        sightings: dict[str, dict[str, tuple[float, float]]] = {}
        for k, name in enumerate(NAMES):
            time = number * PART + k
            way, turn = PART * (0.9 + 0.5 * math.sin(time)), PART * (0.5 + 0.5 * math.sin(0.7 * time))
            middle = poses[name][2] + turn / 2
            poses[name] = poses[name] + [way * math.cos(middle), way * math.sin(middle), turn]
            noise = chance.normal(size=2) * [WAY * math.sqrt(way), TURN * math.sqrt(PART)]
            steps[name] = way + noise[0], turn + noise[1]
        for name in [name for name in NAMES if (number - PHASES[name] * tick // TICK) % tick == 0]:
            if name == NAMES[0]:
                fixes[name] = poses[name][AXES] + chance.normal(size=2) * FIX
            sightings[name] = {}
            for other in NAMES:
                if other != name:
                    dx, dy = (poses[other] - poses[name])[AXES]
                    noise = chance.normal(size=2) * [RANGE, BEARING]
                    bearing = math.atan2(dy, dx) - poses[name][2] + noise[1]
                    sightings[name][other] = math.hypot(dx, dy) + noise[0], wrap(bearing)
        yield Part(steps, dict(poses), fixes, sightings)


class Oracle:
    """One filter that moves in parts, so that it has every sighting at its time; x, y, heading of each robot."""

    def __init__(self) -> None:
        self.mean = np.concatenate([[3.0 * k, 2.0 * k % 3, 2.0 * k] for k in range(3)])
        self.covariance = np.kron(np.eye(3), START)

    def take(self, part: Part) -> None:
        for k, name in enumerate(NAMES):
            at, (way, turn) = slice(3 * k, 3 * k + 3), part.steps[name]
            c, s = math.cos(self.mean[at][2] + turn / 2), math.sin(self.mean[at][2] + turn / 2)
            self.mean[at] += [way * c, way * s, turn]
            moved = np.eye(9)
            moved[3 * k, 3 * k + 2], moved[3 * k + 1, 3 * k + 2] = -way * s, way * c
            self.covariance = moved @ self.covariance @ moved.T
            along = np.array([c, s, 0.0])
            self.covariance[at, at] += WAY**2 * abs(way) * np.outer(along, along)
            self.covariance[at, at] += np.diag([0.0, 0.0, TURN**2 * PART])
        for k, name in enumerate(NAMES):
            if name in part.fixes:
                self._update(
                    part.fixes[name] - self.mean[3 * k : 3 * k + 2], np.eye(9)[3 * k : 3 * k + 2], np.eye(2) * FIX**2
                )
            for other, (distance, bearing) in part.seen.get(name, {}).items():
                j = NAMES.index(other)
                dx, dy = self.mean[3 * j : 3 * j + 2] - self.mean[3 * k : 3 * k + 2]
                r = math.hypot(dx, dy)
                toward = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
                rows = np.zeros((2, 9))
                rows[:, 3 * j : 3 * j + 2], rows[:, 3 * k : 3 * k + 2], rows[1, 3 * k + 2] = toward, -toward, -1
                off = wrap(bearing - math.atan2(dy, dx) + self.mean[3 * k + 2])
                self._update(np.array([distance - r, off]), rows, np.diag([RANGE, BEARING]) ** 2)

    def _update(self, residual: Array, rows: Array, noise: Array) -> None:
        gain = self.covariance @ rows.T @ np.linalg.inv(rows @ self.covariance @ rows.T + noise)
        self.mean, self.covariance = self.mean + gain @ residual, self.covariance - gain @ rows @ self.covariance


class Robot:
    """Sums its odometry up and says what it saw at the end of each of its ticks."""

    def __init__(self, name: str) -> None:
        self.name, self.tick, self.travelled, self.since = name, -1, Motion(), Motion()
        self.joint, k = Joint(), NAMES.index(name)
        self.joint.add(name, entering(Moments(np.array([3.0 * k, 2.0 * k % 3, 2.0 * k]), START), NUISANCE))

    def take(self, part: Part, time: float) -> Evidence | None:
        way, turn = part.steps[self.name]
        self.since = self.since.plus(Motion(way, turn, PART, PART, WAY**2 * abs(way), 0.0, TURN**2 * PART))
        if self.name not in part.seen:
            return None
        self.tick, self.travelled = self.tick + 1, self.travelled.plus(self.since)
        drive(self.joint, self.name, self.since, NUISANCE)
        self.since, prediction, increment = Motion(), self.joint.moments(self.name), None
        if self.name in part.fixes:
            off = part.fixes[self.name] - prediction.mean[AXES]
            correct(self.joint, Factor(off, {self.name: np.eye(STATES)[AXES]}, np.eye(2) * FIX**2))
            increment = gained(prediction, self.joint.moments(self.name))
        relatives = tuple(
            Relative(self.name, other, distance, bearing, RANGE**2, BEARING**2)
            for other, (distance, bearing) in part.seen[self.name].items()
        )
        belief = self.joint.moments(self.name)
        return Evidence(self.name, 0, self.tick, self.travelled, NUISANCE, belief, increment, relatives, time)


def errors(seed: int, *, timed: bool, tick: int = TICK, prompt: bool = False) -> tuple[Array, Array]:
    """Squared errors of the places, m ** 2, by the joint and by the oracle, at the ends of the robots' ticks of so many parts.

    `prompt`: what a robot tells is settled at once, by itself.
    """
    oracle, team, robots = Oracle(), TeamJoint(), [Robot(name) for name in NAMES]
    batch: dict[str, Evidence] = {}
    expected: dict[str, tuple[Array, Array]] = {}  # truth, and what the oracle believed
    squared: list[tuple[float, float]] = []
    for number, part in enumerate(world(seed, 20.0, tick), 1):
        oracle.take(part)
        for k, robot in enumerate(robots):
            evidence = robot.take(part, number * PART)
            if evidence is not None:
                batch[robot.name] = replace(evidence, time=evidence.time if timed else 0.0)
                expected[robot.name] = part.poses[robot.name][AXES], oracle.mean[3 * k : 3 * k + 2].copy()
        # else the board settles every tenth of a second
        if batch if prompt else number % TICK == TICK - 1 and len(batch) == len(NAMES):
            settled = team.tick + 1
            team.settle(settled, TICK * PART, [replace(said, tick=settled) for said in batch.values()])
            for name, (true, believed) in expected.items():
                ours, its = team.marginal(name).mean - true, believed - true
                squared.append((float(ours @ ours), float(its @ its)))
            if prompt:
                batch, expected = {}, {}
    ours, its = np.array(squared).T
    return ours, its


def compared(seeds: int, *, timed: bool, tick: int = TICK, prompt: bool = False) -> float:
    """The RMSE of the joint over that of the oracle."""
    runs = [errors(seed, timed=timed, tick=tick, prompt=prompt) for seed in range(seeds)]
    ours, its = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    return math.sqrt(float(ours.mean() / its.mean()))


@pytest.mark.long
def test_ticks_that_end_at_different_times_cost_nothing_against_a_filter_that_has_every_reading_at_its_time() -> None:
    assert compared(3, timed=True) < 1.1
    assert compared(1, timed=False) > 1.4, "without the times it is far worse, so that the test can fail"


def test_sightings_of_robots_that_tell_seldom_how_they_moved_wait_for_that() -> None:
    """Two ticks a second, each settled by itself: half of all sightings were left out, and places were 4.5 times as far off."""
    assert compared(3, timed=True, tick=50, prompt=True) < 2.5


def pair(times: tuple[float, float], ahead: float = 0.0) -> tuple[TeamJoint, Evidence]:
    """Two robots that drive along x at 1 m/s, 5 m apart, with the first one's next evidence: it sees where the other one is."""
    team, places = TeamJoint(), {"robot/r1": 0.0, "robot/r2": 5.0}
    for tick in range(2):
        reports = []
        for (name, x), time in zip(places.items(), times, strict=True):
            pose = Moments(np.array([x + time, 0.0, 0.0]), START)
            travelled = Motion(float(tick), 0.0, float(tick), float(tick), 1e-4 * tick, 0.0, 1e-6 * tick)
            reports.append(Evidence(name, 0, tick, travelled, NUISANCE, entering(pose, NUISANCE), time=time + tick))
        team.settle(tick, 1.0, reports)
    distance = 5.0 + ahead
    sees = Relative("robot/r1", "robot/r2", distance, 0.0, RANGE**2, BEARING**2)
    travelled = Motion(2.0, 0.0, 2.0, 2.0, 2e-4, 0.0, 2e-6)
    return team, Evidence("robot/r1", 0, 2, travelled, NUISANCE, None, None, (sees,), times[0] + 2)


def test_a_robot_that_was_not_heard_in_a_tick_is_seen_where_it_was_within_its_last_one() -> None:
    team, evidence = pair((0.0, 1.4))  # the second one has told its motion until 2.4 s, the sighting is of 2 s
    (verdict,) = team.settle(2, 1.0, [evidence])
    assert (verdict.taken, team.tally.silent) == (True, 0)
    assert verdict.squared < 0.1


def test_where_it_was_later_than_it_has_told_is_not_known_before_it_tells() -> None:
    team, evidence = pair((0.0, 0.9))  # the second one has told its motion until 1.9 s
    assert team.settle(2, 1.0, [evidence]) == []
    travelled = Motion(2.0, 0.0, 2.0, 2.0, 2e-4, 0.0, 2e-6)
    assert team.settle(3, 0.9, [Evidence("robot/r2", 0, 3, travelled, NUISANCE, time=2.9)]) == []
    further = Motion(3.0, 0.0, 3.0, 3.0, 3e-4, 0.0, 3e-6)
    later = Evidence("robot/r1", 0, 4, further, NUISANCE, time=3.0)
    (verdict,) = team.settle(4, 0.1, [later])
    assert verdict.taken
    assert verdict.squared < 0.1
    further = Motion(4.0, 0.0, 4.0, 4.0, 4e-4, 0.0, 4e-6)
    assert team.settle(5, 1.0, [replace(later, tick=5, travelled=further, time=4.0)]) == [], "it is taken once"


def test_what_waits_counts_with_the_observer_s_next_evidence_though_all_ticks_end_together_then() -> None:
    """Before, it waited on for a tick that ends at a time of its own, and was then held against where the observer was later."""
    # r1 saw r2 at 2 s, and r2 has told its motion until 1 s
    team, evidence = pair((0.0, 0.0))
    assert team.settle(2, 1.0, [evidence]) == []
    further = Motion(3.0, 0.0, 3.0, 3.0, 3e-4, 0.0, 3e-6)
    both = [Evidence(robot, 0, 3, further, NUISANCE, time=3.0) for robot in ("robot/r1", "robot/r2")]
    (verdict,) = team.settle(3, 1.0, both)
    assert verdict.taken
    assert verdict.squared < 0.1


def test_where_a_robot_was_outside_of_its_tick_is_known_less() -> None:
    joint, still = Joint(), Motion(0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0)
    for name, x in (("robot/r1", 0.0), ("robot/r2", 5.0)):
        joint.add(name, entering(Moments(np.array([x, 0.0, 0.0]), np.diag([0.0, 0.0, START[2, 2]])), NUISANCE))
    moves = {"robot/r1": still, "robot/r2": Motion(0.1, 0.0, 0.1, 0.1, 1e-6, 1e-6, 0.0)}
    sees = Relative("robot/r1", "robot/r2", 5.0, 0.0, RANGE**2, 0.0)
    noise = {
        ahead: np.trace(linearise(joint, replace(sees, ahead=ahead), moves).noise)
        for ahead in (-0.2, -0.05, 0.0, 0.05, 0.1, 0.2)
    }
    assert noise[0.0] == noise[0.05] == noise[0.1], "within the tick its motion is known"
    assert noise[0.0] < noise[-0.05] < noise[-0.2]
    assert noise[0.1] < noise[0.2]
    later = linearise(joint, replace(sees, ahead=-0.1), moves)
    assert later.residual[0] == pytest.approx(-0.1), "it is expected to have gone on"
