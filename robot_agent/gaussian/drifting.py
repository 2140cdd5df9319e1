"""Fixes that leave the odometry steadily: it is not noise of the fixes, but a motion that the odometry did not measure. Pure.

Noise of fixes that is larger than claimed looks the same at first. But it stays as large as it is, and a motion adds up: so what the
fixes say beyond the odometry is held against a straight line through the last seconds, by an F-test. Where a robot was carried,
or satellites jumped, one step fits better than the line.
"""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.grid import Array

SPAN = (3.0, 10.0)  # seconds of fixes: at least, at most
FEWEST = 5  # fixes
SIGNIFICANT = 1e-5  # the probability that noise alone looks so: it is asked again with every fix
SIGMAS = 5.0  # of a fix as it claims: a way that is shorter may be an error that wanders, as of satellites
STEADY = 3.0  # nats by which a line must be more likely than a step


@dataclass
class Drifting:
    """Mutable: `on_error` with each fix."""

    #: Team time (s) of each fix, and by how much it and those before it were beyond the odometry between them, shape (2,).
    _beyond: deque[tuple[float, Array]] = field(default_factory=deque)

    def on_error(self, time: float, error: Array) -> None:
        """A fix at a team time (s) is so far, shape (2,), from where the odometry leads from the fix before it."""
        last = self._beyond[-1][1] if self._beyond else np.zeros(2)
        self._beyond.append((time, last + error))
        while self._beyond[0][0] < time - SPAN[1]:
            self._beyond.popleft()

    def forget(self) -> None:
        """The belief was given up."""
        self._beyond.clear()

    def speed(self, sigma: float) -> float:
        """Unit / s, at which fixes with this sigma (unit) leave the odometry; 0 where they do not do it steadily and far."""
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
        is_steady = _beside_a_step(beyond) > rest * math.exp(STEADY / number)
        speed = float(np.hypot(*slope))
        is_far = speed * np.ptp(times) > SIGMAS * sigma
        return speed if is_significant and is_steady and is_far else 0.0


def _beside_a_step(beyond: Array) -> float:
    """The sum of squares that the best step leaves of rows whose mean is 0, shape (n, 2)."""
    sums = np.cumsum(beyond, axis=0)[:-1]
    before = np.arange(1, len(beyond))
    explained = np.square(sums).sum(axis=1) * (1 / before + 1 / (len(beyond) - before))
    return float(np.square(beyond).sum() - explained.max())
