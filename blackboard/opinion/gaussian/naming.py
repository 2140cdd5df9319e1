"""Which known subject an unnamed sighting is of, by where the joint expects each.

A detector may show one thing twice in a frame. How often it does is found out for each observer and class (multiple-detection
JPDA: Habtemariam, Tharmarasa, Thayaparan, Mallick, Kirubarajan, IEEE J. Sel. Topics Signal Process. 7(3), 2013, for two at most).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.assignment import CLEAR, MOST, Rate, keep, posterior
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Innovation, Joint
from blackboard.opinion.gaussian.linearising import linearise_all
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.tracks import LIKELY, Tracks
from blackboard.opinion.gaussian.vehicle import Motion
from blackboard.opinion.gaussian.views import Place
from blackboard.opinion.grid import Array

IN_VIEW = 0.5  # that a frame shows a known subject: where it looked is not known
FAINT = 0.001  # odds below this are not told
#: Of the things in a frame, the share that is detected twice: prior.
TWICE = Rate(0.1, 10.0)


@dataclass(frozen=True)
class Odds:
    """What a sighting may be of: `subjects`, with their probabilities, or `again` of one that another sighting of its frame is of."""

    subjects: Mapping[str, float]
    again: float = 0.0

    @property
    def is_new(self) -> bool:
        """Whether it most likely shows something that is no known subject and no track."""
        return sum(self.subjects.values()) + self.again < LIKELY


@dataclass(frozen=True)
class Unnamed:
    """What became of an unnamed sighting: the `mark`-th of those of a robot's tick that ended at a team time (s).

    `odds` are the subjects that it may be of, with their probabilities, by name; the rest is that of something else. None: they were
    not worked out. `taken` is the subject that it was taken for; None where that is not clear.
    """

    source: str
    time: float
    mark: int
    odds: Mapping[str, float] | None = None
    taken: str | None = None

    @property
    def is_strange(self) -> bool:
        """Whether it is clear that it is of no known subject."""
        return self.odds is not None and sum(self.odds.values()) <= 1.0 - CLEAR


class ClassSighting(Protocol):
    """A sighting of which the class is told: by whom, of which, and how sure the detector is that something is there."""

    @property
    def observer(self) -> str: ...

    @property
    def subject(self) -> str: ...

    @property
    def confidence(self) -> float: ...


@dataclass
class Naming(Copyable):
    """Mutable; `judge` once per frame. `area` is that of the team's map (unit^2), over which what is nobody known is spread evenly."""

    area: float = 1000.0
    _strangers: dict[tuple[str, str], Rate] = field(default_factory=dict)  # by observer and class
    #: By observer and class: the share of the things in its frames that it detects twice.
    _twice: dict[tuple[str, str], Rate] = field(default_factory=dict)

    def judge(
        self,
        joint: Joint,
        frame: Sequence[Relative],
        candidates: Sequence[Mapping[str, Relative]],
        motions: Mapping[str, Motion],
        knows: Callable[[str], bool],
        tracks: Tracks | None = None,
        places: Mapping[str, Place] | None = None,
    ) -> list[Odds]:
        """The odds of each sighting of a frame, which are different things.

        `candidates` are of each sighting the subjects that it may be of, with the sighting as one of that subject. Of a subject that
        somebody `knows` not to be anywhere in particular, any place is as likely. Tracks that the observer alone has seen are
        strangers to the others; `places` are where tracks are, as it sees them.
        """
        tracks = tracks or Tracks()
        subjects = sorted({subject for its in candidates for subject in its})
        shown = {subject: _shown(tracks, frame[0].observer, subject, places or {}) for subject in subjects}
        known = {subject for subject in subjects if knows(subject)}
        pairs = [(row, subject) for row, its in enumerate(candidates) for subject in its]
        placed = [(row, subject) for row, subject in pairs if subject in known]
        factors = linearise_all(joint, [candidates[row][subject] for row, subject in placed], motions)
        densities = dict.fromkeys(pairs, 1.0)
        for (row, subject), innovation in zip(placed, joint.innovations(factors), strict=True):
            densities[row, subject] = self._density(innovation, tracks.area(frame[row].observer, frame[row].subject))
        return self.weigh(frame, densities, shown)

    def weigh(
        self, frame: Sequence[ClassSighting], densities: Mapping[tuple[int, str], float], shown: Mapping[str, float]
    ) -> list[Odds]:
        """The odds of each sighting of a frame, which are different things, or one thing twice.

        `densities` are by the sighting's number in the frame and by subject: how much likelier it is of that subject than of
        something anywhere. `shown` are the odds that the frame shows a subject.
        """
        if not frame:
            return []
        subjects = sorted({subject for _, subject in densities})
        likelier, sure = np.zeros((len(frame), len(subjects))), np.array([[seen.confidence] for seen in frame])
        for (row, subject), density in densities.items():
            likelier[row, subjects.index(subject)] = density
        strange = np.array([[self._rate(self._strangers, seen, Rate())] for seen in frame])
        twice = np.array([[self._rate(self._twice, seen, TWICE)] for seen in frame])
        odd = np.array([shown[subject] for subject in subjects])

        def shares(expected: Array) -> Array:
            return posterior(np.minimum(MOST, sure * likelier / (sure * expected + 1.0 - sure) * odd))

        its = shares(strange)
        again = twice * likelier * (its.sum(axis=0) - its)  # of a subject that another sighting is of
        expected = strange + again.sum(axis=1, keepdims=True)
        if (again > FAINT * strange).any():
            its = shares(expected)
        rest = sure * np.maximum(0.0, 1.0 - its.sum(axis=1, keepdims=True))
        second = (rest * again.sum(axis=1, keepdims=True) / expected)[:, 0].tolist()
        self._learn(frame, rest[:, 0].tolist(), second, its.sum(axis=1).tolist())
        return [
            Odds({s: p for s, p in zip(subjects, row, strict=True) if p > FAINT}, twin)
            for row, twin in zip(its.tolist(), second, strict=True)
        ]

    def _learn(
        self, frame: Sequence[ClassSighting], rest: Sequence[float], second: Sequence[float], first: Sequence[float]
    ) -> None:
        """Learn both rates from a frame. Probabilities of each sighting: of no subject (`rest`), of one seen twice, of a subject."""
        for key in dict.fromkeys((seen.observer, seen.subject) for seen in frame):
            rows = [row for row, seen in enumerate(frame) if (seen.observer, seen.subject) == key]
            strangers, twins = (math.fsum(shares[row] for row in rows) for shares in (rest, second))
            keep(self._strangers, key, self._strangers.get(key, Rate()).plus(strangers - twins))
            things = math.fsum(first[row] for row in rows)
            keep(self._twice, key, self._twice.get(key, TWICE).plus(min(things, twins), things))

    def is_second(self, seen: ClassSighting, densities: Iterable[float]) -> bool:
        """Whether two new sightings of a frame are most likely two detections of one thing.

        `densities` are by the other new ones: how much likelier `seen` is of the same thing than of something anywhere.
        """
        second = self._rate(self._twice, seen, TWICE) * math.fsum(densities)
        return second >= LIKELY * (self._rate(self._strangers, seen, Rate()) + second)

    @staticmethod
    def _rate(rates: Mapping[tuple[str, str], Rate], seen: ClassSighting, prior: Rate) -> float:
        return rates.get((seen.observer, seen.subject), prior).rate

    def _density(self, innovation: Innovation, area: float) -> float:
        """How much likelier a sighting is of its subject than at any place that is seen; 0 beyond the gate."""
        if innovation.squared > quantile(GATE, innovation.freedom):
            return 0.0
        anywhere = min(self.area, area) ** -(min(innovation.freedom, 2) / 2) / (
            2 * math.pi if innovation.freedom > 2 else 1.0
        )
        determinant = float(np.linalg.det(2 * math.pi * innovation.covariance))
        return (
            MOST
            if determinant <= 0
            else min(MOST, math.exp(-innovation.squared / 2) / math.sqrt(determinant) / anywhere)
        )


def _shown(tracks: Tracks, observer: str, subject: str, places: Mapping[str, Place]) -> float:
    """The odds that a frame of an observer shows a subject."""
    if subject not in tracks:
        return IN_VIEW / (1.0 - IN_VIEW)
    chance = tracks.expected(observer, subject)
    return chance / (1.0 - chance * tracks.in_view(observer, subject, places[subject]))


def clear(odds: Mapping[str, float] | None) -> str | None:
    """The subject that a sighting clearly is of."""
    return next((subject for subject, share in (odds or {}).items() if share >= CLEAR), None)
