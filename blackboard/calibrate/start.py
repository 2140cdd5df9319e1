"""A first guess of where the robots drove: poses that two landmarks leave, and the odometry from one to the next."""

from __future__ import annotations

import math

import numpy as np

from blackboard.calibrate.drives import Drives
from blackboard.calibrate.model import Model
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.opinion.grid import Array

WINDOW = 3.0  # seconds: sightings of so long are taken together, moved by the odometry
AGREES = 0.15  # a landmark agrees with a pose that expects it within so many times its distance ...
LEAST = 0.2  # ... and so much (unit)
NEAREST = 0.5  # unit: two landmarks that are closer tell no heading


def first_poses(model: Model, shared: Array) -> Array:
    """Poses (K, N, 3) by the odometry with some shared numbers (N, 9), begun anew at each pose that readings leave.

    Backwards before the first one. A robot without any begins at 0.
    """
    drives = model.drives
    way, turn = model.steps(shared)
    poses = np.zeros((*turn.shape, 3))
    for n in range(len(drives.robots)):
        led = _led(way[:, n], turn[:, n])
        anchors = _anchors(drives, n, led)
        if not anchors:
            poses[:, n] = led
            continue
        ticks = np.array(sorted(anchors))
        nearest = np.abs(np.arange(len(led))[:, None] - ticks).argmin(axis=1)
        for k in range(len(led)):
            at = int(ticks[nearest[k]])
            poses[k, n] = _moved(anchors[at], led[at], led[k])
    return poses


def _led(way: Array, turn: Array) -> Array:
    """Where the odometry alone leads from 0, shape (K, 3)."""
    heading = np.cumsum(turn)
    middle = heading - turn / 2
    return np.column_stack([np.cumsum(way * np.cos(middle)), np.cumsum(way * np.sin(middle)), heading])


def _moved(anchor: Array, led: Array, other: Array) -> Array:
    """The pose that is to an anchor as one pose of the odometry is to another."""
    turned = anchor[2] - led[2]
    c, s = math.cos(turned), math.sin(turned)
    x, y = other[:2] - led[:2]
    return np.array([anchor[0] + c * x - s * y, anchor[1] + s * x + c * y, other[2] + turned])


def _anchors(drives: Drives, robot: int, led: Array) -> dict[int, Array]:
    """Poses by tick: fixes with a heading, and what sightings of two landmarks leave."""
    anchors: dict[int, Array] = {}
    headings = {int(k): float(v[0]) for k, n, v in _rows(drives.headings) if n == robot}
    for k, n, place in _rows(drives.fixes):
        if n == robot and int(k) in headings:
            anchors[int(k)] = np.array([*place, headings[int(k)]])
    sightings = drives.sightings.where((drives.sightings.robot == robot) & (drives.sightings.landmark >= 0))
    bearing = led[sightings.tick, 2] + sightings.bearing
    seen = led[sightings.tick, :2] + sightings.range[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    places, times = drives.places[sightings.landmark], drives.times[sightings.tick]
    first = 0
    for row in range(len(sightings.tick)):
        while times[row] - times[first] > WINDOW:
            first += 1
        if np.ptp(sightings.landmark[first : row + 1]) == 0:
            continue
        pose = _agreed(seen[first : row + 1], places[first : row + 1], sightings.range[first : row + 1])
        if pose is not None:
            at = led[sightings.tick[row]]
            anchors[int(sightings.tick[row])] = _moved(pose, np.zeros(3), at)
    return anchors


def _rows(measured: object) -> zip[tuple[int, int, Array]]:
    return zip(measured.tick, measured.robot, measured.value, strict=True)  # type: ignore[attr-defined]


def _agreed(seen: Array, places: Array, distance: Array) -> Array | None:
    """Shift and turn (3,) that lead points as seen to their places, with which most agree, of two landmarks at least."""
    best, most = None, 1
    for one in range(len(seen)):
        a, b = seen - seen[one], places - places[one]
        apart = np.hypot(*b.T)
        for other in np.flatnonzero(apart > NEAREST):
            turn = math.atan2(b[other, 1], b[other, 0]) - math.atan2(a[other, 1], a[other, 0])
            c, s = math.cos(turn), math.sin(turn)
            off = a @ np.array([[c, s], [-s, c]]) - b
            agree = np.hypot(*off.T) < LEAST + AGREES * (distance + distance[one])
            if agree.sum() > most and agree[other]:
                most, best = int(agree.sum()), agree
    if best is None:
        return None
    middle, there = seen[best].mean(axis=0), places[best].mean(axis=0)
    a, b = seen[best] - middle, places[best] - there
    turn = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    c, s = math.cos(turn), math.sin(turn)
    x, y = there - np.array([[c, -s], [s, c]]) @ middle
    return np.array([x, y, wrap(turn)])
