"""Wheels that turn while the robot stands, and a robot that was moved: noticed by landmarks, and named. Pure.

Where most landmarks of a tick contradict the motion that the odometry measured, a robot asks whether it has stood since they
last fitted. If that fits them, its belief is widened by all that the odometry measured meanwhile, and the sightings decide. A
misread barcode fits neither story, so it changes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, drive
from blackboard.opinion.grid import Array

Seen = Sequence[tuple[Relative, Array]]  # sightings of landmarks with their places

STOOD = Motion(
    along=0.02**2, across=0.02**2, heading=0.02**2
)  # how far a robot that is stuck may have come all the same
SURE = 12.0  # by so much smaller must the squared distances be of a robot that stood: odds of 400 to 1
LONGEST = 10.0  # seconds since landmarks last fitted: later, nothing is said of what happened


@dataclass
class Mishaps:
    """Mutable. Each tick `judge` the landmarks in view before they are taken, then tell whether they `fitted`."""

    robot: str
    nuisance: Nuisance
    stuck: float = 0.0  # seconds for which it was stuck until now; 0 where it is not
    moved: float = 0.0  # 1 once it was found to be elsewhere, until landmarks fit again
    _sound: Moments | None = None  # its belief when all landmarks in view fitted last
    _since: Motion = field(default_factory=Motion)  # measured since
    _widened: bool = False  # whether the belief was widened in this tick

    def forget(self) -> None:
        """The belief was given up: nothing is compared with it."""
        self._sound, self._since, self.stuck = None, Motion(), 0.0

    def fitted(self, belief: Moments) -> None:
        """All landmarks that were seen in the tick fit this belief, which has taken them."""
        if not self._widened:
            self.stuck = self.moved = 0.0
        self._sound, self._since, self._widened = belief, Motion(), False

    def judge(self, joint: Joint, seen: Seen, motion: Motion) -> Motion | None:
        """What has to be added to the motion of a tick, in noise alone, if the robot stood meanwhile; else None."""
        self._since = self._since.plus(motion)
        since, self._widened = self._since, False
        if not seen or self._sound is None or since.dt > LONGEST or not (since.distance or since.turn):
            return None
        told = _squares(joint, seen, {self.robot: motion})
        if 2 * sum(squared > limit for squared, limit in told) <= len(told):
            return None
        still = Joint()
        still.add(self.robot, self._sound)
        drive(still, self.robot, STOOD, self.nuisance)
        stood = _squares(still, seen, {})
        gained = sum(squared for squared, _ in told) - sum(squared for squared, _ in stood)
        if gained < SURE or any(squared > limit for squared, limit in stood):
            return None
        self.stuck, self._widened = self.stuck + since.dt, True
        return Motion(along=since.distance**2, across=since.distance**2, heading=since.turn**2)


def _squares(joint: Joint, seen: Seen, motions: dict[str, Motion]) -> list[tuple[float, float]]:
    """The squared Mahalanobis distance of each sighting that tells a place, and the limit beyond which it contradicts."""
    squares = []
    for relative, place in seen:
        if relative.places:
            factor = linearise(joint, relative, motions, place)
            squares.append((joint.innovation(factor).squared, quantile(GATE, len(factor.residual))))
    return squares
