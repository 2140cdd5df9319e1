"""Whether what a robot sees has the fresh noise that it claims: a sighting without it tells nothing new.

Fresh noise makes the innovations of one pair differ from tick to tick by at least twice its variance. Those of a liar that sees others
where the team has them, or always as far beside, hardly differ: it would make the team sure of what the team said itself. So do errors
that last longer than their observer says. How small the differences are is summed up by Fisher's method (Statistical Methods for
Research Workers, 1932): of n independent ones -2 ln p, each p its lower tail, is chi-squared with 2 n degrees of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, wilson_hilferty
from blackboard.opinion.gaussian.joint import Factor, squared_distance
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

OF_PAIR, OF_OBSERVER = 9, 20  # differences that count, the newest ones: of a pair, and of all that an observer sees
CAUTIOUS = (
    2.0  # times by which a claim may exceed the noise that there is: it is honest to guess too much of a new sensor
)
RAREST = 0.01  # the least p that a difference counts with: three and more say it, not one
DECLARED = 0.1  # the share of the fresh variance from which on a declared lasting error accounts for small differences
HELD = 5.0  # seconds for which it is held against a pair, or an observer
KEPT = 60.0  # seconds without a sighting after which a pair is forgotten


@dataclass(frozen=True)
class Record:
    """Of a pair, or an observer: -2 ln p of its newest differences, and for how many seconds more they are held against it."""

    newest: tuple[float, ...] = ()
    held: float = 0.0

    def plus(self, small: float, most: int) -> Record:
        """With one more difference; the newest count, as many as `most`."""
        newest = (*self.newest, small)[-most:]
        too_small = sum(newest) > wilson_hilferty(GATE, 2 * len(newest))
        return Record(newest, HELD if too_small else self.held)

    def after(self, dt: float) -> Record:
        """`dt` seconds later."""
        return replace(self, held=max(0.0, self.held - dt)) if self.held else self


@dataclass(frozen=True, eq=False)
class Trail:
    """The newest innovation of a pair and its fresh noise, in world axes; one number each where only a range or a bearing was seen."""

    residual: Array
    noise: Array
    record: Record = field(default_factory=Record)
    age: float = 0.0


@dataclass
class Freshness:
    """Mutable; `pass_time` once per tick, `hear` once per sighting, before any of the tick's is taken."""

    _trails: dict[tuple[str, str, str], Trail] = field(default_factory=dict)  # observer, subject and kind of sighting
    _observers: dict[str, Record] = field(default_factory=dict)

    def copy(self) -> Freshness:
        """The same, which may be changed without changing this one."""
        return Freshness(dict(self._trails), dict(self._observers))

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._trails = {
            of: replace(trail, record=trail.record.after(dt), age=trail.age + dt)
            for of, trail in self._trails.items()
            if trail.age + dt <= KEPT
        }
        heard = {observer for observer, _, _ in self._trails}
        self._observers = {
            observer: trail.after(dt) for observer, trail in self._observers.items() if observer in heard
        }

    def hear(self, sighting: Relative, factor: Factor) -> None:
        """Take a sighting against what the joint expects. One that declares lasting errors counts so already."""
        residual, noise = factor.residual[AXES], factor.noise[AXES, AXES]
        if sum(bias.sigma**2 for bias in sighting.biases) > DECLARED * np.trace(noise):
            return
        if sighting.places:
            turned = factor.jacobians[sighting.subject][AXES, AXES].T
            residual, noise = turned @ residual, turned @ noise @ turned.T
        observer, of = sighting.observer, (sighting.observer, sighting.subject, sighting.kind)
        before, record = self._trails.get(of), Record()
        if before is not None:
            squared = CAUTIOUS**2 * squared_distance(residual - before.residual, noise + before.noise)
            tail = -math.expm1(-squared / 2) if sighting.places else math.erf(math.sqrt(squared / 2))
            small = -2 * math.log(max(RAREST, tail))
            record = before.record.plus(small, OF_PAIR)
            self._observers[observer] = self._observers.get(observer, Record()).plus(small, OF_OBSERVER)
        self._trails[of] = Trail(residual, noise, record)

    def doubts(self, robot: str) -> bool:
        """Whether a pair of it, or all that it sees, lately differed less than 99.9 % of what has fresh noise."""
        of_all = self._observers.get(robot, Record())
        return of_all.held > 0 or any(
            trail.record.held > 0 for (one, _, _), trail in self._trails.items() if one == robot
        )
