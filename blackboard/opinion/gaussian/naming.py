"""Which known subject an unnamed sighting is of, by where the joint expects each."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.assignment import CLEAR, MOST, Rate, keep, posterior
from blackboard.opinion.gaussian.joint import Innovation, Joint
from blackboard.opinion.gaussian.linearising import linearise_all
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.tracks import Tracks
from blackboard.opinion.gaussian.vehicle import Motion
from blackboard.opinion.gaussian.views import Place

IN_VIEW = 0.5  # that a frame shows a known subject: where it looked is not known
FAINT = 0.001  # odds below this are not told


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
class Naming:
    """Mutable; `judge` once per frame. `area` is that of the team's map (unit^2), over which what is nobody known is spread evenly."""

    area: float = 1000.0
    _strangers: dict[tuple[str, str], Rate] = field(default_factory=dict)  # by observer and class

    def copy(self) -> "Naming":
        """The same, which may be changed without changing this one."""
        return Naming(self.area, dict(self._strangers))

    def judge(
        self,
        joint: Joint,
        frame: Sequence[Relative],
        candidates: Sequence[Mapping[str, Relative]],
        motions: Mapping[str, Motion],
        knows: Callable[[str], bool],
        tracks: Tracks | None = None,
        places: Mapping[str, Place] | None = None,
    ) -> list[dict[str, float]]:
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
    ) -> list[dict[str, float]]:
        """The odds of each sighting of a frame, which are different things.

        `densities` are by the sighting's number in the frame and by subject: how much likelier it is of that subject than of
        something anywhere. `shown` are the odds that the frame shows a subject.
        """
        subjects = sorted({subject for _, subject in densities})
        weights = np.zeros((len(frame), len(subjects)))
        for (row, subject), density in densities.items():
            seen = frame[row]
            strange = seen.confidence * self._rate(seen) + 1.0 - seen.confidence
            weight = seen.confidence * density / strange * shown[subject]
            weights[row, subjects.index(subject)] = min(MOST, weight)
        odds: list[dict[str, float]] = []
        strangers: dict[tuple[str, str], float] = {}
        for seen, shares in zip(frame, posterior(weights).tolist(), strict=True):
            odds.append({s: p for s, p in zip(subjects, shares, strict=True) if p > FAINT})
            rest = max(0.0, 1.0 - sum(shares))
            key = seen.observer, seen.subject
            strangers[key] = strangers.get(key, 0.0) + seen.confidence * rest
        for key, seen_so in strangers.items():
            keep(self._strangers, key, self._strangers.get(key, Rate()).plus(seen_so))
        return odds

    def _rate(self, seen: ClassSighting) -> float:
        return self._strangers.get((seen.observer, seen.subject), Rate()).rate

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
