"""A team recorded as a factor graph in the PyFG text format: poses, odometry, ranges and points, one element a line.

A name is letters and a number: the letters are the robot's (of a point the whole name counts), the number counts its poses.

    VERTEX_SE2 time pose x y heading                          the truth of a pose
    VERTEX_XY point x y                                       the place of a point, which is taken as known
    EDGE_SE2 time pose pose dx dy dheading covariance         odometry of one robot; of two a relative pose
    EDGE_RANGE time pose pose-or-point range variance
    EDGE_SE2_XY time pose point x y covariance                a point in the frame of a pose

A covariance is its upper triangle, row by row. Other elements are left out.
"""

import math
import re
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from blackboard.config import Scenario
from blackboard.config.extent import grid_around
from blackboard.errors import UserError
from blackboard.opinion.grid import Array

NUMBERS = {"VERTEX_SE2": 3, "VERTEX_XY": 2, "EDGE_SE2": 9, "EDGE_RANGE": 2, "EDGE_SE2_XY": 5}
NAMES = {"VERTEX_SE2": 1, "VERTEX_XY": 1, "EDGE_SE2": 2, "EDGE_RANGE": 2, "EDGE_SE2_XY": 2}
NAME = re.compile(r"([A-Za-z]{1,16})([0-9]{1,12})")


class Measured(NamedTuple):
    """What was measured at a time (Unix seconds) of a pose, or of a point."""

    time: float
    kind: str
    subject: str
    values: tuple[float, ...]
    covariance: tuple[float, ...]


@dataclass(eq=False)
class RecordedRobot:
    """What was recorded of one robot."""

    truth: Array = field(default_factory=lambda: np.zeros((0, 4)))  # time, x, y, heading
    odometry: Array = field(default_factory=lambda: np.zeros((0, 4)))  # time, x, y, heading of its dead reckoning
    #: Of the odometry: along, across, turn, per square root of a second.
    sigmas: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seen: list[Measured] = field(default_factory=list)  # in time order

    @cached_property
    def interval(self) -> float:
        """Seconds from a true pose to the next one, the median."""
        return float(np.median(np.diff(self.truth[:, 0])))


@dataclass(frozen=True, eq=False)
class FactorGraph:
    """A file, read."""

    path: Path
    tracks: dict[str, RecordedRobot]  # by robot
    points: dict[str, tuple[float, float]]

    @property
    def first(self) -> float:
        """The first time at which every robot has a pose, Unix seconds."""
        return float(max(track.truth[0, 0] for track in self.tracks.values()))

    @property
    def last(self) -> float:
        """Until when every robot has poses."""
        return float(min(track.truth[-1, 0] for track in self.tracks.values()))

    def applied(self, scenario: Scenario) -> Scenario:
        """A scenario with the file's robots, a grid that holds all of it, its length, and how exact its odometry is."""
        places = np.concatenate(
            [track.truth[:, 1:3] for track in self.tracks.values()] + [np.array([*self.points.values()]).reshape(-1, 2)]
        )
        along, across, turn = np.max([track.sigmas for track in self.tracks.values()], axis=0).tolist()
        robot = scenario.tables.get("robot", {})
        odometry = {**robot.get("odometry", {}), "along": along, "across": across, "turn": turn}
        return (
            scenario.changed("world", kind="pyfg", dir=str(self.path))
            .changed("team", sub_teams={"a": sorted(self.tracks)})
            .changed("grid", **grid_around(places))
            .changed("time", seconds=float(math.floor(self.last - self.first)))
            .changed("robot", odometry=odometry)
        )


def read_graph(file: str | Path | None) -> FactorGraph:
    """Read a file. UserError: it is missing, a line of it is corrupt (it is named), or it holds no robot with odometry."""
    if file is None:
        raise UserError("world.dir: which recording is to be replayed? give its file with --pyfg FILE")
    path, reader = Path(file), _Reader()
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            for number, line in enumerate(lines, 1):
                words = line.split()
                if words and not reader.read_line(words):
                    raise UserError(f"{path}, line {number}: no sound element: {line.strip()!r:.60}; mend or remove it")
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give a file in PyFG format") from error
    return reader.graph(path)


