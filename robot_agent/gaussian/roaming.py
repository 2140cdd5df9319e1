"""The speed of a robot without odometry, estimated from its fixes: a drone, a boat, a person with a GPS. Pure.

Who tells no motion is taken to stand, as a camera on a mast does. Fixes that lie apart by more than they may err show that it does
not. From then on it may have gone in any direction at the speed that they show, until for `SPAN` they show none. In the first
`APART` seconds it has the largest speed that agrees with its fixes, and keeps its heading, because a mast tells that only once.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.distrust import LASTING, any_way
from blackboard.opinion.gaussian.vehicle import Motion
from blackboard.wire.messages import Fix

APART = 3.0  # seconds between two fixes that are compared: in less a slow robot hardly goes farther than a GPS errs
SPAN = 20.0  # seconds of fixes that count
MOST = 1000  # fixes
UNSHOWN = 100.0  # unit / s: the largest speed that is assumed before fixes show one; boards refuse evidence with larger variances


@dataclass
class Roaming:
    """Mutable; `on_fix` with each fix."""

    speed: float = 0.0  # unit / s; 0: as far as fixes tell, it stands
    _shown: float = -math.inf  # team time (s) at which fixes showed a speed last
    _fixes: deque[tuple[float, Fix]] = field(default_factory=lambda: deque(maxlen=MOST))

    def on_fix(self, time: float, fix: Fix) -> None:
        """Take a fix at a team time (s). What two of them are apart beyond their noise is a way."""
        self._fixes.append((time, fix))
        while self._fixes[0][0] < time - SPAN:
            self._fixes.popleft()
        pairs = list(self._pairs())
        noise = [one.sigma**2 + other.sigma**2 for _, one, other in pairs]
        away = [math.dist(one.position, other.position) ** 2 for _, one, other in pairs]
        squared = sum(far / variance for far, variance in zip(away, noise, strict=True))
        if pairs and squared > quantile(GATE, 2 * len(pairs)):
            gone = max(0.0, sum(away) - 2 * sum(noise))
            self.speed, self._shown = math.sqrt(gone / sum(seconds**2 for seconds, _, _ in pairs)), time
        elif not pairs:
            self.speed = self._not_excluded()
        elif time - self._shown > SPAN:
            self.speed = 0.0

    def _not_excluded(self) -> float:
        """The largest speed (unit / s) that the noise of the first and the newest fix allows; 0 where both are one place."""
        (since, first), (now, last) = self._fixes[0], self._fixes[-1]
        if first.position == last.position:
            return 0.0
        hidden = quantile(GATE, 2) * (first.sigma**2 + last.sigma**2)
        away = math.sqrt(max(hidden, math.dist(first.position, last.position) ** 2))
        return min(UNSHOWN, away / max(LASTING, now - since))

    def _pairs(self) -> Iterator[tuple[float, Fix, Fix]]:
        """Fixes that follow each other after at least `APART`, the newest first, and the seconds between."""
        later, last = self._fixes[-1]
        for earlier, fix in reversed(self._fixes):
            if later - earlier >= APART:
                yield later - earlier, fix, last
                later, last = earlier, fix

    def motion(self, seconds: float) -> Motion:
        """The process noise of some seconds: any direction at the estimated speed."""
        if not self.speed or seconds <= 0:
            return Motion()
        way, turn = any_way(np.array([self.speed, 0.0]), seconds)
        return Motion(dt=seconds, along=way, across=way, heading=turn if self._shown > -math.inf else 0.0)
