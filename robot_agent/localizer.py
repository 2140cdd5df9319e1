"""Markov localisation on a grid: one interface, two localizers.

A localizer is a value: every operation returns a new one, so that a robot may go back some ticks and play them again.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.sensing import Motion

#: Below this common mass the robot is not where the team says: it starts again there instead of reweighting its tails.
LOST = 1e-3

#: Relative floor of both beliefs in the ratio of Jeffrey's rule, so that tails that were left out on the wire do not matter.
TAIL = 1e-6


class Localizer(Protocol):
    """A robot's belief about itself."""

    def predict(self, motion: Motion, compass: float | None) -> Localizer:
        """Move: odometry, and the heading where a compass tells it."""

    def fixed(self, fix: Fix) -> Localizer:
        """Take an absolute position (and heading) as evidence."""

    def saw(self, sighting: Sighting, motion: Motion | None, place: Array, covariance: Array) -> Localizer:
        """Take a sighting of something at a place known up to a covariance (unit ** 2) as evidence."""

    def tempered(self, power: float) -> Localizer:
        """The belief to a power: how it counts where it may hold the same evidence as another."""

    def entropy(self) -> float:
        """Nats, over all that it estimates."""

    def marginal(self) -> Belief:
        """Where the robot is, on the team's grid."""

    def fold(self, agreed: Belief, reported: Belief) -> Localizer:
        """Jeffrey's rule: the position becomes `agreed` where it was `reported`; heading given position is kept."""

    def project(self, sighting: Sighting, motion: Motion | None) -> Belief:
        """What a sighting says about the seen subject's place, through the robot's own uncertain pose."""


def make(settings: RobotSection, grid: Grid) -> Localizer:
    """The localizer that the settings name, knowing nothing."""
    from robot_agent.pose import PoseLocalizer
    from robot_agent.position import PositionLocalizer

    kind = PoseLocalizer if settings.localizer == "pose" else PositionLocalizer
    return kind.unknown(settings, grid)


def log_ratio(agreed: Belief, reported: Belief) -> Array | None:
    """Ln of agreed over reported on the team's grid, zero where they are equal; None where they hardly meet."""
    if np.minimum(agreed.p, reported.p).sum() < LOST:
        return None
    floor = TAIL * max(agreed.p.max(), reported.p.max())
    return np.asarray(np.log((agreed.p + floor) / (reported.p + floor)))


def shifted(p: Array, dx: float, dy: float) -> Array:
    """Mass moved by some cells, a fraction split between neighbours (bilinear); what leaves the grid stays at its border."""
    return _along(_along(p, dx, 0), dy, 1)


def _along(p: Array, cells: float, axis: int) -> Array:
    whole = math.floor(cells)
    part = cells - whole
    moved = whole_shift(p, whole, axis)
    return moved if part == 0 else (1 - part) * moved + part * whole_shift(moved, 1, axis)


def whole_shift(p: Array, cells: int, axis: int) -> Array:
    """Mass moved by whole cells along an axis of a 2-D array; the border keeps what would leave."""
    if cells == 0:
        return p
    n = p.shape[axis]
    cells = max(-n, min(n, cells))
    out = np.zeros_like(p)
    a, b = (p, out) if axis == 0 else (p.T, out.T)
    if cells > 0:
        b[cells:] = a[: n - cells]
        b[-1] += a[n - cells :].sum(axis=0)
    else:
        b[: n + cells] = a[-cells:]
        b[0] += a[:-cells].sum(axis=0)
    return out


def sampled(values: Array, dx: float, dy: float) -> Array:
    """`values` read at points (dx, dy) cells beside the cell centres, each within a cell, bilinear, the border held."""
    return _read(_read(values, dx, 0), dy, 1)


def _read(values: Array, part: float, axis: int) -> Array:
    if part == 0:
        return values
    n = values.shape[axis]
    beside = np.clip(np.arange(n) + (1 if part > 0 else -1), 0, n - 1)
    return (1 - abs(part)) * values + abs(part) * np.take(values, beside, axis=axis)
