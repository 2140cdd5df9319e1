"""How fast a robot moved lately at most, by its odometry: boards widen its old reports by it. Pure."""

from __future__ import annotations

from collections import deque

import numpy as np

from blackboard.wire.messages import Odometry

FASTEST = 1e6  # unit per second that is said at most
LATELY = 50  # ticks of which the speed is said
SPAN = 5  # ticks over which a steady speed is averaged


class Speed:
    """The greatest speed of the last ticks, unit per second."""

    def __init__(self, *, steady: bool) -> None:
        """`steady`: averaged over a few ticks, for a robot that is often silent.

        Its reports grow old before the next one, and the noise of a single tick's odometry would let them spread too far.
        """
        self._steady = steady
        self._speeds: deque[float] = deque(maxlen=LATELY)

    def add(self, odometry: Odometry) -> None:
        self._speeds.append(abs(odometry.distance) / odometry.dt)

    @property
    def most(self) -> float | None:
        """None before any odometry."""
        if not self._speeds:
            return None
        speeds = list(self._speeds)
        if not self._steady:
            return min(max(speeds), FASTEST)
        ticks = min(SPAN, len(speeds))
        means = [sum(speeds[i : i + ticks]) / ticks for i in range(len(speeds) - ticks + 1)]
        return float(np.float32(min(max(means), FASTEST)))
