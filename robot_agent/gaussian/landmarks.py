"""Which landmark of the map an unnamed sighting is of, by where the robot believes to be. Pure but for what `Naming` learns."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.classes import LANDMARK
from blackboard.opinion.gaussian.assignment import CLEAR
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.naming import Naming
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, Motion
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Readings, Sighting

MOST = 16  # landmarks that a sighting may be of; where there are more, the robot does not know where it is
REACH = 6.0  # sigmas of place, heading and sighting together, beyond which a landmark is not tried
MIN_RANGE = 0.1  # unit: nearer, a blur across the line of sight is told as if it was there
MARGIN = 5.0  # unit around the map, in which what is none of its landmarks may stand
LOST = 5  # ticks in a row, at least, with landmarks beyond the gate, before the robot counts as lost
FEWEST = 8  # sightings in these ticks, at least. Of one landmark `LOST` count: the map may have it at a wrong place
KEPT = 50  # ticks that are kept


@dataclass(frozen=True)
class Named:
    """A tick's readings with names for what is of the map, and what these names leave open."""

    readings: Readings
    #: Landmark -> variances by which it is not known which one it is: along the line of sight (unit^2), across it (radians^2).
    blurs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    strange: int = 0  # sightings that are of none: a robot with many of these is not where it believes


@dataclass
class Misses:
    """Mutable; call `on_tick` for each tick with landmarks. The fewer are in view, the more ticks are judged together."""

    #: What was seen in the last ticks in a row with sightings beyond the gate, and how many of these there were.
    _ticks: list[tuple[Sequence[tuple[str, str]], int]] = field(default_factory=list)

    def on_tick(self, seen: Sequence[tuple[str, str]], missed: int) -> None:
        """Take what was seen in a tick, by name and kind, and how many were beyond the gate."""
        self._ticks = [*self._ticks, (seen, missed)][-KEPT:] if missed else []

    def contradict(self) -> bool:
        """Whether most of the newest sightings were beyond the gate, of several landmarks and for long enough."""
        by_name, missed = Counter[tuple[str, str]](), 0
        for ticks, (seen, beyond) in enumerate(reversed(self._ticks), 1):
            by_name.update(seen)
            missed += beyond
            if ticks >= LOST and sum(min(LOST, number) for number in by_name.values()) >= FEWEST:
                return 2 * missed > by_name.total()
        return False


