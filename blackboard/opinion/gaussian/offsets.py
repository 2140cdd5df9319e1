"""Whether a robot keeps seeing its mates elsewhere than the team has them: then it learns from what it sees, and they do not.

The innovations of sightings are white where all models hold (Mehra, IEEE TAC 15, 1970). A lie keeps its side, and so does an
observer that is led astray by its odometry. So an observer's innovations are added up as evidence about one offset of all that
it sees. Where that is certain, its sightings correct its own place alone, as measurements with parameters that are considered
and not estimated (Schmidt 1966). So a robot that is lost is still led back, and one that lies moves itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Factor, Joint, squared_distance
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

MEMORY = 5.0  # seconds after which a sighting counts for 1/e
LEAST = 0.01  # share of the newest sighting of a pair that is still held for or against it


@dataclass(frozen=True, eq=False)
class Score:
    """The gradient of the log likelihood by an offset, shape (2,), and its covariance if there is no offset, shape (2, 2)."""

    gradient: Array
    covariance: Array
    share: float = 1.0  # of its newest sighting that is left


@dataclass
class Offsets:
    """Mutable; `pass_time` once per tick, `hear` once per observer."""

    _pairs: dict[tuple[str, str], Score] = field(default_factory=dict)  # observer and subject
    _doubted: dict[str, bool] = field(
        default_factory=dict
    )  # observer -> `doubts`, where it was asked since the last change

    def copy(self) -> Offsets:
        """The same, which may be changed without changing this one."""
        return Offsets(dict(self._pairs))

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass."""
        keep = math.exp(-dt / MEMORY)
        self._pairs = {
            pair: Score(it.gradient * keep, it.covariance * keep**2, it.share * keep)
            for pair, it in self._pairs.items()
            if it.share * keep > LEAST
        }
        self._doubted = {}

    def hear(self, observer: str, joint: Joint, seen: Sequence[tuple[str, Factor]]) -> None:
        """Take all that an observer sees in a tick, by subject, before any of it is taken into the joint."""
        if not seen:
            return
        found, first = joint.innovation(*(factor for _, factor in seen)), 0
        rows = np.vstack([factor.jacobians[subject][:, AXES] for subject, factor in seen])
        white = np.linalg.solve(np.linalg.cholesky(found.covariance), np.column_stack([rows, found.residual]))
        for subject, factor in seen:
            part = white[first : first + len(factor.residual)]
            first += len(part)
            more = part[:, :2].T @ part
            before = self._pairs.get((observer, subject), Score(np.zeros(2), np.zeros((2, 2))))
            self._pairs[observer, subject] = _sum([before, Score(more[:, 2], more[:, :2])])
        self._doubted.pop(observer, None)

    def doubts(self, observer: str) -> bool:
        """Whether what it sees has an offset beyond 99.9 % of honest ones, whichever one of its subjects is left out."""
        if observer not in self._doubted:
            scores = [it for (one, _), it in self._pairs.items() if one == observer]
            self._doubted[observer] = len(scores) > 1 and all(
                _squared(_sum([it for other, it in enumerate(scores) if other != left])) > quantile(GATE, 2)
                for left in range(len(scores))
            )
        return self._doubted[observer]

    def forget(self, robot: str) -> None:
        """Drop what concerns a robot."""
        self._pairs = {pair: it for pair, it in self._pairs.items() if robot not in pair}
        self._doubted = {}


def _sum(scores: Iterable[Score]) -> Score:
    gradient, covariance = np.zeros(2), np.zeros((2, 2))
    for it in scores:
        gradient, covariance = gradient + it.gradient, covariance + it.covariance
    return Score(gradient, covariance)


def _squared(score: Score) -> float:
    return squared_distance(score.gradient, score.covariance)
