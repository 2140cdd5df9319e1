"""Whether what a robot sees has the fresh noise that it claims: a sighting without it tells nothing new.

Fresh noise makes the innovations of one pair differ from tick to tick by at least twice its variance. Those of a liar that sees others
where the team has them, or always as far beside, hardly differ: it would make the team sure of what the team said itself. So do errors
that last longer than their observer says. How small the differences are is summed up by Fisher's method (Statistical Methods for
Research Workers, 1932): of n independent ones -2 ln p, each p its lower tail, is chi-squared with 2 n degrees of freedom.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, wilson_hilferty
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Factor, squared_distance
from blackboard.opinion.gaussian.relation import QUARTER, Relative
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

OF_PAIR, OF_OBSERVER = 9, 20  # differences that count, the newest ones: of a pair, and of all that an observer sees
#: Times by which a claim may exceed the noise that there is: it is honest to guess too much of a new sensor.
CAUTIOUS = 2.0
RAREST = 0.01  # the least p that a difference counts with: three and more say it, not one
DECLARED = 0.1  # the share of the fresh variance from which on a declared lasting error accounts for small differences
HELD = 5.0  # seconds for which an observer is doubted, after its differences were too small
KEPT = 60.0  # seconds without a sighting after which a pair is forgotten


@dataclass(frozen=True, eq=False)
class Trail:
    """The newest innovation of a pair and its fresh noise, in world axes; one number each where only a range or a bearing was seen."""

    residual: Array
    noise: Array
    newest: tuple[float, ...] = ()  # -2 ln p of its newest differences
    age: float = 0.0


@dataclass
class Freshness(Copyable):
    """Mutable; `pass_time` once per tick, `on_sighting` once per sighting, before any of the tick's is taken."""

    _trails: dict[tuple[str, str, str], Trail] = field(default_factory=dict)  # observer, subject and kind of sighting
    #: Observer -> -2 ln p of the newest differences of all its pairs.
    _observers: dict[str, tuple[float, ...]] = field(default_factory=dict)
    _held: dict[str, float] = field(default_factory=dict)  # observer -> for how many seconds more it is doubted

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._trails = {
            of: replace(trail, age=trail.age + dt) for of, trail in self._trails.items() if trail.age + dt <= KEPT
        }
        heard = {observer for observer, _, _ in self._trails}
        self._observers = {observer: newest for observer, newest in self._observers.items() if observer in heard}
        self._held = {observer: held - dt for observer, held in self._held.items() if held > dt}

    def on_sighting(self, sighting: Relative, factor: Factor) -> None:
        """Compare a sighting with what the joint expects. If it declares lasting errors of its range, only its bearing is judged."""
        residual, noise = factor.residual[AXES], factor.noise[AXES, AXES]
        observer, kind, is_plane = sighting.observer, str(sighting.kind), sighting.places
        if sum(bias.sigma**2 for bias in sighting.biases) > DECLARED * np.trace(noise):
            if not is_plane:
                return
            along = sum((factor.jacobians[block][AXES, 0] for block in sighting.blocks()), np.zeros(2))
            across = (QUARTER @ along / np.hypot(*along))[np.newaxis]
            residual, noise = across @ residual, across @ noise @ across.T
            kind, is_plane = "across", False
        elif is_plane:
            turned = factor.jacobians[sighting.subject][AXES, AXES].T
            residual, noise = turned @ residual, turned @ noise @ turned.T
        of = observer, sighting.subject, kind
        before, newest = self._trails.get(of), tuple[float, ...]()
        if before is not None:
            squared = CAUTIOUS**2 * squared_distance(residual - before.residual, noise + before.noise)
            tail = -math.expm1(-squared / 2) if is_plane else math.erf(math.sqrt(squared / 2))
            small = -2 * math.log(max(RAREST, tail))
            newest = (*before.newest, small)[-OF_PAIR:]
            of_all = self._observers[observer] = (*self._observers.get(observer, ()), small)[-OF_OBSERVER:]
            if _are_too_small(newest) or _are_too_small(of_all):
                self._held[observer] = HELD
        self._trails[of] = Trail(residual, noise, newest)

    def doubts(self, robot: str) -> bool:
        """Whether a pair of it, or all that it sees, lately differed less than 99.9 % of what has fresh noise."""
        return robot in self._held


def _are_too_small(newest: tuple[float, ...]) -> bool:
    """Whether differences with these -2 ln p are smaller together than 99.9 % of such sums (Fisher's method)."""
    return sum(newest) > wilson_hilferty(GATE, 2 * len(newest))
