"""Whether a robot keeps seeing its mates elsewhere than the team has them: then it learns from what it sees, and they do not.

The innovations of sightings are white where all models hold (Mehra, IEEE TAC 15, 1970). A lie keeps its side, and so does an
observer that is led astray by its odometry. So an observer's innovations are added up as evidence about one offset of all that
it sees. Where that is certain, its sightings correct its own place alone, as measurements with parameters that are considered
and not estimated (Schmidt 1966). So a robot that is lost is still led back, and one that lies moves itself.

Who sees each mate to another side has no offset of all. So the same is added up for an offset of each mate.

Of two robots that see nobody else, it is not known whose odometry or sightings are wrong. So where what one sees of the other has an
offset, it moves neither for `MEMORY` seconds, and what they have moved each other is taken back. The same holds for one mate that a
robot sees aside while its other mates fit.

A robot that has moved itself to where its lies fit sees nothing to the side any more. So an offset is held against it for `MEMORY`
seconds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

import numpy as np
import numpy.typing as npt

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Factor, Innovation, Joint, pairs_of, squared_distance
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

MEMORY = 5.0  # seconds after which a sighting counts for 1/e
FAR = quantile(GATE, 2)
#: Squared distance that one of 100 000 honest pairs exceeds. The limit is high, because each pair is judged in each tick, and a false
#: alarm takes back what two honest robots have learned from each other.
APART = 2.0 * math.log(1e5)
LEAST = 0.01  # share of the newest sighting of a pair that is still held for or against it
ROUNDED = 1e-6  # share of the information that may be due to rounding


@dataclass(frozen=True, eq=False)
class OffsetScore:
    """The gradient of the log likelihood by an offset, shape (2,), and its covariance if there is no offset, shape (2, 2)."""

    gradient: Array
    covariance: Array
    share: float = 1.0  # of its newest sighting that is left

    def plus(self, other: OffsetScore, sign: float = 1.0) -> OffsetScore:
        """Both together; or, with the sign -1, without the other."""
        return OffsetScore(self.gradient + sign * other.gradient, self.covariance + sign * other.covariance)

    def faded(self, keep: float) -> OffsetScore:
        """The score once only the share `keep` of it counts."""
        return OffsetScore(self.gradient * keep, self.covariance * keep**2, self.share * keep)

    @cached_property
    def offset(self) -> Array:
        """The most likely offset (unit), shape (2,); 0 along directions in which nothing was measured."""
        return np.asarray(np.linalg.pinv(self.covariance, rcond=ROUNDED, hermitian=True) @ self.gradient)

    def is_far(self, limit: float = FAR) -> bool:
        """Whether its squared distance from no offset is beyond a limit [default: that of 99.9 %]."""
        return squared_distance(self.gradient, _rounded(self.covariance)) > limit


NONE = OffsetScore(np.zeros(2), np.zeros((2, 2)))


@dataclass(frozen=True, eq=False)
class MateScores:
    """The same for k subjects with an offset each: gradient, shape (2 k,), and covariance, shape (2 k, 2 k)."""

    subjects: tuple[str, ...]
    gradient: Array
    covariance: Array

    def plus(self, other: MateScores) -> MateScores:
        """Both together."""
        subjects = tuple(dict.fromkeys((*self.subjects, *other.subjects)))
        gradient, covariance = np.zeros(2 * len(subjects)), np.zeros((2 * len(subjects),) * 2)
        for score in (self, other):
            at = pairs_of(subjects, score.subjects)
            gradient[at] += score.gradient
            covariance[np.ix_(at, at)] += score.covariance
        return MateScores(subjects, gradient, covariance)

    def without(self, subject: str) -> MateScores:
        """The scores of the other subjects, whatever the offset of one subject is."""
        if subject not in self.subjects:
            return self
        others = tuple(other for other in self.subjects if other != subject)
        at, rest = pairs_of(self.subjects, [subject]), pairs_of(self.subjects, others)
        by = np.linalg.solve(_rounded(self.covariance[np.ix_(at, at)]), self.covariance[np.ix_(at, rest)])
        covariance = self.covariance[np.ix_(rest, rest)] - self.covariance[np.ix_(rest, at)] @ by
        return MateScores(others, self.gradient[rest] - self.gradient[at] @ by, covariance)

    def faded(self, keep: float) -> MateScores:
        """The scores once only the share `keep` of them counts."""
        return MateScores(self.subjects, self.gradient * keep, self.covariance * keep**2)

    def is_far(self) -> bool:
        """Whether they are beyond 99.9 % of those without offsets."""
        return squared_distance(self.gradient, _rounded(self.covariance)) > quantile(GATE, len(self.gradient))


NO_MATES = MateScores((), np.zeros(0), np.zeros((0, 0)))


@dataclass
class Offsets(Copyable):
    """Mutable; `pass_time` once per tick, `on_sightings` once per observer."""

    _all: dict[str, OffsetScore] = field(default_factory=dict)  # observer -> of all that it sees
    # observer and subject -> what rests on that one alone
    _pairs: dict[tuple[str, str], OffsetScore] = field(default_factory=dict)
    _mates: dict[str, MateScores] = field(default_factory=dict)  # observer -> of each that it sees
    _held: dict[str, float] = field(default_factory=dict)  # observer -> for how many seconds more it is doubted
    _aimed: float = 0.0  # for how many seconds more the team counts as one that measures directions
    #: Observer and subject -> what rests on that pair alone since it was held to be apart.
    _taken: dict[tuple[str, str], OffsetScore] = field(default_factory=dict)
    #: Observer and subject -> for how many seconds more what the one sees of the other moves neither.
    _apart: dict[tuple[str, str], float] = field(default_factory=dict)

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        keep = math.exp(-dt / MEMORY)
        self._all = {observer: score.faded(keep) for observer, score in self._all.items() if score.share * keep > LEAST}
        self._pairs, self._taken = (
            {pair: score.faded(keep) for pair, score in scores.items() if score.share * keep > LEAST}
            for scores in (self._pairs, self._taken)
        )
        self._mates = {
            one: self._young(one, scores.faded(keep)) for one, scores in self._mates.items() if one in self._all
        }
        self._held = {observer: left - dt for observer, left in self._held.items() if left > dt}
        self._apart = {pair: left - dt for pair, left in self._apart.items() if left > dt}
        self._aimed = max(0.0, self._aimed - dt)

    def _young(self, observer: str, scores: MateScores) -> MateScores:
        """An observer's scores without those of mates that it has not seen for long."""
        gone = [subject for subject in scores.subjects if (observer, subject) not in self._pairs]
        return reduce(MateScores.without, gone, scores)

    def on_sightings(
        self, observer: str, joint: Joint, seen: Sequence[tuple[str, Factor]], *, aims: bool = True
    ) -> None:
        """Take all that an observer sees in a tick, by subject, before any of it is taken into the joint.

        `aims`: it measured directions, not ranges alone.

        What of a score rests on some rows i of a tick alone is A_i^T ((S^-1)_ii)^-1 A_i, where A = S^-1 H. Without it the score is
        that of the rest, whatever errors all rows share.
        """
        if not seen:
            return
        innovation = joint.innovation(*(factor for _, factor in seen))
        lengths = [len(factor.residual) for _, factor in seen]
        residual = _within_gate(innovation, lengths)
        ways = np.vstack([factor.jacobians[subject][:, AXES] for subject, factor in seen])
        both = np.column_stack([ways, residual])
        inverse = np.linalg.inv(innovation.covariance)
        weighed = inverse @ both
        self._all[observer] = self._all.get(observer, NONE).plus(_score(ways.T @ weighed))
        subjects = np.repeat([subject for subject, _ in seen], lengths)
        for subject in dict.fromkeys(subject for subject, _ in seen):
            mine = np.flatnonzero(subjects == subject)
            part = weighed[mine]
            alone = _score(part[:, :2].T @ np.linalg.solve(inverse[np.ix_(mine, mine)], part))
            self._pairs[observer, subject] = self._pairs.get((observer, subject), NONE).plus(alone)
            self._part(observer, subject, alone)
        each = _of_each(subjects, ways, inverse, residual)
        self._mates[observer] = self._mates.get(observer, NO_MATES).plus(each)
        if aims:
            self._aimed = MEMORY
        if self._has_offset(observer):
            self._held[observer] = MEMORY

    def _part(self, observer: str, subject: str, score: OffsetScore) -> None:
        """Add the score of a sighting to that of its pair.

        While the pair is apart, nothing is added: its sightings are not taken, so that their innovations are not white.
        """
        pair = observer, subject
        if pair in self._apart:
            return
        self._taken[pair] = self._taken.get(pair, NONE).plus(score)
        if self._taken[pair].is_far(APART):
            self._apart[pair] = MEMORY
            del self._taken[pair]

    def _has_offset(self, observer: str) -> bool:
        """Whether what it sees has offsets beyond 99.9 % of honest ones, whichever one of its subjects is left out."""
        whole = self._all[observer]
        # a bearing says nothing along its line of sight, and rounding is no evidence
        whole = replace(whole, covariance=_rounded(whole.covariance))
        scores = [score for (one, _), score in self._pairs.items() if one == observer]
        if len(scores) < 2:
            return False
        mates = self._mates[observer]
        return all(whole.plus(score, -1.0).is_far() for score in scores) or all(
            mates.without(subject).is_far() for subject in mates.subjects
        )

    def doubts(self, observer: str) -> bool:
        """Whether what it sees had such an offset in the last `MEMORY` seconds."""
        return observer in self._held

    @property
    def aims(self) -> bool:
        """Whether any robot measured directions in the last `MEMORY` seconds. Beside ranges, odometry alone shows a heading."""
        return self._aimed > 0.0

    @property
    def apart(self) -> Collection[tuple[str, str]]:
        """Observers, each with a mate: what the one saw of the other had an offset in the last `MEMORY` seconds."""
        return self._apart.keys()

    def forget_scores(self) -> None:
        """What robots see was held against a belief that is not held any more. Who is doubted for it stays so."""
        self._all, self._pairs, self._mates, self._taken = {}, {}, {}, {}

    def forget(self, robot: str) -> None:
        """Drop what concerns a robot."""
        for (observer, subject), score in self._pairs.items():
            if subject == robot and observer in self._all:
                self._all[observer] = replace(self._all[observer].plus(score, -1.0), share=self._all[observer].share)
        self._all.pop(robot, None)
        self._mates.pop(robot, None)
        self._mates = {observer: scores.without(robot) for observer, scores in self._mates.items()}
        self._pairs, self._taken = (
            {pair: score for pair, score in scores.items() if robot not in pair}
            for scores in (self._pairs, self._taken)
        )
        self._apart = {pair: left for pair, left in self._apart.items() if robot not in pair}
        self._held.pop(robot, None)


