"""How much one robot's evidence may be worth, whatever it claims: as much as one place told by the sharpest sensor of the team.

A claimed covariance says nothing about the truth. So a board holds three things against `sharpest`, the least sigma (unit) of a place:

- a sighting: no range, and no place across the line of sight, is known better;
- all that a robot says of itself: its increments are multiplied into a filter of its own (`alone`), whose place is never known better,
  however often they come and however little it claims that its motion adds; nor much better than the belief that it tells beside
  them, which `contacts` holds against its mates': of an honest robot the two are the same but for where they linearise.
  An increment that is more than the belief gained since the robot's last report does not count (`NEARLY`). Else a robot that tells
  the team's belief as its own evidence makes the team twice as sure in each tick;
- the belief with which it enters: no sharper, and after `ENTRIES` beginnings in a row wider, as `RENEWAL` says. Its mates keep what
  they learned from the epochs before, so a robot that begins anew each tick would count once for each. Nor does who begins again
  know more than it said before, or than two of its mates say of themselves. Where the team's sensors tell less than the sharpest
  could, a robot that claims to be certain would else outweigh all its mates.

Nothing that stays within them is changed, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.increment import Increment, likelihood
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.mounts import CompassReading, heading_factor
from blackboard.opinion.gaussian.relation import Profile, Relative, triangle, upper
from blackboard.opinion.gaussian.vehicle import AXES, Motion, Nuisance, correct, drive
from blackboard.opinion.grid import Array

ENTRIES = 3.0  # beginnings in a row that count in full: a start, a restart, and one that follows a lie found out
RENEWAL = 60.0  # seconds until one more does
HALVINGS = 20  # of the share of an increment that is sought
ROUGHLY = 0.5  # share of the variance of the belief that a robot tells, which its increments together may leave
#: The least variance of the last belief, predicted and corrected by the increment, as a share of that of the belief beside it. Of
#: an honest filter the share is about 1. Of a robot that sends its whole belief as an increment it is about 0.5: that counts twice.
NEARLY = 0.7
LEAST = 1e-4  # share of a beginning that always counts, so that its covariance is a number


@dataclass
class Limits(Copyable):
    """Mutable; `pass_time` once per tick, the rest in the order of the joint's steps. With `sharpest` 0 nothing is bounded."""

    sharpest: float = 0.0
    _alone: dict[str, Joint] = field(default_factory=dict)  # robot -> what it alone says of itself
    #: Robot -> the belief in its last report, predicted to now by its odometry.
    _believed: dict[str, Joint] = field(default_factory=dict)
    _entries: dict[str, float] = field(default_factory=dict)  # robot -> beginnings that would count in full

    def copy(self) -> Self:
        """The same, which may be changed without changing this one."""
        other = super().copy()
        other._alone, other._believed = (
            {robot: own.copy() for robot, own in of.items()} for of in (self._alone, self._believed)
        )
        return other

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._entries = {
            robot: entries for robot, n in self._entries.items() if (entries := n + dt / RENEWAL) < ENTRIES
        }

    def entering(self, robot: str, belief: Moments) -> Moments:
        """The belief with which a robot's block enters the joint."""
        if not self.sharpest:
            return belief
        self._believed[robot] = _joint(robot, belief)
        left = self._entries.get(robot, ENTRIES)
        self._entries[robot] = max(0.0, left - 1.0)
        blunted = _blunted(belief.covariance, max(self.sharpest**2, self._known(robot)))
        belief = Moments(belief.mean, blunted / min(1.0, max(left, LEAST)))
        self._alone[robot] = _joint(robot, belief)
        return belief

    def _known(self, robot: str) -> float:
        """The least variance (unit^2) of its place with which a robot may enter again; 0 where it enters first, or has one mate.

        It is the one that it had before, or that of its second sharpest mate, whichever is smaller.
        """
        least = {name: _sharpest(own, name) for name, own in self._alone.items()}
        before = least.pop(robot, 0.0)
        return min(before, sorted(least.values())[1]) if len(least) > 1 else 0.0

    def drive(self, robot: str, motion: Motion, nuisance: Nuisance) -> None:
        """Predict what is held of a robot by its motion.

        A robot without motion may have been moved without measuring it. So its last belief is dropped, and its next increment passes.
        """
        if not motion.moving:
            self._believed.pop(robot, None)
        for own in (self._alone, self._believed):
            if robot in own:
                drive(own[robot], robot, motion, nuisance)

    def on_compass(self, robot: str, reading: CompassReading | None) -> None:
        """Take a compass reading into what the robot alone says of itself, as if it had no lasting error: so that is bounded more."""
        if reading is not None and robot in self._alone:
            alone = self._alone[robot]
            correct(alone, heading_factor(alone, robot, reading.heading - reading.bias, math.sqrt(reading.variance)))

    def without_echo(self, robot: str, increment: Increment | None, told: Moments | None) -> Increment | None:
        """The increment of a report, or None where it holds more information on the robot's place than its belief has gained.

        Such an increment is an echo of what the team told the robot. `told` is the belief in the report; it is kept for the next one.
        """
        believed = self._believed.pop(robot, None)
        if self.sharpest and told is not None:
            self._believed[robot] = _joint(robot, told)
        if increment is None or told is None or believed is None or robot not in self._alone:
            return increment
        after = _multiplied(believed, robot, increment, 1.0)
        return None if _is_sharper(after, robot, [NEARLY * told.covariance[AXES, AXES]]) else increment

    def increment(
        self, robot: str, increment: Increment | None, variance: float, told: Moments | None = None
    ) -> Increment | None:
        """As much of an increment as leaves the robot's own place no sharper; None: nothing.

        `variance` is what was learned of the noise of the robot's increments, relative to what it claims; `told` is the first-hand
        belief that it tells after this increment.
        """
        if increment is None or robot not in self._alone:
            return increment
        before, least = self._alone[robot], variance * self.sharpest**2 * np.eye(2)
        floors = [least] if told is None else [least, ROUGHLY * told.covariance[AXES, AXES]]
        share, too_much = 1.0, 1.0
        after = _multiplied(before, robot, increment, share)
        if _is_sharper(after, robot, floors):
            share = 0.0
            for _ in range(HALVINGS):
                middle = (share + too_much) / 2
                tried = _multiplied(before, robot, increment, middle)
                share, too_much = (share, middle) if _is_sharper(tried, robot, floors) else (middle, too_much)
            after = _multiplied(before, robot, increment, share)
        self._alone[robot] = after
        return None if share == 0 else _scaled(increment, share)

    def sighting(self, relative: Relative, distance: float) -> Relative:
        """A sighting that claims no more than the sharpest sensor could; `distance` (unit) is how far away its subject is."""
        least = self.sharpest**2
        across = least / max(distance, self.sharpest) ** 2 if least else 0.0
        spread = relative.spread
        if spread:
            covariance = triangle(spread)
            blunted = self.blunted(covariance)
            spread = spread if blunted is covariance else upper(blunted)
        sharp = relative.range_variance < least or relative.bearing_variance < across or spread is not relative.spread
        if not sharp and _floored(relative.profile, least) == relative.profile:
            return relative
        return replace(
            relative,
            range_variance=max(least, relative.range_variance),
            bearing_variance=max(across, relative.bearing_variance),
            profile=_floored(relative.profile, least),
            spread=spread,
        )

    def blunted(self, covariance: Array) -> Array:
        """A covariance with a place that is known no better than the sharpest sensor could tell; the same one where it is not."""
        return _blunted(covariance, self.sharpest**2)


