"""How far each source's evidence is from what the joint expects, against what it claims: an over-confident source counts for less.

The squared Mahalanobis distance of a piece of evidence is chi-squared where its noise is as claimed. A median well above that of
chi-squared says that the noise is larger: the excess is put down to the source's noise alone, which is a share of what was expected.
A source is never taken for better than it claims, because noise that is alike from one tick to the next looks smaller than it is.
"""

import statistics
from dataclasses import dataclass, field
from functools import lru_cache

from blackboard.opinion.believed import ENOUGH, MOST_NOISE, WINDOW
from blackboard.opinion.chi_squared import MEDIAN, quantile
from blackboard.opinion.gaussian.copying import Copyable

LEAST = 0.1  # of the share: with less, what was seen says more of the belief than of the source
Source = tuple[str, str]  # a robot, and the kind of its evidence


@dataclass
class Innovations(Copyable):
    """Mutable; `judge` once per piece of evidence, before it is scaled or left out."""

    _ratios: dict[Source, tuple[float, ...]] = field(default_factory=dict)

    def judge(self, source: Source, squared: float, freedom: int, share: float = 1.0) -> None:
        """Take the squared distance of a piece of evidence as it was claimed, with its degrees of freedom.

        `share` is that of the source's noise in the variance that was expected, 0 to 1.
        """
        excess = (squared / quantile(MEDIAN, freedom) - 1.0) / max(share, LEAST)
        self._ratios[source] = (*self._ratios.get(source, ()), 1.0 + excess)[-WINDOW:]

    def samples(self, source: Source) -> int:
        """How many pieces of evidence are remembered of a source."""
        return len(self._ratios.get(source, ()))

    def variance(self, source: Source) -> float:
        """The variance of a source's noise relative to what it claims, at least 1; 1 until enough is known."""
        ratios = self._ratios.get(source, ())
        return min(MOST_NOISE, max(1.0, _median(ratios))) if len(ratios) >= ENOUGH else 1.0


@lru_cache(maxsize=256)
def _median(ratios: tuple[float, ...]) -> float:
    """Kept, because it is asked for more often than there is something new."""
    return statistics.median(ratios)
