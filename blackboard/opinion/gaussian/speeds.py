"""Odometry that jumps: its frame was set anew, a counter overflowed, or somebody lies.

Nobody tells how fast the robots of a team can be. So a step is compared with how fast this robot and its mates usually drive.
If a jump were believed, the robot would be sure of a wrong place, and so would be its team about what it sees.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.vehicle import AXES, Motion, wrap
from blackboard.opinion.grid import Array

FULL = 3.0  # times as fast as usually: the full speed of a robot
JUMPS = 10.0  # times as fast as usually: more than from creeping to full speed
SHORTEST = 1e-6  # seconds: a step that claims less took so long
ENOUGH = 5.0  # seconds in motion after which it is known how fast a robot usually is
MEMORY = 20.0  # seconds in motion of which that is the root mean square
GROWS = 2.0  # times by which one step raises that, at most
NOTHING = np.zeros(2)


@dataclass
class Speeds(Copyable):
    """Mutable; `on_motion` once per robot and tick."""

    _usual: dict[str, Array] = field(default_factory=dict)  # robot -> unit / s and rad / s, shape (2,), while it moves
    _moved: dict[str, float] = field(default_factory=dict)  # robot -> seconds in motion

    def on_motion(self, robot: str, motion: Motion, seconds: float, pose: Array) -> Motion:
        """The motion of a step of so many `seconds`. A jump becomes a stand, with a sigma as long as the way.

        Its turn is kept if it is no faster than at full speed. `pose` is the covariance of the robot's pose, shape (3, 3) or larger.
        A way that is shorter than the sigma of the place is kept, because it does no harm.
        """
        moved = np.array([motion.way, abs(wrap(motion.turn))])
        if seconds <= 0 or not (moved > np.sqrt([motion.along + motion.across, motion.heading])).any():
            return motion
        usual, speeds = self.usual(robot), moved / max(seconds, SHORTEST)
        self._learn(robot, speeds, seconds)
        way, turn = moved.tolist()
        if not 0 < JUMPS * usual[0] < speeds[0] or way <= math.sqrt(np.trace(pose[AXES, AXES])):
            return motion
        most = FULL * float(usual[1]) * seconds if usual[1] > 0 else math.pi
        turned = Motion() if turn > most else motion
        along, across = motion.along + way**2, motion.across + way**2
        heading = motion.heading + min(turn, most) ** 2
        return Motion(0.0, turned.turn, motion.dt, motion.moving, along, across, heading, driven=turned.driven)

    def _learn(self, robot: str, speeds: Array, seconds: float) -> None:
        before, moved = self._usual.get(robot), self._moved.get(robot, 0.0) + seconds
        share = min(1.0, seconds / min(moved, MEMORY))
        after = speeds if before is None else np.sqrt((1 - share) * before**2 + share * speeds**2)
        if before is not None and moved > ENOUGH:
            after = np.where(before > 0, np.minimum(after, GROWS * before), after)
        self._usual[robot] = after
        self._moved[robot] = moved

    def usual(self, robot: str) -> Array:
        """How fast this robot usually is, or two others, of which one may lie: unit / s and rad / s; 0 while that is not known."""
        known = {name: self._usual[name] for name, moved in sorted(self._moved.items()) if moved >= ENOUGH}
        own = known.pop(robot, NOTHING)
        return np.maximum(own, np.sort([*known.values()], axis=0)[-2]) if len(known) > 1 else own
