"""A simulated robot that gets stuck, is pushed or carried away, or whose odometry jumps: `python -m tests.robot_agent.mishaps` prints how soon it notices."""

import copy
import math
import sys
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from blackboard.wire.messages import Fix, Odometry, Readings, Sighting
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import Sensors
from tests.robot_agent.robots import measured

LANDMARKS = [(-2.0, -2.0), (8.0, -2.0), (8.0, 8.0), (-2.0, 8.0), (3.0, 11.0), (3.0, -5.0)]
#: What is commanded, second by second, again and again: ways (unit) and turns (radians); straight ways, curves and spins.
DRIVES = [(0.3, 0.0)] * 8 + [(0.3, 0.5)] * 4 + [(0.3, 0.0)] * 4 + [(0.0, 0.6)] * 3 + [(0.3, -0.4)] * 3
BEGAN = 60  # seconds: when the mishap begins
NEAR = 0.3  # unit: a robot is found again once its error stays below


@dataclass(frozen=True)
class Mishap:
    """What begins at `BEGAN`: the robot is `stuck` for some seconds, or it is shifted by `push` and turned.

    Or its odometry jumps then, by a way (unit) and a turn (radians), and it sees no landmarks for `blind` seconds.
    """

    stuck: int = 0
    push: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    jump: tuple[float, float] = (0.0, 0.0)
    blind: int = 0


@dataclass
class Course:
    """What happened, second by second."""

    errors: list[float] = field(default_factory=list)  # unit; NaN without a Gaussian belief
    stuck: list[float] = field(default_factory=list)
    moved: list[float] = field(default_factory=list)
    jumped: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)  # unit, of the place

    def named(self, name: str) -> int | None:
        """Seconds after the beginning until it was named; None if it never was."""
        return next((k for k, value in enumerate(getattr(self, name)[BEGAN:]) if value), None)

    def found(self) -> int | None:
        """Seconds after the beginning until the error was small for good; None if it is not."""
        bad = [k for k, error in enumerate(self.errors[BEGAN:]) if not error < NEAR]
        return 0 if not bad else None if bad[-1] == len(self.errors) - BEGAN - 1 else bad[-1] + 1


def readings(tick: int, way: float, turn: float, sightings: list[Sighting]) -> Readings:
    """What r1 measures in a tick of one second. In the first tick that is a fix at the origin, and no odometry."""
    told: dict[str, Any] = {"odometry": Odometry(distance=way, turn=turn, dt=1.0)}
    if not tick:
        told = {"fix": Fix(position=(0.0, 0.0), sigma=0.05, heading=0.0, heading_sigma=0.03)}
    return measured(tick, sightings=sightings, **told)


class Drive:
    """A robot on its way, and what it said so far."""

    def __init__(self, seed: int, misreads: bool) -> None:
        self.seed, self.misreads, self.rng = seed, misreads, np.random.default_rng(seed)
        self.own, self.course = FirstHand("robot/r1", Sensors()), Course()
        self.x, self.y, self.heading = 0.0, 0.0, 0.0

    def step(self, tick: int, mishap: Mishap = Mishap()) -> None:
        way, angle = DRIVES[(tick + 7 * self.seed) % len(DRIVES)] if tick else (0.0, 0.0)
        if not BEGAN <= tick < BEGAN + mishap.stuck and tick:
            self._go(angle + 0.01 * self.rng.normal(), way + 0.01 * self.rng.normal())
        if tick == BEGAN:
            (x, y), (ahead, turned) = mishap.push, mishap.jump
            self.x, self.y, self.heading = self.x + x, self.y + y, self.heading + mishap.turn
            way, angle = way + ahead, angle + turned
        is_blind = BEGAN <= tick < BEGAN + mishap.blind or not tick
        visible = [] if is_blind else [n for n in range(len(LANDMARKS)) if tick % 3 == n % 3]
        seen = [self._sighting(n, LANDMARKS[n]) for n in visible]
        self.own.step(readings(tick, way, angle, seen))
        self._note()

    def _go(self, turned: float, went: float) -> None:
        middle = self.heading + turned / 2
        self.x, self.y = self.x + went * math.cos(middle), self.y + went * math.sin(middle)
        self.heading += turned

    def _sighting(self, n: int, place: tuple[float, float]) -> Sighting:
        rng = self.rng
        away = math.dist(place, (self.x, self.y)) * (1 + 0.03 * rng.normal())
        angle = math.atan2(place[1] - self.y, place[0] - self.x) - self.heading + 0.01 * rng.normal()
        if self.misreads and rng.random() < 0.1:
            away, angle = 10 * rng.random(), 6 * rng.random() - 3
        return Sighting(subject=f"landmark/{n}", range=max(0.0, away), bearing=angle, landmark=place)

    def _note(self) -> None:
        belief, named, course = self.own.belief, self.own.found(), self.course
        course.errors.append(math.nan if belief is None else math.dist(belief.mean[:2], (self.x, self.y)))
        for name in ("stuck", "moved", "jumped"):
            getattr(course, name).append(named.get(name, 0.0))
        course.sigmas.append(math.nan if belief is None else math.sqrt(np.trace(belief.covariance[:2, :2])))


def course(seed: int, misreads: bool = False, **mishap: Any) -> Course:
    """A drive of 120 s with a `Mishap`."""
    drive, begins = copy.deepcopy(_begun(seed, misreads)), Mishap(**mishap)
    for tick in range(BEGAN, 121):
        drive.step(tick, begins)
    return drive.course


@cache
def _begun(seed: int, misreads: bool) -> Drive:
    """The drive before any mishap: it is the same for all of them."""
    drive = Drive(seed, misreads)
    for tick in range(BEGAN):
        drive.step(tick)
    return drive


def main(seeds: int = 20) -> None:
    """Print for each mishap how many of the runs name it, after how many seconds, and when the error is small again."""
    cases: dict[str, tuple[str, dict[str, Any]]] = {
        f"stuck for {seconds} s": ("stuck", {"stuck": seconds}) for seconds in (3, 6, 12)
    }
    cases |= {"pushed by 0.7": ("moved", {"push": (0.5, 0.5)}), "pushed by 2.8": ("moved", {"push": (2.0, 2.0)})}
    cases |= {
        "odometry + 17": ("jumped", {"jump": (17.0, 1.0)}),
        "the same, blind": ("jumped", {"jump": (17.0, 1.0), "blind": 5}),
    }
    sys.stdout.write(f"{'':<16}{'named':>8}{'after':>8}{'error':>8}{'found':>8}{'after':>8}\n")
    for name, (kind, mishap) in cases.items():
        runs = [course(seed, **mishap) for seed in range(seeds)]
        named = [seconds for run in runs if (seconds := run.named(kind)) is not None]
        recovered = [seconds for run in runs if (seconds := run.found()) is not None]
        worst = np.median([np.nanmax(run.errors[BEGAN:]) for run in runs])
        middle = [f"{np.median(some):.0f} s" if some else "-" for some in (named, recovered)]
        sys.stdout.write(
            f"{name:<16}{len(named):>5}/{seeds}{middle[0]:>8}{worst:>8.2f}{len(recovered):>5}/{seeds}{middle[1]:>8}\n"
        )


if __name__ == "__main__":
    main()
