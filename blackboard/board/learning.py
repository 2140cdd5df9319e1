"""How far the sources of a board may be believed, learned from how well they agree, without any truth. Pure.

For two sources i and j whose opinions rest on different evidence, d the difference of their means and S their covariances,
a = d^T (S_i + S_j)^-1 d / 2 is exponentially distributed with mean 1 where both are honest (2-D). So its median over a window gives

    m = median(a) / ln 2,  about  (v_i + v_j) / 2 - rho s_i s_j sqrt(v_i v_j) / mean(s_i^2, s_j^2)

with v the *variance factor* of a source (above 1: over-confident) and rho the *correlation* of the errors of the two. m above 1
is read as over-confidence, m below 1 as correlation. Agreement alone cannot distinguish a source whose claims are too wide from
one that repeats another. Who disagrees with a majority whose members agree is *outside* of it, and its variance factor is
measured against the members.

Before any evidence the advice is the rule's default; an estimate counts with the share n / (n + PRIOR_COUNT) of n effective samples.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blackboard.board.factors import (
    PRIOR_COUNT,
    Comparison,
    Pairing,
    SourceEstimate,
    compared,
    correlations_of,
    estimate,
    pairing,
    weights_of,
)
from blackboard.opinion.believed import MAX_SUBJECTS, PAIR_WINDOW, SPACING, Pair, is_due, silent_longest
from blackboard.opinion.bell import spread
from blackboard.opinion.cooperative import CAUTIOUS
from blackboard.opinion.grid import Array
from blackboard.opinion.provenance import Opinion
from blackboard.wire.messages import Learned

LEAST_POWER = 1e-6  # so that what an opinion rules out stays ruled out


@dataclass(frozen=True)
class Advice:
    """How to pool some sources: opinion i to the power powers[i], which is at most 1, by a coalition with this independence."""

    independence: float
    powers: Array
    weights: Array  # 0 to 1: the exponent that each opinion gets where all agree, before its variance factor


class Learner:
    """`compare_opinions` of each tick, ask for `advice` on the sources of a fusion. The order of opinions does not matter."""

    def __init__(self, level: str) -> None:
        """`level`: "consensus" of robots, "agreed" of sub-teams."""
        self.level = level
        # what it remembers, all of it (`blackboard.board.memory`)
        self.samples: dict[Pair, deque[Comparison]] = {}
        self.heard: dict[str, float] = {}  # source -> team time of its newest sample
        self.last: dict[str, tuple[float, dict[str, Array]]] = {}  # subject -> time and means of its newest sample
        self.since: dict[str, float] = {}
        # what follows from it
        self._pairings: dict[Pair, Pairing] = {}  # of the same windows
        self._estimate: SourceEstimate | None = None  # of the samples as they are; None: to be made
        # The same estimate as consensus and status show it; None: to be made.
        self._learned: list[Learned] | None = None

    def remember(
        self,
        samples: dict[Pair, deque[Comparison]],
        heard: dict[str, float],
        last: dict[str, tuple[float, dict[str, Array]]],
        since: dict[str, float],
    ) -> None:
        """Go on from what a learner remembered, instead of what this one did; from then on both do the same, to the bit."""
        self.samples, self.heard, self.last, self.since = samples, heard, last, since
        self._pairings = {pair: pairing(window) for pair, window in samples.items()}
        self._estimate = self._learned = None

    def compare_opinions(self, subject: str, time: float, opinions: Sequence[Opinion]) -> None:
        """Compare the opinions on a subject at a team time, in seconds, in pairs without a common ancestor.

        Nothing is taken within SPACING of the subject's sample before, nor from an opinion that is as old as that.
        """
        before, means_before = self.last.get(subject, (-math.inf, {}))
        if not is_due(time, before):
            return
        fresh = sorted((o for o in opinions if o.age < SPACING), key=lambda o: (o.source, len(o.ancestors)))
        first = {o.source: o for o in reversed(fresh)}  # of each source the one with the fewest ancestors
        if len(first) < 2:
            return
        seen = {
            source: (opinion, *opinion.bell) for source, opinion in sorted(first.items()) if opinion.bell is not None
        }
        if len(seen) < 2:
            return
        means = {source: mean for source, (_, mean, _) in seen.items()}
        spreads = {source: spread(covariance) for source, (_, _, covariance) in seen.items()}
        self.last.pop(subject, None)
        while len(self.last) >= MAX_SUBJECTS:
            del self.last[min(self.last, key=lambda name: (self.last[name][0], name))]
        self.last[subject] = (time, means)
        self._make_room(list(seen), time)
        sources = [source for source in seen if source in self.heard]
        for i, one in enumerate(sources):
            for other in sources[i + 1 :]:
                (p, mean_p, cov_p), (q, mean_q, cov_q) = seen[one], seen[other]
                if p.ancestors.keys().isdisjoint(q.ancestors):
                    step = means_before[one] - means_before[other] if {one, other} <= means_before.keys() else None
                    sample = compared(mean_p - mean_q, cov_p + cov_q, (spreads[one], spreads[other]), step)
                    window = self.samples.setdefault((one, other), deque(maxlen=PAIR_WINDOW))
                    window.append(sample)
                    self._pairings[one, other] = pairing(window)
        self._estimate = self._learned = None
        self._date(time)

    def advice(self, sources: Sequence[str], widths: Sequence[float]) -> Advice:
        """How to pool the opinions of these sources with these widths (`width`); without evidence, as with independence CAUTIOUS."""
        n = len(sources)
        if n < 2:
            return Advice(CAUTIOUS, np.ones(n), np.ones(n))
        estimated = self._found()
        known = [estimated.names.index(source) if source in estimated.names else -1 for source in sources]
        variance = np.array([estimated.variance[k] if k >= 0 else 1.0 for k in known])
        evidence = estimated.mean_count / (estimated.mean_count + PRIOR_COUNT)
        weights = weights_of(correlations_of(estimated, known), (np.array(widths) * np.sqrt(variance)) ** evidence)
        # n^(independence - 1) is the largest weight; without evidence it is CAUTIOUS to the last digit
        independence = min(1.0, max(0.0, round(1.0 + math.log(weights.max()) / math.log(n), 12)))
        powers = np.clip(np.round(weights * n ** (1.0 - independence) / variance, 12), LEAST_POWER, 1.0)
        return Advice(independence, powers, weights)

    def learned(self, sources: Sequence[str] | None = None) -> list[Learned]:
        """What was learned of these sources, or of all, sorted; those without a sample are left out."""
        if self._learned is None:
            self._learned = self._told()
        return [one for one in self._learned if sources is None or one.source in sources]

    def _told(self) -> list[Learned]:
        estimated = self._found()
        if not estimated.names:
            return []
        correlations = correlations_of(estimated, list(range(len(estimated.names))))
        np.fill_diagonal(correlations, -math.inf)
        told = []
        for i, name in enumerate(estimated.names):
            count = estimated.count[i]
            if count.max() > 0:
                nearest = int(np.argmax(correlations[i]))
                echo = estimated.names[nearest] if estimated.echoes[i, nearest] else None
                told.append(
                    Learned(
                        level=self.level,  # type: ignore[arg-type]
                        source=name,
                        samples=float(count.max()),
                        variance=float(estimated.variance[i]),
                        correlation=float(correlations[i, nearest]),
                        echo=echo,
                        since=self.since.get(name),
                    )
                )
        return told

    # --- what is kept -----------------------------------------------------------------------------------------------------

    def _make_room(self, sources: Sequence[str], time: float) -> None:
        """Note who was heard, and forget who was silent the longest beyond MAX_SOURCES."""
        self.heard |= dict.fromkeys(sources, time)
        for gone in silent_longest(self.heard):
            del self.heard[gone]
            self.since.pop(gone, None)
            for pair in [pair for pair in self.samples if gone in pair]:
                del self.samples[pair], self._pairings[pair]
        for _, means in self.last.values():
            for gone in means.keys() - self.heard.keys():
                del means[gone]

    def _date(self, time: float) -> None:
        """Since when a source has been held over-confident or an echo."""
        estimated = self._found()
        for i, name in enumerate(estimated.names):
            if estimated.variance[i] > 1.0 or estimated.echoes[i].any():
                self.since.setdefault(name, time)
            else:
                self.since.pop(name, None)

    def _found(self) -> SourceEstimate:
        if self._estimate is None:
            self._estimate = estimate(sorted(self.heard), self._pairings)
        return self._estimate
