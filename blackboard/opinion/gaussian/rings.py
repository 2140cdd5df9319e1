"""Where something is of which only ranges or bearings are known: a ring or a ray each, until they meet in one place.

The sightings are kept, and solved together from many starts along the first one. Two places may fit, as mirror images do where
observers stand on one line: then both are known, each with its weight, until a sighting tells them apart. The places found are
Gaussians by the curvature at the optimum (Laplace's approximation).
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import NEAREST, Relative
from blackboard.opinion.gaussian.vehicle import AXES, BEARING, HEADING, Motion, moved_in, wrap
from blackboard.opinion.grid import Array

MOST = 32  # sightings that are kept of one thing, from places that are far apart
OLDEST = 20.0  # seconds: what was seen earlier is not kept
STARTS = 24  # along the first ring, or ray
STEPS, REFINED = 12, 4  # of Gauss and Newton, from all starts, and for what is left of them
FARTHEST = 50.0  # times the distance between observers: no ray is followed farther
APART = 3.0  # sigmas between two places that are two
#: A place is a Gaussian where no ring or ray bends by more than this share of its noise within a sigma of the place
#: (Lerro and Bar-Shalom, IEEE TAES 29(3), 1993).
CURVED = 0.4
SURE = 0.99  # the weight of a place that is taken for the only one
UNLIKELY = 1e6  # a place that is so many times less likely than the likeliest is none
LEAST = 1e-12  # of a variance
FEWEST = 3  # sightings before a place is believed: two rings meet in two places


@dataclass(frozen=True, eq=False)
class Line:
    """A range (unit), or the direction (rad, world axes) of a bearing, from a place, shape (2,), known up to `own` (unit ** 2).

    `variance` is of the range or the direction, with all its errors. `time` is in seconds, of any clock that goes on.
    """

    place: Array
    value: float
    variance: float
    own: float
    is_range: bool
    time: float


@dataclass(frozen=True, eq=False)
class RingPlace:
    """Where it may be, with the share of what is believed."""

    moments: Moments
    weight: float


class _Columns(NamedTuple):
    """The numbers of n sightings, as in `Line`, and the covariance of the thing's walks along one axis since each, shape (n, n)."""

    places: Array
    ranges: npt.NDArray[np.bool_]
    values: Array
    fresh: Array
    own: Array
    walked: Array


