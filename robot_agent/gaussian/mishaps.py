"""Wheels that turn while the robot stands, and a robot that was moved: noticed by landmarks and fixes, and named. Pure.

Where most of these in a tick contradict the motion that the odometry measured, a robot asks whether it has stood since they
last fitted. If that fits them, its belief is widened by all that the odometry measured meanwhile, and they decide. A
misread barcode, or a fix that is an outlier, fits neither story, so it changes nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, drive

#: The measurements of place in a tick (landmarks, the fix), linearised at a joint; the motions are those of the tick, by robot.
Told = Callable[[Joint, Mapping[str, Motion]], Sequence[Factor]]

# How far a robot that is stuck may have come all the same.
STOOD = Motion(along=0.02**2, across=0.02**2, heading=0.02**2)
SURE = 12.0  # by so much smaller must the squared distances be of a robot that stood: odds of 400 to 1
LONGEST = 10.0  # seconds since landmarks last fitted: later, nothing is said of what happened


@dataclass
class Mishaps:
    """Mutable. Each tick `judge` the landmarks in view and the fix before they are taken, then tell whether they `fitted`."""

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
        """All measurements of place in the tick fit this belief, which has taken them."""
        if not self._widened:
            self.stuck = self.moved = 0.0
        self._sound, self._since, self._widened = belief, Motion(), False

    def judge(self, joint: Joint, told: Told, motion: Motion) -> Motion | None:
        """What has to be added to the motion of a tick, in noise alone, if the robot stood meanwhile; else None."""
        self._since = self._since.plus(motion)
        since, self._widened = self._since, False
        if self._sound is None or since.dt > LONGEST or not (since.way or since.turn):
            return None
        moved = _squares(joint, told(joint, {self.robot: motion}))
        if 2 * sum(squared > limit for squared, limit in moved) <= len(moved):
            return None
        still = Joint()
        still.add(self.robot, self._sound)
        drive(still, self.robot, STOOD, self.nuisance)
        stood = _squares(still, told(still, {}))
        gained = sum(squared for squared, _ in moved) - sum(squared for squared, _ in stood)
        if gained < SURE or any(squared > limit for squared, limit in stood):
            return None
        self.stuck, self._widened = self.stuck + since.dt, True
        return Motion(along=since.way**2, across=since.way**2, heading=since.turn**2)


def _squares(joint: Joint, factors: Sequence[Factor]) -> list[tuple[float, float]]:
    """The squared Mahalanobis distance of each measurement, and the limit beyond which it contradicts."""
    return [(joint.innovation(factor).squared, quantile(GATE, len(factor.residual))) for factor in factors]
