"""Samples: beliefs against the truth, a row of a table for each, from which all else can be computed. Pure but for its files.

The scorecard has sums only. What depends on time is computed from samples: when a robot found itself, how it did without
landmarks, how correlated the misses are. They are those that a referee judged (a series), or those on a tape. Floats are
written so that reading gives them back exactly. docs/fields.md says what each column of a series is.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from blackboard.errors import UserError, plain
from blackboard.judge.files import table_file
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import Score, held, region_area
from blackboard.wire.messages import Truth

#: What a robot believes alone, its sub-team, and all of them after the exchange.
LEVELS = ("solo", "consensus", "agreed")
GROUPS = {"robots": "robot/", "objects": "object/"}  # of subjects, by how their names begin
AREA_OF = 0.95  # the share of the mass in the region whose area a sample has


@dataclass(frozen=True)
class Sample:
    """One belief of one level against the truth; places in the grid's unit. NaN: what depends on a truth that is not known."""

    tick: int
    time: float  # team time, seconds
    robot: str  # empty where a tape has what a board said to all its robots
    sub_team: str  # of the robot, whose board made the consensus
    subject: str  # "robot/<robot>", or an object that it believes something about
    level: str  # one of LEVELS
    truth_x: float
    truth_y: float
    mean_x: float  # the estimate: the belief's mean
    mean_y: float
    log_score: float  # nats
    #: mass of the smallest highest-density region that reaches the truth: inside the 95 % one iff below 0.95
    region: float
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
    lost: float = math.nan  # of a robot, what is agreed: the probability that it is not there

    def __post_init__(self) -> None:
        if math.isnan(self.error):  # older series have no such column
            error = math.hypot(self.mean_x - self.truth_x, self.mean_y - self.truth_y)
            object.__setattr__(self, "error", error)


#: The columns of a series, and their types.
COLUMNS = {field.name: str(field.type) for field in fields(Sample)}
NEEDED = tuple(field.name for field in fields(Sample) if field.default is MISSING)  # the others came later
READERS: dict[str, Callable[[str], int | float | str]] = {"int": int, "float": float, "str": str}

Keep = Callable[[Sample], None]  # is given every sample that is judged


def sample_of(belief: Belief, score: Score, truth: Sequence[float] | None, **more: Any) -> Sample:
    """The sample of a belief in the plane whose score has one entry, with `more` fields; `truth` is None where it is not known."""
    (mean_x, mean_y), known = belief.mean().tolist(), truth is not None
    truth_x, truth_y = (math.nan, math.nan) if truth is None else truth
    return Sample(
        truth_x=truth_x,
        truth_y=truth_y,
        mean_x=mean_x,
        mean_y=mean_y,
        log_score=score.log_scores[0] if known else math.nan,
        region=score.levels[0] if known else math.nan,
        border=score.borders[0] if known else math.nan,
        error=score.errors[0] if known else math.nan,
        entropy=score.entropies[0],
        **more,
    )


class Sampler:
    """Makes the samples of a run. Mutable: `begin_tick` each tick once, in order, also those that are not judged."""

    def __init__(self) -> None:
        self._truth: Truth | None = None
        self._landmark_at: dict[str, float] = {}  # robot -> team time of the newest tick in which it saw a landmark

    def begin_tick(self, truth: Truth, landmark_seen: Collection[str]) -> None:
        """Take what is true in a tick, and the robots that saw a landmark in it."""
        self._truth = truth
        self._landmark_at |= dict.fromkeys(landmark_seen, truth.time)

    def sample(self, belief: Belief, score: Score, robot: str, subject: str, **more: Any) -> Sample:
        """The sample of a belief of this tick whose score has one entry, with the fields that the belief does not tell."""
        assert self._truth is not None, "a tick has begun"
        tick, time = self._truth.tick, self._truth.time
        spread = belief.covariance() + np.eye(2) * belief.grid.cell**2 / 12
        return sample_of(
            belief,
            score,
            self._truth.positions[subject],
            tick=tick,
            time=time,
            robot=robot,
            subject=subject,
            area=region_area(belief, AREA_OF),
            landmark_age=time - self._landmark_at.get(robot, -math.inf),
            var_x=float(spread[0, 0]),
            cov_xy=float(spread[0, 1]),
            var_y=float(spread[1, 1]),
            **more,
        )


def held_by(samples: Iterable[Sample], level: int) -> Array:
    """How far the `level` % regions held the truth, one number from 0 to 1 for each sample (`scores.held`)."""
    numbers = np.array([(sample.region, sample.border) for sample in samples]).reshape(-1, 2)
    return held(numbers[:, 0], numbers[:, 1], level / 100)


def rms_error(samples: Iterable[Sample]) -> float:
    """The root mean squared error of at least one sample."""
    return math.sqrt(float(np.mean([sample.error**2 for sample in samples])))


@contextmanager
def series_file(path: Path | None) -> Iterator[Keep | None]:
    """A function that writes a sample into a file, by its ending; None where no file is asked for. UserError: it cannot be written."""
    if path is None:
        yield None
        return
    with table_file(path, COLUMNS, "--table") as write:
        yield lambda sample: write(vars(sample))


def read_series(path: Path) -> list[Sample]:
    """The samples of a CSV file. UserError: it is missing, or not what `series_file` writes; the line is named."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file)) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: cannot be read ({plain(error)}); give the file that --table wrote") from error
    if not (set(NEEDED) <= set(header) <= set(COLUMNS)):
        raise UserError(f"{path}, line 1: not the columns of a series; give the file that --table wrote")
    samples = []
    for number, row in enumerate(rows, 2):
        try:
            cells = {name: READERS[COLUMNS[name]](cell) for name, cell in zip(header, row, strict=True)}
            samples.append(Sample(**cells))  # type: ignore[arg-type]
        except ValueError as error:
            raise UserError(f"{path}, line {number}: not a row of a series ({error}); write it again") from error
    return samples
