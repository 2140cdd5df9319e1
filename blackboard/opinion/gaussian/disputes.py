"""Whether two robots keep seeing one object at different places: then what they see of it moves no robot.

The innovations of what each sees of an object are white where all models hold (Mehra, IEEE TAC 15, 1970), and keep one side where the
object moves as no model has it. Both robots see that alike. So what counts is the difference between the offsets of two robots.
A range or a bearing alone tells one direction. Then two robots are compared in the directions that both tell.
Where more robots differ from one than agree with it, what it sees of the object is left out. Of two alone, who sees it where it was
expected, and where a third robot has just seen it, is right. Else nobody can tell which is wrong. Then both count the same, however
sure each says that it is, and the object is between them. While one of them looks alone,
what it sees is left out, for at most `MEMORY` seconds.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Factor, Innovation
from blackboard.opinion.gaussian.offsets import LEAST, MEMORY, NONE, ROUNDED, OffsetScore
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

NEW = math.exp(-2.0 / MEMORY)  # share that is left of what was seen two seconds ago; some robots tick once a second
LATELY = math.exp(-1.0)  # the same after `MEMORY` seconds
MOST = 6.0  # squared distance that a sighting counts with at most: a kick, or a misread, is no dispute
KEPT = 60.0  # seconds for which a robot that moved an object too far, while no other saw it, is not believed alone about that object
DISPUTED = 10.0  # times the variance of what is disputed, so that an object does not follow the one that spoke last


def told_by_both(one: Array, other: Array) -> tuple[Array, int]:
    """The information, shape (2, 2), on the difference of two offsets, and its rank, by the information on each.

    It is the parallel sum (Anderson and Duffin, J. Math. Analysis and Applications 26, 1969): (one^-1 + other^-1)^-1, and of matrices
    that have no inverse its limit.
    """
    both = one @ np.linalg.pinv(one + other, rcond=ROUNDED, hermitian=True) @ other
    least = ROUNDED * min(float(np.trace(one)), float(np.trace(other)))
    return both, int(np.sum(np.linalg.eigvalsh((both + both.T) / 2) > least))


@dataclass(frozen=True, eq=False)
class ObserverRecord:
    """What one observer saw of one object: the score of an offset, and its newest sighting.

    That is a place, shape (2,), which is told in the directions of a projection, shape (2, 2): of a range or a bearing alone in one.
    """

    score: OffsetScore
    place: Array
    variance: float  # unit^2, along both axes together
    directions: Array

    def differs(self, other: ObserverRecord) -> bool:
        """Whether the offsets of both differ by more than 99.9 % of those that are the same."""
        both, freedom = told_by_both(self.score.covariance, other.score.covariance)
        apart = self.score.offset - other.score.offset
        return freedom > 0 and float(apart @ both @ apart) > quantile(GATE, freedom)

    def is_apart(self, other: ObserverRecord) -> bool:
        """Whether both saw it farther apart than 99.9 % of what is at one place."""
        squared, freedom = self.apart(other)
        return freedom > 0 and squared > quantile(GATE, freedom) * 0.5 * (self.variance + other.variance)

    def confirms(self, other: ObserverRecord) -> bool:
        """Whether both saw it at one place, and each by itself."""
        return self.apart(other)[1] == len(self.place) and not self.is_apart(other)

    def apart(self, other: ObserverRecord) -> tuple[float, int]:
        """The squared distance (unit^2) of both places in the directions that both tell, and how many these are."""
        both, freedom = told_by_both(self.directions, other.directions)
        return 2.0 * float((self.place - other.place) @ both @ (self.place - other.place)), freedom


@dataclass
class Disputes(Copyable):
    """Mutable; `pass_time` once per tick, `on_sighting` once per sighting of an object, before it is taken."""

    _views: dict[tuple[str, str], ObserverRecord] = field(default_factory=dict)  # object and observer -> what it saw
    #: Object, and two observers that differ, sorted -> for how many seconds more they do.
    _held: dict[tuple[str, str, str], float] = field(default_factory=dict)
    #: As in `_held` -> the one of both that saw the object where it was expected, and where a third one had just seen it.
    _expected: dict[tuple[str, str, str], str] = field(default_factory=dict)
    #: Observer and object -> seconds for which it is not yet believed alone about that object, unless another observer confirms it.
    _set_back: dict[tuple[str, str], float] = field(default_factory=dict)

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        self._set_back = {of: left - dt for of, left in self._set_back.items() if left > dt}
        keep = math.exp(-dt / MEMORY)
        self._views = {
            of: replace(view, score=view.score.faded(keep))
            for of, view in self._views.items()
            if view.score.share * keep > LEAST
        }
        self._held = {of: left - dt for of, left in self._held.items() if left > dt}
        self._expected = {of: robot for of, robot in self._expected.items() if of in self._held}

    def on_sighting(
        self, observer: str, subject: str, factor: Factor, innovation: Innovation, place: Array, lasting: float
    ) -> None:
        """Take a sighting of an object, by one number or two, which puts that at a place, shape (2,), against what is expected.

        `lasting` is the variance (unit^2) of where the observer is.
        """
        ways = factor.jacobians[subject][:, AXES]
        residual = innovation.residual * math.sqrt(MOST / max(innovation.squared, MOST))
        both = ways.T @ np.linalg.solve(innovation.covariance, np.column_stack([ways, residual]))
        last = self._views.get((subject, observer))
        score = (NONE if last is None else last.score).plus(OffsetScore(both[:, 2], both[:, :2]))
        back = np.linalg.pinv(ways)
        variance = 2.0 / len(ways) * float(np.trace(back @ factor.noise @ back.T)) + lasting
        mine = self._views[subject, observer] = ObserverRecord(score, place, variance, back @ ways)
        for other in self.seeing(subject):
            (one, two), its = sorted((observer, other)), self._views[subject, other]
            if self._set_back and other != observer and mine.confirms(its):
                self._set_back.pop((observer, subject), None)
                self._set_back.pop((other, subject), None)
            is_held = (subject, one, two) in self._held
            if other != observer and (mine.differs(its) or (is_held and mine.is_apart(its))):
                self._held[subject, one, two] = MEMORY
                if not is_held and mine.is_apart(its) and (right := self._confirmed(subject, one, two)):
                    self._expected[subject, one, two] = right

    def _confirmed(self, subject: str, *two: str) -> str | None:
        """The one of two that sees an object nearer to where it is expected, if a third one has just seen it there."""
        right = min(two, key=lambda robot: math.hypot(*self._views[subject, robot].score.offset))
        third = (view for (of, robot), view in self._views.items() if of == subject and robot not in two)
        mine = self._views[subject, right]
        return right if any(view.score.share > LATELY and view.confirms(mine) for view in third) else None

    def favours(self, observer: str, subject: str, against: Collection[str]) -> int:
        """1: an observer saw an object where it was expected, and a third as well; -1: one of those `against` it did; else 0."""
        pairs = ((subject, min(observer, other), max(observer, other)) for other in against)
        right = {self._expected.get(pair) for pair in pairs} - {None}
        return 0 if len(right) != 1 else 1 if observer in right else -1

    def disputed(self) -> set[str]:
        """The objects whose observers see them at different places."""
        return {subject for subject, _, _ in self._held}

    def differing(self, observer: str, subject: str) -> set[str]:
        """Who saw an object elsewhere than an observer in the last `MEMORY` seconds."""
        pairs = [{one, two} for of, one, two in self._held if of == subject and observer in (one, two)]
        return set().union(*pairs) - {observer}

    def newcomers(self, subject: str, sides: Collection[str]) -> set[str]:
        """Who has seen so little of an object that its offset has more than twice the sigma of that of each of some robots."""
        known = {
            robot: float(np.trace(view.score.covariance)) for (of, robot), view in self._views.items() if of == subject
        }
        least = min((known[robot] for robot in sides if robot in known), default=0.0)
        return {robot for robot, information in known.items() if 2.0**2 * information < least}

    def seeing(self, subject: str) -> list[str]:
        """Who has seen an object in the last two seconds."""
        return [observer for (of, observer), view in self._views.items() if of == subject and view.score.share > NEW]

    def noise(self, subject: str) -> float:
        """The variance (unit^2, along x and along y) with which all sightings of a disputed object are taken."""
        now = [self._views[subject, observer] for observer in self.seeing(subject)]
        apart = max(view.apart(other)[0] for view in now for other in now)
        return 0.5 * DISPUTED * (min(view.variance for view in now) + 0.25 * apart)

    def set_back(self, observer: str, subject: str) -> None:
        """An observer moved an object too far while no other saw it."""
        self._set_back[observer, subject] = KEPT

    def is_set_back(self, observer: str, subject: str) -> bool:
        return (observer, subject) in self._set_back

    def led(self) -> set[tuple[str, str]]:
        """Pairs of observer and object: the observer is not believed about the object while no other sees it."""
        return set(self._set_back)

    def forget(self, subject: str) -> None:
        """An object is gone, or begins anew."""
        self._set_back = {of: left for of, left in self._set_back.items() if of[1] != subject}
        self._views = {of: view for of, view in self._views.items() if of[0] != subject}
        self._held = {of: left for of, left in self._held.items() if of[0] != subject}
        self._expected = {of: robot for of, robot in self._expected.items() if of[0] != subject}
