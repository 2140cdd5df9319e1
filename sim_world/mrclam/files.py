"""The files of a recorded team in the MRCLAM format, read once and looked up by time. Times are Unix seconds."""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from blackboard.config.mrclam import recording_folder, robots_in, surveyed, table
from blackboard.errors import UserError
from blackboard.opinion.gaussian.vehicle import kinds, wrap
from blackboard.opinion.grid import Array

LONGEST_GAP = 0.5  # seconds: ground truth is not interpolated over a longer gap
Place = tuple[float, float]


@dataclass(frozen=True, eq=False)
class RobotFiles:
    """What was recorded of one robot, each table sorted by its first column, the time."""

    odometry: Array  # (n, 3): time, forward velocity m/s, angular velocity rad/s, as commanded
    sightings: Array  # (n, 4): time, subject, range m, bearing rad
    truth: Array  # (n, 3 + 1): time, x, y, heading

    @cached_property
    def _travelled(self) -> Array:
        """What was commanded until each row, as `commanded` has it, shape (n, 4): every command holds until the next."""
        steps = self._rates[:-1] * np.diff(self.odometry[:, 0])[:, None]
        return np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])

    @cached_property
    def _rates(self) -> Array:
        """What each row adds in a second, shape (n, 4)."""
        rates = self.odometry[:, 1:]
        return np.hstack([rates, np.column_stack(kinds(*rates.T)) * rates])

    def commanded(self, since: float, until: float) -> tuple[float, float, float, float]:
        """Forward distance (m) and turn (rad) commanded in a span of time; of these what was on a curve, and driven.

        Nothing stamped after `until` counts.
        """
        distance, turn, curved, driven = (self._until(until) - self._until(since)).tolist()
        return distance, turn, curved, driven

    def _until(self, time: float) -> Array:
        row = int(np.searchsorted(self.odometry[:, 0], time, side="right")) - 1
        if row < 0:
            return np.zeros(4)
        return np.asarray(self._travelled[row] + self._rates[row] * (time - self.odometry[row, 0]))

    def sightings_in(self, after: float, until: float) -> list[list[float]]:
        """The sightings stamped in (after, until], in time order: stamp, subject, range, bearing."""
        first, last = np.searchsorted(self.sightings[:, 0], [after, until], side="right")
        rows: list[list[float]] = self.sightings[first:last].tolist()
        return rows

    def pose(self, time: float) -> tuple[float, float, float] | None:
        """The true x, y, heading, interpolated; None outside the recording and in a gap."""
        return interpolated(self.truth, time)


@dataclass(frozen=True, eq=False)
class Recording:
    """All files of a folder. Sightings of unknown barcodes and of the robot itself are dropped."""

    folder: Path
    tracks: dict[int, RobotFiles]  # by the robot's number
    landmarks: dict[int, Place]  # by subject number: surveyed position, m

    @property
    def first(self) -> float:
        """The first whole second at which every robot has odometry and ground truth."""
        return float(math.ceil(max(max(t.odometry[0, 0], t.truth[0, 0]) for t in self.tracks.values())))

    @property
    def last(self) -> float:
        """Until when every robot has ground truth."""
        return float(min(t.truth[-1, 0] for t in self.tracks.values()))

    def number(self, robot: str) -> int:
        """The number of a robot of the team, rK; UserError where the recording has none such."""
        match = re.fullmatch(r"r([0-9]{1,4})", robot)
        if match is None or int(match[1]) not in self.tracks:
            names = ", ".join(f"r{number}" for number in self.tracks)
            raise UserError(f"team.sub_teams: {self.folder} has no robot {robot}; it has {names}")
        return int(match[1])


def interpolated(poses: Array, time: float, gap: float = LONGEST_GAP) -> tuple[float, float, float] | None:
    """The x, y, heading at a time, of rows (time, x, y, heading) in time order; None outside of them and in a longer gap (s)."""
    row = int(np.searchsorted(poses[:, 0], time, side="right"))
    if row == 0:
        return None
    t0, x0, y0, h0 = (float(v) for v in poses[row - 1])
    if time == t0:
        return x0, y0, h0
    if row == len(poses) or poses[row, 0] - t0 > gap:
        return None
    t1, x1, y1, h1 = (float(v) for v in poses[row])
    part = (time - t0) / (t1 - t0)
    return x0 + part * (x1 - x0), y0 + part * (y1 - y0), h0 + part * wrap(h1 - h0)


def read_recording(folder: str | Path | None) -> Recording:
    """Read a folder. UserError: it or a file of it is missing, or a line is corrupt (file and line are named)."""
    path = recording_folder(folder)
    numbers = robots_in(path)
    subjects = {int(barcode): int(subject) for subject, barcode in table(path / "Barcodes.dat", 2)}
    landmarks = surveyed(path)
    tracks = {}
    for number in numbers:
        odometry = table(path / f"Robot{number}_Odometry.dat", 3)
        truth = table(path / f"Robot{number}_Groundtruth.dat", 4)
        for rows, name in ((odometry, "Odometry"), (truth, "Groundtruth")):
            if not len(rows):
                raise UserError(f"{path / f'Robot{number}_{name}.dat'}: no rows; a replay needs some")
        measured = table(path / f"Robot{number}_Measurement.dat", 4)
        measured[:, 1] = [subjects.get(int(barcode), -1) for barcode in measured[:, 1]]
        known = np.isin(measured[:, 1], [*(n for n in numbers if n != number), *landmarks])
        tracks[number] = RobotFiles(odometry, measured[known], truth)
    return Recording(path, tracks, landmarks)