@dataclass
class Ring(Copyable):
    """Mutable: what was seen of one thing. `walk` is how it moves, unit / sqrt(s); `finder` is the robot that saw it first.

    `sharpest` is the least sigma (unit) of a place that a sensor can tell, as in `limits`. For a bearing it needs the distance, which
    is known here only.
    """

    walk: float = 0.0
    finder: str = ""
    sharpest: float = 0.0
    _lines: list[Line] = field(default_factory=list)

    def add(self, line: Line) -> None:
        """Keep a sighting, and forget those that are old; of too many, the older of the two of a kind from the nearest places."""
        self._lines = [kept for kept in self._lines if kept.time >= line.time - OLDEST] + [line]
        if len(self._lines) > MOST:
            places, ranges = self._places_seen_from()
            apart = np.hypot(*(places[:, np.newaxis] - places).T)
            apart[(ranges[:, np.newaxis] != ranges) | np.tri(len(places), dtype=bool)] = math.inf
            del self._lines[int(apart.min(axis=1).argmin())]

    def move(self, by: Array) -> None:
        """The thing moved by so much, shape (2,), as it knows itself: what was seen before is seen from as far on."""
        self._lines = [replace(line, place=line.place + by) for line in self._lines]

    @property
    def newest(self) -> float:
        """The time of the newest sighting."""
        return self._lines[-1].time

    def places(self) -> tuple[RingPlace, ...]:
        """Where it may be, the likeliest first; empty while it is somewhere along a ring or a ray, or numbers are absurd."""
        if len(self._lines) < FEWEST:
            return ()
        try:
            with np.errstate(all="raise", under="ignore"):
                return self._places()
        except (ArithmeticError, np.linalg.LinAlgError):
            return ()

    def _places(self) -> tuple[RingPlace, ...]:
        lines = self._columns()
        costs, ends, information = self._solved(lines, self._starts(lines.places), STEPS, together=False)
        some = _distinct(costs, ends, information)
        costs, ends, information = self._solved(lines, ends[some], REFINED, together=True)
        kept = _distinct(costs, ends, information)
        if np.linalg.det(information[kept]).min() <= 0:
            return ()
        shares = np.exp(-0.5 * (costs[kept] - costs.min())) / np.sqrt(np.linalg.det(information[kept]))
        common = lines.own.max()  # their errors last: many sightings do not average them
        places = []
        for k, share in zip(kept, (shares / shares.sum()).tolist(), strict=True):
            covariance = np.linalg.inv(information[k]) + common * np.eye(2)
            if self._is_curved(lines, ends[k], math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))):
                return ()
            places.append(RingPlace(Moments(ends[k], covariance), share))
        return tuple(sorted(places, key=lambda place: -place.weight))

    def _is_curved(self, lines: _Columns, end: Array, sigma: float) -> bool:
        """Whether some ring or ray bends too much, within a sigma (unit) of a place, for the place to be a Gaussian."""
        _, _, variance, distance = self._linear(lines, end[np.newaxis])
        noise = np.sqrt(variance + lines.walked.diagonal())[0]
        bent = np.minimum(sigma**2 / distance[0], 2 * sigma)
        return bool((np.minimum(noise, sigma) * bent > CURVED * noise**2).any())

    def _columns(self) -> _Columns:
        numbers = [(line.value, line.variance, line.own, line.time) for line in self._lines]
        values, fresh, own, times = np.array(numbers).T
        ages = self.newest - times
        walked = self.walk**2 * np.minimum(ages[:, np.newaxis], ages)
        places, ranges = self._places_seen_from()
        return _Columns(places, ranges, values, fresh, own, walked)

    def _places_seen_from(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """From where, shape (n, 2), and whether it was a range, shape (n,)."""
        return np.array([line.place for line in self._lines]), np.array([line.is_range for line in self._lines])

    def _starts(self, places: Array) -> Array:
        """Points along the first ring, or along the first ray, shape (s, 2). `places` are those seen from, shape (n, 2)."""
        first = self._lines[0]
        if first.is_range:
            angles = np.arange(STARTS) * 2 * math.pi / STARTS
            return np.asarray(
                first.place + max(first.value, NEAREST) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            )
        spread = max(NEAREST, float(np.ptp(places, axis=0).max()))
        away = spread * np.geomspace(0.1, FARTHEST, STARTS)
        return np.asarray(first.place + away[:, None] * [math.cos(first.value), math.sin(first.value)])

    def _linear(self, lines: _Columns, ends: Array) -> tuple[Array, Array, Array, Array]:
        """At some places: the derivatives of the sightings, shape (s, n, 2), residuals, variances without walks, and distances."""
        away = ends[:, None] - lines.places
        distance = np.maximum(np.hypot(away[..., 0], away[..., 1]), NEAREST)
        turned = lines.values - np.arctan2(away[..., 1], away[..., 0])
        off = np.where(lines.ranges, lines.values - distance, wrap(turned) * distance)
        across = np.stack([-away[..., 1], away[..., 0]], axis=-1)
        rows = np.where(lines.ranges[:, None], away, across) / distance[..., None]
        fresh = np.where(lines.ranges, lines.fresh, lines.fresh * distance**2)
        variance = np.maximum(fresh, self.sharpest**2) + lines.own
        return rows, off, variance, distance

    def _solved(self, lines: _Columns, starts: Array, steps: int, *, together: bool) -> tuple[Array, Array, Array]:
        """By Gauss and Newton from each start: - 2 ln(likelihood), shape (s,), place, (s, 2), and information, (s, 2, 2).

        The walks since two sightings have a part in common. `together` counts that; without it a step is faster.
        """
        ends, walked, unit = starts, lines.walked, np.eye(len(lines.values))
        for step in range(steps + 1):
            rows, off, variance, distance = self._linear(lines, ends)
            if together:
                spread = variance[:, :, None] * unit + np.einsum("snk,smk->snm", rows, rows) * walked
                weighed = np.linalg.solve(spread, np.concatenate([rows, off[..., None]], axis=-1))
                logs = np.linalg.slogdet(spread)[1]
            else:
                spread = variance + walked.diagonal()
                weighed = np.concatenate([rows, off[..., None]], axis=-1) / spread[..., None]
                logs = np.log(spread).sum(axis=1)
            information = np.swapaxes(rows, 1, 2) @ weighed[..., :2]
            if step < steps:
                damped = information + 1e-9 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)
                by = np.linalg.solve(damped, np.swapaxes(rows, 1, 2) @ weighed[..., 2:])[..., 0]
                longest = np.median(distance, axis=1)
                ends = ends + by * np.minimum(1.0, longest / np.maximum(np.hypot(*by.T), NEAREST))[:, None]
        return np.einsum("sn,sn->s", off, weighed[..., 2]) + logs, ends, information


def _distinct(costs: Array, ends: Array, information: Array) -> list[int]:
    """Which of some places are likely enough and apart from likelier ones, the likeliest first."""
    kept: list[int] = []
    for k in np.argsort(costs, kind="stable").tolist():
        if costs[k] > costs.min() + 2 * math.log(UNLIKELY):
            break
        apart = [(ends[k] - ends[other], information[other]) for other in kept]
        if all(float(way @ its @ way) > APART**2 for way, its in apart):
            kept.append(k)
    return kept


def line_of(observer: Moments, relative: Relative, motion: Motion | None, time: float) -> Line:
    """A range or a bearing alone as a line, by the block of the robot that took it and its motion in the tick."""
    back, turned = moved_in(observer.mean, motion, relative.age)
    own = float(np.linalg.eigvalsh(observer.covariance[AXES, AXES])[-1])
    if relative.kind == "range":
        variance = relative.range_variance + sum(bias.sigma**2 for bias in relative.biases)
        return Line(observer.mean[AXES] - back, relative.range, max(variance, LEAST), own, True, time)
    angle = float(observer.mean[HEADING] - observer.mean[BEARING]) - turned + relative.bearing
    variance = relative.bearing_variance + float(
        observer.covariance[HEADING, HEADING] + observer.covariance[BEARING, BEARING]
    )
    return Line(observer.mean[AXES] - back, angle, max(variance, LEAST), own, False, time)
