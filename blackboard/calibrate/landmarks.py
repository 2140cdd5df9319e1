"""Landmarks that are not where the map has them, or that carry each other's names: by where all robots see them."""

import math
from dataclasses import dataclass

import numpy as np

from blackboard.calibrate.fit import Fit
from blackboard.calibrate.model import BEARING as BEARING_BIAS
from blackboard.calibrate.model import RANGE, RANGE_BIAS
from blackboard.opinion.grid import Array

FEWEST = 8  # sightings of a landmark before anything is said of it
SURE = 4.0  # standard errors that it is off, at least ...
FAR = 2.0  # ... and times the error of a sighting of it
ALIKE = 10.0  # seconds: sightings of one landmark by one robot within so long err alike


@dataclass(frozen=True)
class Misplaced:
    """A landmark that is seen elsewhere than the map has it."""

    landmark: str
    map: tuple[float, float]
    seen: tuple[float, float]
    sigma: float  # unit: of where it is seen, in each coordinate
    sightings: int
    exchanged: str = ""  # the landmark whose place it is seen at, and which is seen at its

    @property
    def off(self) -> float:
        return math.dist(self.map, self.seen)


def misplaced(fit: Fit) -> list[tuple[int, Misplaced]]:
    """The landmarks that are seen elsewhere, by their numbers, the farthest off first, in errors of a sighting."""
    candidates = []
    for number in range(len(fit.drives.landmarks)):
        place, least = _place_seen(fit, number)
        if place is not None and place.off > SURE * place.sigma and place.off > FAR * least:
            candidates.append((place.off / least, number, place))
    return [(number, place) for _, number, place in sorted(candidates, key=lambda candidate: -candidate[0])]


def apart(fit: Fit, landmark: int) -> float:
    """How far from its place a landmark is seen, in errors of a sighting; 0 where it was seen too rarely."""
    place, least = _place_seen(fit, landmark)
    return 0.0 if place is None else place.off / least


def _place_seen(fit: Fit, number: int) -> tuple[Misplaced | None, float]:
    """Where a landmark is seen, and the error of a sighting (unit); None where it was seen too rarely."""
    points, expected, tick, robot = _seen(fit, number)
    if len(points) < FEWEST:
        return None, math.inf
    middle = np.median(points, axis=0)
    spread = max(1e-6, 1.4826 * float(np.median(np.abs(points - middle))))
    once = len(np.unique(np.column_stack([robot, np.floor(fit.drives.times[tick] / ALIKE)]), axis=0))
    sigma = 1.25 * spread / math.sqrt(once)
    place = Misplaced(
        fit.drives.landmarks[number], _point(fit.drives.places[number]), _point(middle), sigma, len(points)
    )
    return place, max(spread, float(np.median(expected)))


def exchanged(place: list[Misplaced]) -> list[Misplaced]:
    """The same, with the pairs named that are seen at each other's places: nearer to them than to their own by half."""
    both = []
    for one in place:
        pairs = [other for other in place if other is not one and _swaps(one, other)]
        name = pairs[0].landmark if pairs else ""
        both.append(Misplaced(one.landmark, one.map, one.seen, one.sigma, one.sightings, name))
    return both


def _swaps(one: Misplaced, other: Misplaced) -> bool:
    apart = math.dist(one.map, other.map)
    return max(math.dist(one.seen, other.map), math.dist(other.seen, one.map)) < apart / 2


def _point(place: Array) -> tuple[float, float]:
    return round(float(place[0]), 3), round(float(place[1]), 3)


def _seen(fit: Fit, landmark: int) -> tuple[Array, Array, Array, Array]:
    """Where each sighting of a landmark has it, shape (M, 2), how far each may be off, its tick and its robot."""
    sightings = fit.drives.sightings.where(fit.drives.sightings.landmark == landmark)
    pose = fit.model.at(fit.poses, sightings, sightings.robot)
    shared = fit.shared[sightings.robot]
    away = (sightings.range - shared[:, RANGE_BIAS]) / (1 + shared[:, RANGE])
    angle = pose[:, 2] + sightings.bearing - shared[:, BEARING_BIAS]
    points = pose[:, :2] + away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    variance = fit.noise.range_variance(sightings.robot, away) + (away * fit.noise.bearing[sightings.robot]) ** 2
    return points, np.sqrt(variance), sightings.tick, sightings.robot