def _within_gate(innovation: Innovation, lengths: Sequence[int]) -> Array:
    """The residuals of a tick, in which sightings have these numbers of rows, each shortened to the edge of the gate.

    A single misread then does not look like a lasting offset (Huber 1964). A robot that keeps one side still does.
    """
    residual, begin = innovation.residual.copy(), 0
    for length in lengths:
        rows = slice(begin, begin := begin + length)
        squared = squared_distance(residual[rows], innovation.covariance[rows, rows])
        residual[rows] *= math.sqrt(min(1.0, quantile(GATE, length) / max(squared, 1e-12)))
    return residual


def _score(both: Array) -> OffsetScore:
    """From the covariance, and the gradient beside it: shape (2, 3)."""
    return OffsetScore(both[:, 2], both[:, :2])


def _rounded(covariance: Array) -> Array:
    """A covariance of a score with what may be due to rounding."""
    least = max(ROUNDED * float(np.trace(covariance)), float(np.finfo(float).tiny))
    return np.asarray(covariance + least * np.eye(len(covariance)))


def _of_each(subjects: npt.NDArray[np.str_], ways: Array, inverse: Array, residual: Array) -> MateScores:
    """Scores from residuals, shape (m,), of some subjects, (m,), that these move by `ways`, (m, 2), and their inverse covariance."""
    names = tuple(dict.fromkeys(subjects.tolist()))
    each = np.hstack([ways * (subjects == name)[:, np.newaxis] for name in names])
    weighed = inverse @ each
    return MateScores(names, weighed.T @ residual, each.T @ weighed)
