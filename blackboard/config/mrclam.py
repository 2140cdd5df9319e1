"""The text tables of a recording in the MRCLAM format, its map, and a scenario that fits it."""

import math
import re
import warnings
from pathlib import Path

import numpy as np

from blackboard.config import Scenario
from blackboard.config.extent import grid_around, holds
from blackboard.errors import UserError
from blackboard.opinion.grid import Array


def recording_folder(folder: str | Path | None) -> Path:
    """The folder of a recording, not yet read. UserError: there is none."""
    if folder is None:
        raise UserError("world.dir: which recording is to be replayed? give its folder with --mrclam DIR")
    path = Path(folder)
    if not path.is_dir():
        raise UserError(f"world.dir: no folder {path}; give the folder of a recording in MRCLAM format")
    return path


def robots_in(folder: Path) -> list[int]:
    """The numbers of the robots of a recording, sorted. UserError: there is none."""
    files = (re.fullmatch(r"Robot([0-9]{1,4})_Odometry\.dat", file.name) for file in folder.iterdir())
    numbers = sorted(int(file[1]) for file in files if file)
    if not numbers:
        raise UserError(
            f"world.dir: {folder} has no Robot1_Odometry.dat; give the folder of a recording in MRCLAM format"
        )
    return numbers


def ways_of(folder: Path) -> Array:
    """Where all robots of a recording have been (m), shape (n, 2). UserError: a file is missing, or a line is corrupt."""
    ways = [table(folder / f"Robot{number}_Groundtruth.dat", 3)[:, 1:] for number in robots_in(folder)]
    return np.concatenate(ways)


def fitted(scenario: Scenario, folder: Path) -> Scenario:
    """A scenario with all robots of a recording, and with a grid that holds their ways, if its own does not.

    UserError: a file is missing, or a line is corrupt.
    """
    robots, ways = [f"r{number}" for number in robots_in(folder)], ways_of(folder)
    if not holds(scenario.grid, ways):
        landmarks = np.array([*surveyed(folder).values()]).reshape(-1, 2)
        scenario = scenario.changed("grid", **grid_around(np.concatenate([ways, landmarks])))
    return scenario if set(robots) == set(scenario.team.robots) else scenario.changed("team", sub_teams={"a": robots})


def surveyed(folder: Path) -> dict[int, tuple[float, float]]:
    """Where the landmarks of a recording stand (m), by number. UserError: the file is missing, or a line is corrupt."""
    return {int(row[0]): (float(row[1]), float(row[2])) for row in table(folder / "Landmark_Groundtruth.dat", 3)}


def table(path: Path, columns: int) -> Array:
    """The first columns of a text table, sorted by the first one where that is a time; `#` begins a comment."""
    try:
        with path.open(encoding="utf-8", errors="replace") as text, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a table without rows is for the caller to judge
            rows = np.loadtxt(text, usecols=range(columns), ndmin=2).reshape(-1, columns)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); a recording needs this file") from error
    except ValueError as error:
        raise _corrupt(path, columns) from error
    if not np.isfinite(rows).all() or (path.name.endswith("_Measurement.dat") and (rows[:, 2] < 0).any()):
        raise _corrupt(path, columns)
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _corrupt(path: Path, columns: int) -> UserError:
    """The error that names the corrupt line, found by reading the file again line by line."""
    with path.open(encoding="utf-8", errors="replace") as text:
        for number, line in enumerate(text, 1):
            words = line.split("#")[0].split()
            if words and not _sound(words, columns, path.name.endswith("_Measurement.dat")):
                return UserError(
                    f"{path}, line {number}: not {columns} sound numbers: {line.strip()!r:.60}; mend or remove it"
                )
    return UserError(f"{path}: not a table of {columns} numbers a line; mend it")


def _sound(words: list[str], columns: int, measurement: bool) -> bool:
    try:
        numbers = [float(word) for word in words[:columns]]
    except ValueError:
        return False
    return len(numbers) == columns and all(map(math.isfinite, numbers)) and not (measurement and numbers[2] < 0)
