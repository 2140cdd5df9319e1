"""Fixes that move away from where the odometry leads, at a steady speed: a motion that the odometry did not measure. Pure.

Noise of fixes that is larger than claimed looks the same at first. But noise stays as large as it is, and a motion adds up. So an
F-test compares the last fixes, less the odometry, with a straight line. Where a robot was carried, or satellites jumped, one
step fits better than the line.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.grid import Array

SPAN = (3.0, 10.0)  # seconds of fixes: at least, at most
FEWEST, MOST = 5, 1000  # fixes
SIGNIFICANT = 1e-5  # probability that noise alone looks like a line; small, because every fix is another test
SIGMAS = 5.0  # times the claimed sigma of a fix: a shorter way may be an error of a GPS that wanders
STEADY = 3.0  # nats by which a line must be more likely than a step


@dataclass
class Drifting:
    """Mutable; `on_error` with each fix."""

    #: Team time (s) of each fix, and the sum of all errors until then, shape (2,).
    _beyond: deque[tuple[float, Array]] = field(default_factory=lambda: deque(maxlen=MOST))

    def on_error(self, time: float, error: Array) -> None:
        """Take a fix at a team time (s). `error`, shape (2,): from where the odometry leads since the fix before, to this fix."""
        last = self._beyond[-1][1] if self._beyond else np.zeros(2)
        self._beyond.append((time, last + error))
        while self._beyond[0][0] < time - SPAN[1]:
            self._beyond.popleft()

    def forget(self) -> None:
        """The belief was given up."""
        self._beyond.clear()

    def speed(self, sigma: float) -> float:
        """The speed (unit / s) at which fixes with this sigma (unit) move away from the odometry; 0 where they do not surely."""
        times, beyond = np.array([time for time, _ in self._beyond]), np.array([at for _, at in self._beyond])
        number, freedom = len(times), 2 * len(times) - 4
        if number < FEWEST or np.ptp(times) < SPAN[0]:
            return 0.0
        times, beyond = times - times.mean(), beyond - beyond.mean(axis=0)
        spread = float(times @ times)
        slope = times @ beyond / spread
        explained, rest = float(slope @ slope) * spread, float(np.square(beyond - np.outer(times, slope)).sum())
        # of an F statistic of 2 and k degrees of freedom: P(F > x) = (1 + 2 x / k) ** (-k / 2)
        is_significant = explained > rest * (SIGNIFICANT ** (-2 / freedom) - 1)
        is_steady = _rest_of_step(beyond) > rest * math.exp(STEADY / number)
        speed = float(np.hypot(*slope))
        is_far = speed * np.ptp(times) > SIGMAS * sigma
        return speed if is_significant and is_steady and is_far else 0.0


def _rest_of_step(beyond: Array) -> float:
    """The residual sum of squares of the best fitting step, of rows whose mean is 0, shape (n, 2)."""
    sums = np.cumsum(beyond, axis=0)[:-1]
    before = np.arange(1, len(beyond))
    explained = np.square(sums).sum(axis=1) * (1 / before + 1 / (len(beyond) - before))
    return float(np.square(beyond).sum() - explained.max())