class _Reader:
    """The elements of a file, as they come."""

    def __init__(self) -> None:
        self.poses: dict[str, tuple[float, ...]] = {}  # name -> time, x, y, heading
        self.points: dict[str, tuple[float, float]] = {}
        self.edges: list[tuple[str, float, str, str, list[float]]] = []

    def read_line(self, words: list[str]) -> bool:
        """Take a line; False where it is corrupt."""
        kind = words[0]
        if kind not in NUMBERS:
            return True
        timed = kind != "VERTEX_XY"
        first = 1 + timed
        names, rest = words[first : first + NAMES[kind]], words[first + NAMES[kind] :]
        try:
            time, numbers = float(words[1]) if timed else 0.0, [float(word) for word in rest]
        except ValueError:
            return False
        if len(numbers) != NUMBERS[kind] or not all(map(math.isfinite, [time, *numbers])):
            return False
        if len(names) != NAMES[kind] or not all(map(NAME.fullmatch, names)):
            return False
        if kind == "VERTEX_SE2":
            self.poses[names[0]] = (time, *numbers)
        elif kind == "VERTEX_XY":
            self.points[names[0]] = (numbers[0], numbers[1])
        else:
            self.edges.append((kind, time, names[0], names[1], numbers))
        return kind != "EDGE_RANGE" or (numbers[0] >= 0 and numbers[1] > 0)

    def graph(self, path: Path) -> FactorGraph:
        steps: defaultdict[str, list[tuple[float, float, list[float]]]] = defaultdict(list)
        seen: defaultdict[str, list[Measured]] = defaultdict(list)
        for kind, time, one, other, numbers in self.edges:
            robot, mate = _robot(one), _robot(other)
            if one not in self.poses or (other not in self.poses and other not in self.points):
                raise UserError(f"{path}: {kind} names {one} and {other}, of which one has no VERTEX; add it")
            if kind == "EDGE_SE2" and robot == mate:
                steps[robot].append((self.poses[one][0], self.poses[other][0], numbers))
                continue
            subject = f"landmark/{other}" if other in self.points else f"robot/{mate}"
            split = {"EDGE_RANGE": ("range", 1), "EDGE_SE2": ("pose", 3), "EDGE_SE2_XY": ("position", 2)}
            name, size = split[kind]
            seen[robot].append(Measured(time, name, subject, tuple(numbers[:size]), tuple(numbers[size:])))
        tracks = {}
        for robot in sorted({_robot(name) for name in self.poses}):
            truth = np.array(sorted(pose for name, pose in self.poses.items() if _robot(name) == robot))
            if not steps[robot]:
                raise UserError(f"{path}: no odometry (EDGE_SE2) of robot {robot}; a replay needs some")
            odometry, sigmas = _dead_reckoned(sorted(steps[robot], key=lambda step: step[:2]))
            tracks[robot] = RecordedRobot(truth, odometry, sigmas, sorted(seen[robot]))
        if not tracks:
            raise UserError(f"{path}: no pose (VERTEX_SE2); give a file in PyFG format, of robots in the plane")
        return FactorGraph(path, tracks, self.points)


def _robot(name: str) -> str:
    return name.rstrip("0123456789")


def _dead_reckoned(steps: list[tuple[float, float, list[float]]]) -> tuple[Array, tuple[float, float, float]]:
    """Where the steps lead from (0, 0, 0), one after the other, and their sigmas per square root of a second.

    A step that leads back, or over others, closes a loop and is left out.
    """
    rows, x, y, heading = [(steps[0][0], 0.0, 0.0, 0.0)], 0.0, 0.0, 0.0
    variances: list[Any] = []
    for since, until, (dx, dy, turn, *covariance) in steps:
        if since < rows[-1][0] or until < since:
            continue
        c, s = math.cos(heading), math.sin(heading)
        x, y, heading = x + c * dx - s * dy, y + s * dx + c * dy, heading + turn
        rows.append((until, x, y, heading))
        variances.append([covariance[0], covariance[3], covariance[5]])
    span = max(rows[-1][0] - rows[0][0], 1e-9)
    along, across, heading = np.sqrt(np.sum(np.maximum(variances, 0.0), axis=0) / span).tolist()
    return np.array(rows), (along, across, heading)
