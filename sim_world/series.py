"""The series of a run: every sample that the referee judged, a row of a table for each, from which all else can be computed.

The scorecard has sums only. What depends on time (when a robot found itself, how it did without landmarks, how correlated the
misses are) is computed from the series; floats are written so that reading gives them back exactly. docs/scorecard.md says what
each column is.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from pathlib import Path

from blackboard.errors import UserError
from sim_world.table import table_file

AREA_OF = 0.95  # the share of the mass in the region whose area a sample has


@dataclass(frozen=True)
class Sample:
    """One belief of one level against the truth; places in the grid's unit."""

    tick: int
    time: float  # team time, seconds
    robot: str
    sub_team: str  # of the robot, whose board made the consensus
    subject: str  # "robot/<robot>", or an object that it believes something about
    level: str  # "solo", "consensus" or "agreed"
    truth_x: float
    truth_y: float
    mean_x: float  # the estimate: the belief's mean
    mean_y: float
    log_score: float  # nats
    region: (
        float  # mass of the smallest highest-density region that reaches the truth: inside the 95 % one iff below 0.95
    )
    border: float  # mass of the cells as dense as the true one, which lie on the border of regions from there on (`scores.held`)
    area: float  # of the 95 % highest-density region, unit^2
    #: seconds since the end of the tick in which the robot was last given a landmark sighting; inf: never
    landmark_age: float
    error: float = math.nan  # distance of the mean from the truth
    entropy: float = math.nan  # nats
    sources: int = 0  # robots whose information the belief rests on; 1 for solo
    var_x: float = math.nan  # variance of the belief along x, unit^2
    cov_xy: float = math.nan  # covariance of x and y, unit^2
    var_y: float = math.nan  # variance along y, unit^2


COLUMNS = tuple(field.name for field in fields(Sample))
NEEDED = tuple(field.name for field in fields(Sample) if field.default is MISSING)  # the others came later
READERS: dict[str, Callable[[str], int | float | str]] = {"int": int, "float": float, "str": str}
TYPES = {field.name: READERS[str(field.type)] for field in fields(Sample)}


@contextmanager
def series_file(path: Path | None) -> Iterator[Callable[[Sample], None] | None]:
    """A function that writes a sample into a file, by its ending; None where no file is asked for. UserError: it cannot be written."""
    if path is None:
        yield None
        return
    with table_file(path, Sample, "--table") as write:
        yield write


def read_series(path: Path) -> list[Sample]:
    """The samples of a CSV file. UserError: it is missing, or not what `series_file` writes; the line is named."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: cannot be read ({error}); give the file that --table wrote") from error
    if not (set(NEEDED) <= set(header) <= set(COLUMNS)):
        raise UserError(f"{path}, line 1: not the columns of a series; give the file that --table wrote")
    samples = []
    for number, row in enumerate(rows, 2):
        try:
            cells = {name: TYPES[name](cell) for name, cell in zip(header, row, strict=True)}
            samples.append(Sample(**cells))  # type: ignore[arg-type]
        except ValueError as error:
            raise UserError(f"{path}, line {number}: not a row of a series ({error}); write it again") from error
    return samples
