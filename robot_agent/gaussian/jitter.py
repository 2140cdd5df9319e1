"""Whether a measured turn is more than the white noise of the odometry, whose size is estimated from the measured turns alone. Pure.

Noise in a measured turn makes the estimated scale of turns too small, the more the less the robot really turns (regression
dilution: Fuller, Measurement Error Models, 1987). So the filter learns the scale from significant turns only.

The second differences of the turns remove constant and evenly growing rates of turn, and keep white noise. A command that changes
makes a large difference in some ticks, noise in all of them. So a low quantile of the differences gives the size of the noise.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from blackboard.wire.messages import Odometry

REMEMBERED = 64  # second differences that are kept, of ticks in motion
FEWEST = 8  # second differences that are needed; with fewer, no turn is significant
QUANTILE = 0.3  # of the absolute second differences
#: That quantile for white noise of unit variance: 0.3853 of a standard normal, times the sigma of a second difference.
PER_SIGMA = 0.3853 * math.sqrt(6)
SECOND = 1.0 - 1e-6  # seconds over which a turn is summed before it is compared with the noise
# Sigmas of the noise of that sum: below the first a turn is not significant, above the second fully.
SIGNIFICANT = 2.0, 3.0


@dataclass
class Jitter:
    """Mutable; give it each odometry of a robot, in order."""

    #: Turn (radians) and duration (s) of the ticks of the last second in motion.
    _turns: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    # Second differences, rad / sqrt(s).
    _changes: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def significance(self, told: Odometry) -> float:
        """Take an odometry; returned is which share of its turn the scale may be learned from, 0 to 1."""
        if told.dt <= 0 or not (told.distance or told.turn or told.aside):
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
        sigma = sorted(self._changes)[int(QUANTILE * len(self._changes))] / PER_SIGMA
        turn = seconds = 0.0
        for measured, dt in reversed(self._turns):
            turn, seconds = turn + measured, seconds + dt
            if seconds >= SECOND:
                break
        low, high = SIGNIFICANT
        noise = sigma * math.sqrt(seconds)
        return min(1.0, max(0.0, (abs(turn) / noise - low) / (high - low))) if noise > 0 else 1.0
