"""A sighting relative to the robot that took it, and the lasting errors of ranges."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.vehicle import AXES, STATES
from blackboard.opinion.grid import Array

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # a turn by 90 degrees: the derivative of a rotation
ALIKE = 1e-3  # variances that differ by less than this share are the same
NEAREST = 1e-6  # unit: nearer than this there is no line of sight
BiasBlock = tuple[str, str, str, float]  # "bias", observer, group, time constant (s)

Profile = tuple[tuple[float, float], ...]  # (distance, variance) pairs
Kind = Literal["range-bearing", "range", "bearing", "position", "pose"]
#: How many numbers a sighting of each further kind has: x and y are in the observer's frame, and so is the heading of a pose.
NUMBERS: dict[str, int] = {"range": 1, "bearing": 1, "position": 2, "pose": 3}


@dataclass(frozen=True)
class Bias:
    """An error of a range that lasts: its sigma (unit) and time constant (s)."""

    sigma: float
    seconds: float


@dataclass(frozen=True)
class Relative:
    """A relative belief: where `observer` saw `subject`, as range (unit) and bearing (rad) with their fresh variances.

    `age` is seconds before the end of the observer's tick; `ahead` is by how many seconds the subject's tick ended later than
    that, where ticks are not the world's. An object's tick ends with the middle robot's. `biases` are the lasting errors of the range,
    shared by all sightings of one observer in one `group` (by default those of the subject), each with a time constant of its own.
    `profile`, where given, replaces both variances: (distance, variance) pairs of an isotropic error of the seen position,
    interpolated, and to be averaged over the distances at which the subject may be.
    Other kinds than "range-bearing" are made by `measured`: of a range alone the bearing means nothing, and of a bearing alone
    the range. `spread` is the upper triangle of the covariance of a position (x, y), or of a pose (x, y, heading), in the
    observer's frame.
    """

    observer: str
    subject: str
    range: float
    bearing: float
    range_variance: float
    bearing_variance: float
    age: float = 0.0
    biases: tuple[Bias, ...] = ()
    group: str = ""
    profile: Profile = ()
    ahead: float = 0.0
    kind: Kind = "range-bearing"
    spread: tuple[float, ...] = ()
    heading: float = 0.0  # rad: of a pose, the subject's heading in the observer's frame
    confidence: float = 1.0  # the detector's, that something is there
    mark: int | None = None  # of an unnamed one: its number among those of the tick
    noisier: float = 1.0  # times the fresh variances that its observer claims (`as_noisy`)
    gone: tuple[float, float] = (0.0, 0.0)  # of an object: how far it has gone since (unit, the world's axes)
    strayed: float = 0.0  # of an object: the variance of that along each axis (unit^2)

    @property
    def places(self) -> bool:
        """Whether it says alone where its subject is."""
        return self.kind not in ("range", "bearing")

    @property
    def late(self) -> float:
        """Seconds between the sighting and the end of the subject's tick."""
        return self.age + self.ahead

    @property
    def is_scaled(self) -> bool:
        """Whether it depends on the observer's range scale.

        A profile covers a wrong scale, too. So does the covariance of a position or a pose without lasting errors.
        """
        return bool(self.biases) or self.kind == "range" or (self.kind == "range-bearing" and not self.profile)

    def numbers(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """What a sighting of a further kind measured, and the upper triangle of its covariance: as `measured` takes them."""
        if self.kind == "range":
            return (self.range,), (self.range_variance,)
        if self.kind == "bearing":
            return (self.bearing,), (self.bearing_variance,)
        x, y = (self.range * self.along()).tolist()
        return ((x, y, self.heading) if self.kind == "pose" else (x, y)), self.spread

    def along(self) -> Array:
        """The line of sight in the observer's frame, shape (2,)."""
        return np.array([math.cos(self.bearing), math.sin(self.bearing)])

    def spread_along(self, along: float, across: float) -> Array:
        """`spread` as a matrix along and across the line of sight, both axes stretched by so much."""
        turn = np.eye(math.isqrt(2 * len(self.spread)))
        sight = self.along()
        turn[AXES, AXES] = np.stack([sight, QUARTER @ sight]) * np.array([along, across])[:, None]
        return np.asarray(turn @ triangle(self.spread) @ turn.T)

    @property
    def flat_across(self) -> float:
        """Variance (unit ** 2) across the line of sight of an error that is Gaussian in x and y; 0 of one in range and bearing.

        A `spread` whose axes lie along and across the place that was measured was made of a range and a bearing.
        """
        if not self.spread:
            return 0.0
        (along, tie), (_, across) = self.spread_along(1.0, 1.0)[AXES, AXES].tolist()
        is_round = abs(along - across) <= ALIKE * (along + across)
        return float(across) if is_round or abs(tie) > ALIKE * math.sqrt(along * across) else 0.0

    def without_profile(self) -> "Relative":
        """The sighting with the variances that its profile has at the measured range."""
        if not self.profile:
            return self
        variance = float(np.interp(self.range, *np.array(self.profile).T))
        across = variance / max(self.range, NEAREST) ** 2
        return replace(self, range_variance=variance, bearing_variance=across, profile=())

    def as_noisy(self, by: float) -> "Relative":
        """The sighting with so many times the fresh variances that its observer claims; one with a profile stays as it is."""
        more = by / self.noisier
        if more == 1.0 or self.profile:
            return self
        return replace(
            self,
            range_variance=more * self.range_variance,
            bearing_variance=more * self.bearing_variance,
            spread=tuple(more * value for value in self.spread),
            noisier=by,
        )

    def blocks(self) -> dict[BiasBlock, float]:
        """The blocks of the lasting errors, standard normal states, and how far each moves the range (unit)."""
        return {bias_block(self.observer, self.group or self.subject, b.seconds): b.sigma for b in self.biases}


def measured(
    kind: Kind,
    observer: str,
    subject: str,
    values: Sequence[float],
    covariance: Sequence[float],
    age: float = 0.0,
    biases: tuple[Bias, ...] = (),
    group: str = "",
) -> Relative:
    """A sighting of one of the further kinds (`NUMBERS`); `covariance` is an upper triangle, row by row."""
    bearing, heading = 0.0, 0.0
    spread: tuple[float, ...] = ()
    if kind == "range":
        (distance,), (radial,), angular = values, covariance, 0.0
    elif kind == "bearing":
        (bearing,), (angular,), distance, radial = values, covariance, 0.0, 0.0
    else:
        distance, bearing = math.hypot(values[0], values[1]), math.atan2(values[1], values[0])
        spread, heading = tuple(covariance), values[2] if kind == "pose" else 0.0
        radial, angular = 0.0, 0.0
    sighting = Relative(
        observer, subject, distance, bearing, radial, angular, age, biases, group, (), 0.0, kind, spread, heading
    )
    if not spread:
        return sighting
    radial, across = np.diag(sighting.spread_along(1.0, 1.0))[:2]
    return replace(sighting, range_variance=float(radial), bearing_variance=float(across) / max(distance, NEAREST) ** 2)


def triangle(values: Sequence[float]) -> Array:
    """The symmetric matrix of an upper triangle, row by row."""
    size = math.isqrt(2 * len(values))
    rows, columns = _upper_indices(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = matrix[columns, rows] = values
    return matrix + 0.0  # no negative zeros


def upper(matrix: Array) -> tuple[float, ...]:
    """The upper triangle of a matrix, row by row."""
    return tuple(matrix[_upper_indices(len(matrix))].tolist())


@lru_cache(maxsize=STATES)
def _upper_indices(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The rows and columns of an upper triangle, row by row; made once for each size."""
    rows, columns = np.triu_indices(size)
    return rows, columns


def bias_block(observer: str, group: str, seconds: float) -> BiasBlock:
    """The name of a lasting error's block."""
    return ("bias", observer, group, seconds)


def forget_biases(joint: Joint, dt: float) -> None:
    """Let all lasting errors of ranges forget for `dt` seconds."""
    joint.decay({b: math.exp(-dt / b[3]) for b in joint.blocks if isinstance(b, tuple) and b[0] == "bias"})
