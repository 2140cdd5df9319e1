"""The series of a run: every sample that the referee judged, one row of a CSV file for each, from which all else can be computed.

The scorecard has sums only. What depends on time (when a robot found itself, how it did without landmarks, how correlated the
misses are) is computed from the series; floats are written so that reading gives them back exactly.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from blackboard.errors import UserError

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
    landmark_age: (
        float  # seconds since the end of the tick in which the robot was last given a landmark sighting; inf: never
    )


COLUMNS = tuple(field.name for field in fields(Sample))
READERS: dict[str, Callable[[str], int | float | str]] = {"int": int, "float": float, "str": str}
TYPES = tuple(READERS[str(field.type)] for field in fields(Sample))


@contextmanager
def series_file(path: Path | None) -> Iterator[Callable[[Sample], None] | None]:
    """A function that writes a sample into a file; None where no file is asked for. UserError: it cannot be written."""
    if path is None:
        yield None
        return
    try:
        file = path.open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise UserError(f"--series {path}: cannot be written ({error.strerror}); choose another place") from error
    with file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        yield lambda sample: writer.writerow(astuple(sample))


def read_series(path: Path) -> list[Sample]:
    """The samples of a file. UserError: it is missing, or not what `series_file` writes; the line is named."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: cannot be read ({error}); give the file that --series wrote") from error
    if tuple(header) != COLUMNS:
        raise UserError(f"{path}, line 1: not the columns of a series; give the file that --series wrote")
    samples = []
    for number, row in enumerate(rows, 2):
        try:
            samples.append(Sample(*(read(cell) for read, cell in zip(TYPES, row, strict=True))))  # type: ignore[arg-type]
        except ValueError as error:
            raise UserError(f"{path}, line {number}: not a row of a series ({error}); write it again") from error
    return samples
