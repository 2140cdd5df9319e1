"""Whether a new track is of a thing that went out of sight, by place and velocity of both. Pure.

Track segment association: a new track is held against what is expected of each unseen one by now (Yeddanapudi, Bar-Shalom, Pattipati,
Deb, IEEE TAES 31(4), 1995; Zhang and Bar-Shalom, IEEE TAES 47(3), 2011). All new and unseen tracks are assigned together.
"""

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.assignment import posterior
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.rolling import PLACE, VELOCITY, Rolling
from blackboard.opinion.gaussian.tracks import LIKELY, MAX_TRACKS, ROOM, STAYS
from blackboard.opinion.grid import Array

#: How many things of a class, which have not been seen, a new track may be of: the weight of a new name against the old ones.
#: 0.1 and 1 gave fewer right names on six development seeds.
UNKNOWN = 0.3
FAINTEST = 1e-6  # a weight below this counts as 0
#: A hypothesis of where a thing is now: its probability, and the mean (4,) and covariance (4, 4) of place and velocity.
Option = tuple[float, Array, Array]


@dataclass(frozen=True, eq=False)
class Absent:
    """A thing that has a name, as it was seen last: `then` is its place and velocity, mean (4,) and covariance (4, 4).

    `fastest` is the sigma of the velocities of things of its class along an axis (unit / s). `unseen` is in seconds.
    """

    kind: str
    then: Moments
    fastest: float
    observers: frozenset[str]  # who has seen it
    unseen: float = 0.0
    #: Its track ended because its place was no longer known, not because observers looked and saw nothing.
    lost: bool = False

    def passed(self, dt: float) -> "Absent":
        """`dt` seconds later."""
        return replace(self, unseen=self.unseen + dt)

    def now(self, area: float) -> list[Option]:
        """Where it may be, on a map of some area (unit^2), by how often it has turned: never or once.

        Who goes from place to place turns after about half a side of the map, and then goes in any direction (Poisson). Who has turned
        twice may be anywhere, as somebody whom nobody has seen: no name rests on that.
        """
        t = self.unseen
        turns = t * self.fastest * math.sqrt(8.0 / area)
        straight = _step(t, 1.0)
        turned, way = _step(t / 2, 0.0), np.concatenate([self.then.mean[VELOCITY], np.zeros(2)])
        spread = np.kron([[t**2 / 3, t / 2], [t / 2, 1.0]], np.eye(2)) * self.fastest**2
        spread += np.outer(way, way) * t**2 / 12
        options = [
            (1.0, straight @ self.then.mean, straight @ self.then.covariance @ straight.T),
            (turns, turned @ self.then.mean, turned @ self.then.covariance @ turned.T + spread),
        ]
        return [(share * math.exp(-turns), mean, covariance) for share, mean, covariance in options if share]


def _step(way: float, kept: float) -> Array:
    return np.kron([[1.0, way], [0.0, kept]], np.eye(2))


def bounded(absent: Mapping[str, Absent], left_out: Collection[str]) -> dict[str, Absent]:
    """At most `MAX_TRACKS`, the latest seen first; at most `ROOM` that one observer alone has seen, none of one left out."""
    kept, alone = dict[str, Absent](), Counter[frozenset[str]]()
    for name, one in sorted(absent.items(), key=lambda pair: (pair[1].unseen, pair[0])):
        observers = one.observers - frozenset(left_out)
        alone[observers] += 1
        if len(observers) > 1 or (observers and alone[observers] <= ROOM):
            kept[name] = one
    return dict(list(kept.items())[:MAX_TRACKS])


def found_again(
    new: Mapping[str, tuple[str, Rolling, float]], absent: Mapping[str, Absent], area: float
) -> dict[str, str]:
    """New track -> name of the thing out of sight that it is of, with a probability above `LIKELY`.

    `new` has classes, motions and ages (s). What was seen since a track began is something else. `area` is that of the map (unit^2).
    """
    rows, columns = sorted(new), sorted(absent)
    weights = np.zeros((len(rows), len(columns)))
    for column, name in enumerate(columns):
        options = absent[name].now(area)
        for row, block in enumerate(rows):
            kind, rolling, age = new[block]
            if absent[name].kind == kind and absent[name].unseen > age:
                there = math.exp(-absent[name].unseen / STAYS) / UNKNOWN
                weights[row, column] = there * math.exp(min(40.0, likelier(options, rolling, area)))
    weights[weights < FAINTEST] = 0.0
    return {rows[row]: columns[column] for row, column in np.argwhere(posterior(weights) > LIKELY)}


def likelier(options: Sequence[Option], new: Rolling, area: float) -> float:
    """The log-likelihood ratio (nats) of a new track's sightings: a thing with these hypotheses against one anywhere on the map."""
    now = new.moments()
    prior = np.diag([0.0, 0.0, 1.0, 1.0]) / new.fastest**2
    known = np.linalg.inv(now.covariance)
    values, axes = np.linalg.eigh(known - prior)  # what the sightings alone say
    precision = (axes * np.maximum(values, 0.0)) @ axes.T
    centre = np.concatenate([now.mean[PLACE], np.zeros(2)])
    information = known @ (now.mean - centre)
    anywhere = _integral(prior, np.zeros(4), precision, information) - math.log(area)
    anywhere += math.log(2 * math.pi) - 2 * math.log(new.fastest)
    logs = []
    for share, mean, covariance in options:
        inverse, off = np.linalg.inv(covariance), mean - centre
        density = _integral(inverse, inverse @ off, precision, information)
        density -= 0.5 * float(off @ inverse @ off) + 0.5 * float(np.linalg.slogdet(covariance)[1])
        logs.append(math.log(share) + density - anywhere)
    most = max(logs)
    return most + math.log(math.fsum(math.exp(log - most) for log in logs))


def _integral(prior: Array, mean: Array, precision: Array, information: Array) -> float:
    """The logarithm of the integral of the product of two exponentials of quadratic forms, but for (2 pi)^2."""
    both, weighed = prior + precision, mean + information
    return 0.5 * float(weighed @ np.linalg.solve(both, weighed)) - 0.5 * float(np.linalg.slogdet(both)[1])
