"""Robots that slipped or were carried: mates' sightings contradict, tick after tick, where the joint has them.

Without fixes and landmarks such a robot cannot know it. Mates that see it in different ticks form no coalition, which takes the
evidence of one tick (`coalitions.py`). So contradictions are counted over ticks, by mate, until an increment of the robot fits
that would not fit where the mate has it: a compass, or a fix that is too vague, says nothing of that.
One mate alone may lie, or be lost itself. So two must see the robot in the same place, and be more than the mates whose sightings fit
where the joint has it. Then one liar can neither move a robot alone, nor keep it where two honest mates do not see it. In a team of
three one mate is enough: nobody else sees the robot. A mate that contradicts several robots is probably wrong itself: no witness.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Innovation, squared_distance
from blackboard.opinion.grid import Array

#: Ticks in which mates contradict a robot's place, or in a row in which its increments are left out. Then its pose is widened.
PATIENCE = 5
OUTVOTED = 4  # robots in a team, at least, in which one mate alone is not enough
WITNESSES = 2  # mates, at least: one may lie
STEADY = 2  # of these ticks, at least, in which such a mate contradicts: one may be a misread
ROUNDING = 1e-6  # of the trace of a projection


@dataclass(frozen=True, eq=False)
class Displacement:
    """By how much a robot would have to be moved for a sighting to fit: the shortest such vector (unit, world axes), shape (2,).

    `measured`, shape (2, 2), is the projection onto the directions that the sighting measures: both where it has range and bearing,
    else one.
    """

    vector: Array
    measured: Array

    @property
    def length(self) -> float:
        """Unit."""
        return float(np.hypot(*self.vector))

    def agrees(self, other: "Displacement") -> bool:
        """Whether both sightings may have the robot in one place: their places are nearer to each other than to where it is."""
        return self._allows(other) and other._allows(self)

    def _allows(self, other: "Displacement") -> bool:
        if (
            np.trace(other.measured) < 2 - ROUNDING
        ):  # one direction is not measured, and there the robot may be anywhere
            return True
        its = self.measured @ other.vector
        return float(np.hypot(*(its - self.vector))) < min(self.length, float(np.hypot(*its)))


def displacement_of(rows: Array, residual: Array) -> Displacement:
    """By the derivatives of a sighting by a robot's position, shape (k, 2), and what is left of it, shape (k,)."""
    back = np.linalg.pinv(rows)
    return Displacement(back @ residual, back @ rows)


@dataclass(frozen=True, eq=False)
class TakenIncrement:
    """The innovation of an increment that was taken; `rows` are its derivatives by the robot's place, shape (k, 2)."""

    innovation: Innovation
    rows: Array

    def excludes(self, displacement: Displacement) -> bool:
        """Whether it would not fit if the robot were moved so."""
        residual = self.innovation.residual - self.rows @ displacement.vector
        return squared_distance(residual, self.innovation.covariance) > quantile(GATE, len(residual))


@dataclass(frozen=True, eq=False)
class Witness:
    """What the sightings between a mate and a robot say of where the joint has the robot."""

    against: tuple[
        int, ...
    ] = ()  # the newest ticks, at most `PATIENCE`, in which they contradicted it since they fitted last
    displacement: Displacement | None = None  # in the newest of these
    fitted: int = -1  # the newest tick in which they fitted

    @property
    def length(self) -> float:
        """Of the displacement (unit); 0 where there is none."""
        return 0.0 if self.displacement is None else self.displacement.length

    def agrees(self, other: "Witness") -> bool:
        """Whether both contradict where the robot is, and may have it in one place."""
        mine, its = self.displacement, other.displacement
        return mine is not None and its is not None and mine.agrees(its)


def _steady(witnesses: Sequence[Witness]) -> int:
    """How many contradict it in more than one tick."""
    return sum(len(witness.against) >= STEADY for witness in witnesses)