@dataclass
class Landmarks:
    """Mutable; `named` once per tick. `places` is the map: `landmark/door` -> where it stands (unit); `together` makes a group."""

    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    together: float = 0.6  # unit: as `Camera.together`
    _naming: Naming = field(init=False)

    def __post_init__(self) -> None:
        corners = np.array(list(self.places.values()) or [(0.0, 0.0)])
        self._naming = Naming(float(np.prod(np.ptp(corners, axis=0) + 2 * MARGIN)))

    def named(
        self, readings: Readings, robot: str, joint: Joint, motion: Motion, relative: Callable[[Sighting], Relative]
    ) -> Named:
        """Give the sightings of `landmark/?` the names of landmarks, and leave out those that may well be of none.

        Where it may be one of a group, it stands at their mean, and the spread around it counts as noise (probabilistic data
        association, Bar-Shalom and Tse, Automatica 11(5), 1975). Farther apart they would be taken for one again and again, and that
        error does not average out. `joint` holds the robot as it is expected to be, `motion` is that of the tick.
        """
        unnamed = [sighting for sighting in readings.sightings if sighting.subject == LANDMARK]
        if not unnamed or not self.places:
            return Named(readings)
        pose, by_name, blurs, strange = joint.moments(robot), dict[str, Sighting](), dict[str, tuple[float, float]](), 0
        for age in sorted({sighting.age for sighting in unnamed}):
            told = [
                (sighting, replace(relative(sighting), confidence=sighting.confidence))
                for sighting in unnamed
                if sighting.age == age
            ]
            tried = [(sighting, one, near) for sighting, one in told if len(near := self._near(pose, one)) <= MOST]
            frame, seen = [sighting for sighting, _, _ in tried], [one for _, one, _ in tried]
            candidates = [{name: replace(one, subject=name) for name in near} for _, one, near in tried]
            with_map = joint.copy()
            for name in sorted({name for _, _, near in tried for name in near}):
                with_map.add(name, Moments(np.array(self.places[name]), np.zeros((2, 2))))
            odds = self._naming.judge(with_map, seen, candidates, {robot: motion}, lambda subject: True)
            strange += sum(not its.subjects for its in odds)
            groups = [self._group(its.subjects) for its in odds]
            for number, name in _distinct(groups):
                if name in by_name:
                    continue  # a newer frame has it
                place, spread = self._mean(groups[number])
                along, across = _turned(spread, float(pose.mean[HEADING]) + frame[number].bearing)
                blurs[name] = along, across / max(frame[number].range, MIN_RANGE) ** 2
                by_name[name] = frame[number].model_copy(update={"subject": name, "landmark": place})
        others = [sighting for sighting in readings.sightings if sighting.subject != LANDMARK]
        return Named(readings.model_copy(update={"sightings": [*others, *by_name.values()]}), blurs, strange)

    def _group(self, odds: Mapping[str, float]) -> Mapping[str, float]:
        """The odds of the likeliest landmark and of those that stand by it; none where it may well be elsewhere."""
        if not odds:
            return {}
        likeliest = self.places[max(sorted(odds), key=lambda name: odds[name])]
        group = {name: share for name, share in odds.items() if math.dist(self.places[name], likeliest) < self.together}
        return group if sum(group.values()) >= CLEAR else {}

    def _mean(self, odds: Mapping[str, float]) -> tuple[tuple[float, float], Array]:
        """Where what has these odds stands, and the covariance (2, 2) of that."""
        places, shares = np.array([self.places[name] for name in odds]), np.array(list(odds.values()))
        shares /= shares.sum()
        mean = shares @ places
        apart = places - mean
        return (float(mean[0]), float(mean[1])), (apart.T * shares) @ apart

    def _near(self, pose: Moments, seen: Relative) -> list[str]:
        """The landmarks that a sighting may be of."""
        angle = float(pose.mean[HEADING]) + seen.bearing
        place = pose.mean[AXES] + seen.range * np.array([math.cos(angle), math.sin(angle)])
        across = seen.range**2 * (float(pose.covariance[HEADING, HEADING]) + seen.bearing_variance)
        lasting = sum(bias.sigma**2 for bias in seen.biases)
        variance = float(np.trace(pose.covariance[AXES, AXES])) + across + seen.range_variance + lasting
        reach = REACH * math.sqrt(variance)
        return [name for name, at in self.places.items() if math.dist(place, at) < reach]


def blurred(relative: Relative, along: float, across: float) -> Relative:
    """A sighting whose subject's place has these variances along the line of sight (unit^2) and across it (radians^2)."""
    bare = relative.without_profile()
    return replace(bare, range_variance=bare.range_variance + along, bearing_variance=bare.bearing_variance + across)


def _distinct(odds: Sequence[Mapping[str, float]]) -> list[tuple[int, str]]:
    """A name for each sighting of a frame that has odds, the likeliest first, none twice."""
    pairs = [(-share, number, name) for number, shares in enumerate(odds) for name, share in shares.items()]
    distinct: dict[int, str] = {}
    for _, number, name in sorted(pairs):
        if number not in distinct and name not in distinct.values():
            distinct[number] = name
    return sorted(distinct.items())


def _turned(covariance: Array, angle: float) -> tuple[float, float]:
    """The variances of a covariance (2, 2) along a direction (radians) and across it."""
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    return float(along @ covariance @ along), float(across @ covariance @ across)
