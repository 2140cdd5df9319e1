"""What an observer has in view: how far it sees things of a class, and which share of those there are. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from blackboard.opinion.gaussian.assignment import FRAMES, Rate

#: Share of what is there and not hidden that a frame shows, at least and at most. What was mixed up with other things counts as
#: not shown; a detector that is taken for a bad one for that would mix them up for ever.
SELDOM, DETECTED = 0.5, 0.99
NARROWEST = 0.25  # rad to each side: no camera of a robot sees less
UNKNOWN = Rate(1.0, 2.0)  # of what is there a frame shows a half, before anything was seen
BEYOND = 20  # one sighting in so many lies beyond the edge of a view, because bearings and ranges are noisy
SIGHTINGS = 1000  # that the edge of a view rests on; then all of them count half, so that a view may change
EARLY = 0.9  # of the usual time between two frames: what comes sooner is no frame
TINY = 1e-9  # unit, and rad: more than no sigma at all
Place = tuple[float, float, float]  # relative to an observer: distance (unit), bearing (rad), sigma of the place (unit)


@dataclass(frozen=True)
class Edge:
    """How far (unit or rad) a view reaches: the 95 % quantile of noisy sightings, because one in `BEYOND` lies beyond the edge."""

    beyond: tuple[float, ...] = ()  # the largest values, sorted: the edge, and what lies beyond it
    sightings: int = 0

    @property
    def at(self) -> float:
        """Where it is; 0 while nothing was seen."""
        return self.beyond[0] if self.beyond else 0.0

    def plus(self, value: float) -> Edge:
        """After one more sighting, that far away."""
        if self.sightings >= SIGHTINGS:
            return Edge(self.beyond[::2], self.sightings // 2).plus(value)
        room = 1 + self.sightings // BEYOND
        return Edge(tuple(sorted((*self.beyond, value))[-room:]), self.sightings + 1)


@dataclass(frozen=True)
class View:
    """How far (unit), and how far to the side (rad), an observer sees things of a class; and which share of those there are.

    A camera may be slower than its robot's ticks. So frames come as often (1 / s) as two followed each other that showed such things.
    """

    reach: Edge = field(default_factory=Edge)
    side: Edge = field(default_factory=Edge)
    often: Edge = field(default_factory=Edge)
    detected: Rate = UNKNOWN
    shown_at: float = -math.inf  # team time (s) of the newest frame that showed one
    looked_at: float = -math.inf  # the same of the newest frame

    @property
    def farthest(self) -> float:
        """How far it reaches (unit)."""
        return self.reach.at

    @property
    def widest(self) -> float:
        """How far it reaches to each side (rad)."""
        return self.side.at

    @property
    def area(self) -> float:
        """How large it is (unit^2), and larger while little was seen."""
        known = max(NARROWEST, self.widest) * self.farthest**2
        return known * (1.0 + FRAMES / self.reach.sightings) if known else math.inf

    @property
    def detects(self) -> float:
        """The share of what is there and visible that a frame shows."""
        return min(DETECTED, max(SELDOM, self.detected.rate))

    def shown(self, time: float) -> View:
        """After a frame that shows such a thing, of a tick that ended at a team time (s)."""
        since = time - self.shown_at
        often = self.often.plus(1.0 / since) if 0.0 < since < math.inf else self.often
        return replace(self, often=often, shown_at=time, looked_at=time)

    def looks(self, time: float) -> bool:
        """Whether a tick that ended at a team time (s) and shows no such thing has a frame all the same."""
        return (time - self.looked_at) * self.often.at >= EARLY or not self.often.at

    def holds(self, place: Place) -> bool:
        """Whether it would show a thing there, all that is unsure of its place considered."""
        distance, bearing, sigma = place
        return distance + sigma < self.farthest and abs(bearing) + sigma / max(distance, sigma) < self.widest

    def share(self, place: Place) -> float:
        """How likely a thing there is in it: as if distance and bearing were independent, and normal."""
        distance, bearing, sigma = place
        if not self.farthest:
            return 0.0
        within = _normal((self.farthest - distance) / max(sigma, TINY))
        off = sigma / max(distance, sigma, TINY)
        aside = _normal((self.widest - bearing) / max(off, TINY)) - _normal((-self.widest - bearing) / max(off, TINY))
        return within * aside


def _normal(sigmas: float) -> float:
    """The share of a normal distribution that is below so many sigmas."""
    return 0.5 * math.erfc(-sigmas / math.sqrt(2.0))