@dataclass
class Strayed(Copyable):
    """Mutable; `contradict` and `confirm` in a tick, then `end_tick`."""

    _witnesses: dict[tuple[str, str], Witness] = field(default_factory=dict)  # by robot and mate
    #: Of this tick: robot and mate -> the longest displacement by which one of their sightings would fit; None: one fits as it is.
    _now: dict[tuple[str, str], Displacement | None] = field(default_factory=dict)
    _fits: dict[str, TakenIncrement] = field(default_factory=dict)  # by robot, of which an increment fits in this tick
    _tick: int = 0

    def contradict(self, robot: str, mate: str, displacement: Displacement) -> None:
        """A sighting of one of these by the other does not fit; it would if the robot were moved so far."""
        before = self._now.setdefault((robot, mate), displacement)
        if before is not None and displacement.length > before.length:
            self._now[robot, mate] = displacement

    def confirm(self, robot: str, mate: str) -> None:
        """A sighting of one of these by the other was taken: it fits where the joint has the robot."""
        self._now[robot, mate] = None

    def confirm_itself(self, robot: str, fit: TakenIncrement) -> None:
        """An increment of a robot was taken: its own sensors may have it where the joint has it."""
        self._fits[robot] = fit

    def end_tick(self, robots: int, unheard: Collection[str] = ()) -> Mapping[str, float]:
        """Who has strayed, and how far at most (unit), in a team of so many `robots`. Sightings of those `unheard` do not count.

        Who is contradicted by most is the first, and its sightings of others do not count from then on.
        """
        for pair, displacement in self._now.items():
            if displacement is None:
                self._witnesses[pair] = Witness(fitted=self._tick)
                continue
            before = self._witnesses.get(pair, Witness())
            against = (*before.against, self._tick)[-PATIENCE:]
            self._witnesses[pair] = replace(before, against=against, displacement=displacement)
        self._witnesses = {pair: its for pair, its in self._witnesses.items() if not self._is_refuted(pair[0], its)}
        contradicted = sorted({robot for (robot, _), by in self._now.items() if by is not None})
        strayed: dict[str, float] = {}
        while True:
            out = {*unheard, *strayed}
            found = {robot: self._lengths(robot, out, robots) for robot in contradicted if robot not in strayed}
            worst = max(found, key=lambda robot: len(found[robot]), default="")
            if not worst or not found[worst]:
                break
            strayed[worst] = max(found[worst])
        for robot in strayed:
            self.forget(robot)
        self._now, self._fits, self._tick = {}, {}, self._tick + 1
        return strayed

    def _is_refuted(self, robot: str, witness: Witness) -> bool:
        """Whether an increment of a robot fits, which would not where a mate has it."""
        fit = self._fits.get(robot)
        return fit is not None and witness.displacement is not None and fit.excludes(witness.displacement)

    def _lengths(self, robot: str, out: Collection[str], robots: int) -> Sequence[float]:
        """How far (unit) each mate that has a robot in the same place would move it, without who is `out`; empty: too few do."""
        mates = [
            witness
            for (of, mate), witness in sorted(self._witnesses.items())
            if of == robot and mate not in out and not self._is_suspect(mate)
        ]
        against = [witness for witness in mates if witness.displacement is not None]
        alike = max(
            ([other for other in against if other is one or other.agrees(one)] for one in against),
            key=_steady,
            default=[],
        )
        ticks = {tick for witness in alike for tick in witness.against}
        fitting = sum(mate.displacement is None and mate.fitted >= min(ticks, default=0) for mate in mates)
        enough = max(WITNESSES if robots >= OUTVOTED else 1, fitting + 1)
        return [witness.length for witness in alike] if _steady(alike) >= enough and len(ticks) >= PATIENCE else ()

    def _is_suspect(self, mate: str) -> bool:
        """Whether a mate contradicts several robots, and more than it confirms: then it is probably wrong itself."""
        against = [witness.displacement is not None for (_, by), witness in self._witnesses.items() if by == mate]
        return sum(against) >= WITNESSES and 2 * sum(against) > len(against)

    def forget(self, robot: str) -> None:
        """Drop all that was counted about a robot and by it: it was about a place where the joint no longer has the robot."""
        self._witnesses = {pair: witness for pair, witness in self._witnesses.items() if robot not in pair}
