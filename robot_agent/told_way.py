"""The odometry of a robot that does not send in each tick: one chord from message to message. Pure.

The sums of odometry alone lose the shape of the way between two messages: whether it went ahead first, or turned first. Boards
take a robot to move evenly from one message to the next, so a sighting is told as it would have been seen from such a way.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.gaussian.vehicle import FORWARD, STATES, TURN, Motion, moved_in, turned_by
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import PackedEvidence, PackedMotion
from blackboard.wire.gaussians import unpack_motion

STEPS = 256  # ticks of which it is known how the robot moved
RIGHT = np.zeros(STATES)  # a robot at the origin, whose odometry is right
RIGHT[[FORWARD, TURN]] = 1.0


@dataclass(frozen=True)
class Shift:
    """The pose of a camera when it saw something, in the frame in which the sighting is sent: unit, shape (2,), and radians."""

    place: Array
    turned: float

    def __bool__(self) -> bool:
        return bool(self.turned or self.place.any())

    def moved(self, seen: Array) -> Array:
        """A point that the camera saw, shape (2,), in the frame in which it is sent."""
        return self.place + turned_by(seen, self.turned)


@dataclass
class ToldWay:
    """Mutable. `on_tick` with the evidence of each tick, `said` once that was sent."""

    _epoch: int | None = None
    _travelled: Motion = field(default_factory=Motion)  # since the epoch began, as the filter sums it up
    _told: Motion = field(default_factory=Motion)  # the same as the sum of the chords that were said
    _chord: Motion = field(default_factory=Motion)  # since something was said
    _last: Motion = field(default_factory=Motion)  # the chord that was said last, with those before
    _steps: list[Motion] = field(default_factory=list)  # of the newest ticks, the newest first

    def on_tick(self, evidence: PackedEvidence) -> None:
        """Take how far a robot has come by the end of a tick; in a new epoch nothing was said before."""
        travelled = unpack_motion(evidence.travelled)
        if evidence.epoch != self._epoch:
            self._epoch, self._told, self._steps = evidence.epoch, travelled, []
            self._chord = self._last = Motion()
        else:
            step = travelled.since(self._travelled)
            self._chord = self._chord.then(step)
            if step.dt > 0:
                self._steps = [step, *self._steps[: STEPS - 1]]
        self._travelled = travelled

    def said(self) -> None:
        """What was travelled until now has been sent."""
        self._told, self._last, self._chord = self._sum(), self._even(), Motion()

    def told(self, evidence: PackedEvidence) -> PackedMotion:
        """What is sent of the way in the newest tick's evidence."""
        whole = self._sum()
        ahead = {"distance": whole.distance, "aside": whole.aside, "curved": whole.curved}
        return evidence.travelled.model_copy(update=ahead)

    def shift(self, then: float, age: float) -> Shift:
        """The pose of `then`, as seen from the pose that boards interpolate at an `age`; both are seconds before now.

        Now is the end of the newest tick. Boards interpolate along the chords. The shift is zero where the steps since `then` are no
        longer known.
        """
        newest, *before = self._steps or [Motion()]
        steps = replace(newest, before=tuple(before))
        if not 0.0 <= then <= steps.covered:
            return Shift(np.zeros(2), 0.0)
        came, turned = moved_in(RIGHT, steps, then)
        presumed, headed = moved_in(RIGHT, self._even(), age)
        return Shift(turned_by(presumed - came, headed), headed - turned)

    def _sum(self) -> Motion:
        return self._told.plus(self._chord)

    def _even(self) -> Motion:
        return self._chord.after(self._last, self._chord.dt)
