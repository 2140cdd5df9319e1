"""How much of the turns that the odometry tells alternates from tick to tick, as noise does and a curve does not. Pure.

Noise in what was told makes its scale look smaller than it is, the more the less a robot really turns (regression dilution,
Fuller, Measurement Error Models, 1987). So the scale of turns on a curve is learned only of turns that are beyond it. Commands that
change at once alternate, too, but not all of the time: so a low quantile counts.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from blackboard.wire.messages import Odometry

REMEMBERED = 64  # ticks in motion by which the noise is judged
FEWEST = 8  # of them; before, nothing is known of the noise, and no turn is taken for real
SHARE = 0.3  # the quantile of their second differences, and what it is of white noise, in its sigmas
TO_SIGMA = 0.3853 * math.sqrt(6)
SECOND = 1.0 - 1e-6  # a turn is judged by so many seconds
BEYOND = (2.0, 3.0)  # sigmas of the noise in that time: up to the first no turn is real, from the second on it is


@dataclass
class Jitter:
    """Mutable; `real` for each odometry of a robot."""

    _turns: deque[tuple[float, float]] = field(default_factory=deque)  # of the last second in motion: radians, seconds
    _changes: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))  # rad / sqrt(s)

    def real(self, told: Odometry) -> float:
        """The share of a turn that noise does not explain, 0 to 1."""
        if told.dt <= 0 or not (told.distance or told.turn):
            self._turns.clear()
            return 1.0
        self._turns.append((told.turn, told.dt))
        if len(self._turns) >= 3:
            one, two, three = [turn / math.sqrt(dt) for turn, dt in self._turns][-3:]
            self._changes.append(abs(three - 2 * two + one))
        while len(self._turns) > 3 and sum(dt for _, dt in self._turns) - self._turns[0][1] >= SECOND:
            self._turns.popleft()
        if len(self._changes) < FEWEST:
            return 0.0
        sigma = sorted(self._changes)[int(SHARE * len(self._changes))] / TO_SIGMA
        turn = seconds = 0.0
        for it, dt in reversed(self._turns):
            turn, seconds = turn + it, seconds + dt
            if seconds >= SECOND:
                break
        low, high = BEYOND
        noise = sigma * math.sqrt(seconds)
        return min(1.0, max(0.0, (abs(turn) / noise - low) / (high - low))) if noise > 0 else 1.0
