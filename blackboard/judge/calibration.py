"""Whether beliefs are as good as they claim: errors and regions against the truth, over blocks of time. Pure.

Samples that follow each other share their errors, and so do the robots of a team. So hits are counted over blocks of BLOCK seconds
of the whole team. Neighbouring blocks may be correlated (`intervals.autocorrelation`), nothing is assumed about samples within a
block, and nothing is concluded from fewer than FEWEST blocks.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from blackboard.judge.intervals import Estimate, mean_of_blocks, share_of_blocks, student
from blackboard.opinion.belief import Belief
from blackboard.opinion.bell import escort_moments
from blackboard.opinion.grid import Array
from blackboard.opinion.scores import LEVELS, Score

BLOCK = 10.0  # seconds: twice the time between two fixes of a robot in the demo
FEWEST = 3  # blocks
MOST = 360  # blocks, an hour of them; where there would be more, two neighbours become one, which is as independent

#: What regions are called: they hold the truth as often as they claim within their interval, too often, too rarely, ...
CONSISTENT, CAUTIOUS, CONFIDENT, MIXED, SHORT = "consistent", "over-cautious", "over-confident", "mixed", "too short"


def kind(level: int, share: Estimate) -> str:
    """What the share of the regions of a level (percent) that held the truth says: CAUTIOUS, CONFIDENT, or CONSISTENT with it."""
    if share.is_above(level / 100):
        return CAUTIOUS
    return CONFIDENT if share.is_below(level / 100) else CONSISTENT


def word(coverage: Mapping[int, Estimate]) -> str:
    """One word for the regions of all levels: MIXED where some are too wide and others too narrow, SHORT where there are none."""
    kinds = {kind(level, share) for level, share in coverage.items()} - {CONSISTENT}
    if not coverage:
        return SHORT
    return MIXED if len(kinds) > 1 else next(iter(kinds), CONSISTENT)


def claimed_error(belief: Belief) -> float:
    """The mean squared error that a belief claims, unit^2.

    It is twice that of its escort distribution p^2 / sum p^2: a Gaussian's own, and hardly touched by the even floor that robots
    keep below their beliefs. A cell is as wide as it is: cell^2 / 12 more on each axis.
    """
    return float(np.trace(escort_moments(belief)[1]))


@dataclass
class Calibration:
    """Sums over blocks of time: samples, squared errors, those that were claimed, and how far the regions held the truth."""

    _blocks: dict[int, Array] = field(default_factory=dict)
    _width: int = 1  # of a block, in those of BLOCK seconds

    def add(self, time: float, score: Score, claimed: float) -> None:
        """Take a sample at a team time (s): its score of one entry, and the squared error that its belief claims."""
        row = np.array([1.0, score.errors[0] ** 2, claimed, *score.held_first()])
        self._put(math.ceil(time / BLOCK) - 1, row)  # a sample is about the time that led to it
        if len(self._blocks) > MOST:
            self._widen(2 * self._width)

    @staticmethod
    def merged(parts: "Iterable[Calibration]") -> "Calibration":
        """All samples of several, as a new one."""
        calibrations = list(parts)
        whole = Calibration(_width=max((part._width for part in calibrations), default=1))
        for part in calibrations:
            for block, row in part._blocks.items():
                whole._put(block * part._width, row)
        return whole

    def _put(self, place: int, row: Array) -> None:
        """Add to the block in which the block of BLOCK seconds at `place` lies."""
        block = place // self._width
        self._blocks[block] = self._blocks.get(block, 0.0) + row

    def _widen(self, width: int) -> None:
        """Make blocks of so many of BLOCK seconds, a multiple of those that there are."""
        before, places = self._blocks, self._width
        self._blocks, self._width = {}, width
        for block, row in before.items():
            self._put(block * places, row)

    def coverage(self) -> dict[int, Estimate]:
        """Level (percent) -> the share of its regions that held the truth; empty where there are too few blocks."""
        if len(self._blocks) < FEWEST:
            return {}
        rows = np.array([self._blocks[block] for block in sorted(self._blocks)])
        t = student(len(rows) - 1)
        return {level: share_of_blocks(rows[:, 3 + i], rows[:, 0], t) for i, level in enumerate(LEVELS)}

    def rmse(self) -> tuple[float, float]:
        """The root mean squared error, and the one that the beliefs claim; both 0 where there are no samples."""
        total = sum(self._blocks.values(), np.zeros(3 + len(LEVELS)))
        n = max(1.0, float(total[0]))
        return math.sqrt(total[1] / n), math.sqrt(total[2] / n)

    def is_far_above_its_claim(self, factor: float) -> bool:
        """Whether the root mean squared error is beyond doubt more than so many times what the beliefs claim."""
        if len(self._blocks) < FEWEST:
            return False
        rows = np.array(list(self._blocks.values()))
        return mean_of_blocks(rows[:, 1] - factor**2 * rows[:, 2], rows[:, 0]).is_above(0.0)
