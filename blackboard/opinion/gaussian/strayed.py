"""Robots that slipped or were carried: mates' sightings contradict, tick after tick, where the joint has them.

Without fixes and landmarks such a robot cannot know it. Mates that see it in different ticks form no coalition, which takes the
evidence of one tick (`coalitions.py`). So contradictions are counted over ticks, by mate, until an increment of the robot fits.
One mate alone may lie, or be lost itself. So two must have it in the same place, and be more than those whose sightings fit. Then a
liar can neither choose the place of a robot that another mate has lost, nor speak for a wrong place alone. One mate is enough in a
team of three only, where no other robot can tell.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.grid import Array

#: Ticks in which mates contradict a robot's place, or in a row in which its increments are left out. Then its pose is widened.
PATIENCE = 5
OUTVOTED = 4  # robots in a team, at least, in which one mate alone is not enough
WITNESSES = 2  # so many mates, at least, in so many of these ticks each: one may lie, and a misread is no witness
SAME = 1e-6  # of a way: what rounding may make of it


@dataclass(frozen=True, eq=False)
class Way:
    """Where a robot would have to be moved for a sighting to fit: the least way, shape (2,), and what of a way the sighting measures.

    `measured` has shape (2, 2): the projection onto that, all of a way where a place was seen, and a line where a range or a bearing.
    """

    way: Array
    measured: Array

    @property
    def far(self) -> float:
        return float(np.hypot(*self.way))

    def agrees(self, other: "Way") -> bool:
        """Whether the robot may be in one place by both sightings: nearer to each other than to where it is."""
        return self._allows(other) and other._allows(self)

    def _allows(self, other: "Way") -> bool:
        if np.trace(other.measured) < 2 - SAME:  # along a line one may go as far as one likes
            return True
        its = self.measured @ other.way
        return float(np.hypot(*(its - self.way))) < min(self.far, float(np.hypot(*its)))


def way_of(rows: Array, residual: Array) -> Way:
    """By the derivatives of a sighting by a robot's position, shape (k, 2), and what is left of it, shape (k,)."""
    back = np.linalg.pinv(rows)
    return Way(back @ residual, back @ rows)


@dataclass(frozen=True, eq=False)
class Word:
    """What a mate says of a robot's place: when it contradicted it, since its sightings fitted last, and when that was (ticks)."""

    against: tuple[int, ...] = ()  # the newest ticks, `PATIENCE` at most
    way: Way | None = None  # of the newest
    fitted: int = -1

    @property
    def far(self) -> float:
        return 0.0 if self.way is None else self.way.far

    def agrees(self, other: "Word") -> bool:
        """Whether both contradict where the robot is, and may have it in one place."""
        return self.way is not None and other.way is not None and self.way.agrees(other.way)


def _steady(words: Sequence[Word]) -> int:
    """How many mates say it in more than one tick."""
    return sum(len(word.against) >= WITNESSES for word in words)


@dataclass
class Strayed(Copyable):
    """Mutable; `contradict` and `confirm` in a tick, then `end_tick`."""

    _words: dict[tuple[str, str], Word] = field(default_factory=dict)  # of a robot, by a mate
    #: Of this tick: robot and mate -> the longest way by which their sightings would fit; None: one fits.
    _now: dict[tuple[str, str], Way | None] = field(default_factory=dict)
    _sure: set[str] = field(default_factory=set)  # robots of which an increment fits in this tick
    _tick: int = 0

    def contradict(self, robot: str, mate: str, way: Way) -> None:
        """A sighting of one of these by the other does not fit; it would if the robot were moved so."""
        before = self._now.setdefault((robot, mate), way)
        if before is not None and way.far > before.far:
            self._now[robot, mate] = way

    def confirm(self, robot: str, mate: str) -> None:
        """A sighting of one of these by the other was taken: it fits where the joint has the robot."""
        self._now[robot, mate] = None

    def confirm_itself(self, robot: str) -> None:
        """An increment of a robot was taken: its own sensors have it where the joint has it."""
        self._sure.add(robot)

    def end_tick(self, robots: int, unheard: Collection[str] = ()) -> Mapping[str, float]:
        """Who has strayed, and how far at most (unit), in a team of so many `robots`, some of which are not believed: `unheard`.

        Who is contradicted by most goes first, and has no word about others any more.
        """
        for pair, way in self._now.items():
            word = self._words.get(pair, Word())
            against = (*word.against, self._tick)[-PATIENCE:]
            self._words[pair] = Word(fitted=self._tick) if way is None else replace(word, against=against, way=way)
        self._words = {pair: word for pair, word in self._words.items() if pair[0] not in self._sure}
        contradicted = sorted({robot for (robot, _), way in self._now.items() if way is not None} - self._sure)
        strayed: dict[str, float] = {}
        while True:
            out = {*unheard, *strayed}
            found = {robot: self._contradict(robot, out, robots) for robot in contradicted if robot not in strayed}
            worst = max(found, key=lambda robot: len(found[robot]), default="")
            if not worst or not found[worst]:
                break
            strayed[worst] = max(found[worst])
        for robot in strayed:
            self.forget(robot)
        self._now, self._sure, self._tick = {}, set(), self._tick + 1
        return strayed

    def _contradict(self, robot: str, out: Collection[str], robots: int) -> Sequence[float]:
        """How far mates that have a robot in one place would move it, without who is `out`; nothing where they are not enough."""
        words = [word for (of, mate), word in sorted(self._words.items()) if of == robot and mate not in out]
        against = [word for word in words if word.way is not None]
        alike = max(
            ([word for word in against if word is one or word.agrees(one)] for one in against), key=_steady, default=[]
        )
        ticks = {tick for word in alike for tick in word.against}
        fitting = sum(word.way is None and word.fitted >= min(ticks, default=0) for word in words)
        enough = max(WITNESSES if robots >= OUTVOTED else 1, fitting + 1)
        return [word.far for word in alike] if _steady(alike) >= enough and len(ticks) >= PATIENCE else ()

    def forget(self, robot: str) -> None:
        """Its place is another one from now on, so that what was said of it, and of others by it, is void."""
        self._words = {pair: word for pair, word in self._words.items() if robot not in pair}