def _joint(robot: str, belief: Moments) -> Joint:
    own = Joint()
    own.add(robot, belief)
    return own


def _blunted(covariance: Array, least: float) -> Array:
    """A covariance with a place that has at least a least variance in every direction; the same one where it has."""
    values, axes = np.linalg.eigh(covariance[AXES, AXES])
    lacking = np.maximum(0.0, least - values)
    if not lacking.any():
        return covariance
    blunted = covariance.copy()
    blunted[AXES, AXES] += (axes * lacking) @ axes.T
    return blunted


def _sharpest(alone: Joint, robot: str) -> float:
    """The least variance of a robot's own place, in any direction."""
    return float(np.linalg.eigvalsh(alone.moments(robot).covariance[AXES, AXES])[0])


@lru_cache(maxsize=256)  # all sightings of a robot have one profile
def _floored(profile: Profile, least: float) -> Profile:
    """A profile with no variance below a least one."""
    return tuple((at, max(least, variance)) for at, variance in profile)


def _multiplied(alone: Joint, robot: str, increment: Increment, share: float) -> Joint:
    """A robot's own belief after a share of an increment."""
    after = alone.copy()
    factor = likelihood(after, robot, _scaled(increment, share))
    if factor is not None:
        correct(after, factor)
    return after


def _scaled(increment: Increment, share: float) -> Increment:
    """The likelihood to a power."""
    if share == 1.0:
        return increment
    return replace(increment, information=increment.information * share, vector=increment.vector * share)


def _is_sharper(alone: Joint, robot: str, floors: Sequence[Array]) -> bool:
    """Whether a robot's place is known better, in some direction, than one of some covariances (2, 2) says."""
    place = alone.moments(robot).covariance[AXES, AXES]
    return bool((np.linalg.eigvalsh(place - np.array(floors))[:, 0] < 0).any())
