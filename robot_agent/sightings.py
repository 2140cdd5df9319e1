"""What the sightings in a robot's evidence tell boards that keep a joint, so that the best can be sent on a poor link. Pure.

A sighting says where its subject is relative to the robot that took it. How well the joint knows that already is more than the
two places tell, because it keeps what they share. So it is computed from the sightings that were sent. Each leaves an
uncertainty along and across the line of sight. It grows with time, and is at most that of both places.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import AXES, HEADING
from blackboard.opinion.grid import Grid
from blackboard.wire.evidence import PackedEvidence, PackedRelative

LEAST = 1e-12  # of a variance
MOST = 256  # subjects that are remembered; the one not spoken of for longest is forgotten


@dataclass(frozen=True)
class Reckoned:
    """What is reckoned to be known of a subject's place relative to a robot, after a sighting at a team time (s)."""

    time: float
    along: float  # variance along the line of sight, unit^2
    across: float


@dataclass
class Sightings:
    """Mutable; `news` once per tick, and then `said` with the evidence that was sent."""

    #: Subject -> what was sent of it; the newest is last in order.
    sent: dict[str, Reckoned] = field(default_factory=dict)
    # What will be known if the sightings of this tick are sent.
    _after: dict[str, Reckoned] = field(default_factory=dict)

    def news(
        self, evidence: PackedEvidence, time: float, mine: Moments | None, entropies: Mapping[str, float], grid: Grid
    ) -> dict[str, float]:
        """Nats that each sighting adds to what the boards' joint knows of the relative place, by subject.

        `mine` is the robot's whole block in that joint, `entropies` (nats) those of the places that the joint knows.
        """
        news, self._after = {}, {}
        for relative in evidence.relatives:
            along, across = self._known(relative, evidence, time, mine, entropies.get(relative.subject), grid)
            lasting = sum(sigma**2 for sigma, _ in relative.biases)
            fresh = fresh_error(relative, evidence)
            # An error that lasts is in each sighting of a subject, so that nothing reduces it.
            gains = (max(0.0, along - lasting) / (fresh[0] + lasting), across / fresh[1])
            news[relative.subject] = 0.5 * sum(math.log1p(gain) for gain in gains)
            if is_class(relative.subject):
                continue
            self._after[relative.subject] = Reckoned(
                time, max(along / (1 + gains[0]), min(along, lasting)), across / (1 + gains[1])
            )
        return news

    def said(self, evidence: PackedEvidence) -> None:
        """The evidence of the newest tick was sent, with these sightings."""
        for relative in evidence.relatives:
            if relative.subject in self._after:
                self.sent.pop(relative.subject, None)
                self.sent[relative.subject] = self._after[relative.subject]
        while len(self.sent) > MOST:
            del self.sent[next(iter(self.sent))]

    def _known(
        self,
        relative: PackedRelative,
        evidence: PackedEvidence,
        time: float,
        mine: Moments | None,
        entropy: float | None,
        grid: Grid,
    ) -> tuple[float, float]:
        """Variances of the relative place along and across the line of sight, unit^2, as the boards know it now."""
        widest = (grid.cell * max(grid.shape)) ** 2
        if mine is None or entropy is None:
            return widest, widest
        there = grid.cell**2 * math.exp(entropy) / (2 * math.pi * math.e)  # of a Gaussian with that entropy
        here = float(np.trace(mine.covariance[AXES, AXES])) / 2
        turned = float(mine.covariance[HEADING, HEADING]) * relative.range**2
        along, across = min(widest, here + there), min(widest, here + there + turned)
        last, way = self.sent.get(relative.subject), evidence.travelled
        if last is None:
            return along, across
        # The sums of odometry are of the whole epoch: the time since that sighting has its share of their variance.
        span = max(0.0, time - last.time) / max(way.time, 1.0)
        grown = (way.along + way.across) * span  # variance of both robots' odometry, taken for equal
        return min(along, last.along + grown), min(across, last.across + grown + way.heading * span * relative.range**2)


def fresh_error(relative: PackedRelative, evidence: PackedEvidence) -> tuple[float, float]:
    """Variances of a sighting's fresh error along and across the line of sight, unit^2."""
    if evidence.profile:
        distances, variances = np.array(evidence.profile).T
        variance = max(LEAST, float(np.interp(relative.range, distances, variances)))
        return variance, variance
    return max(LEAST, relative.range_variance), max(LEAST, relative.bearing_variance * relative.range**2)
