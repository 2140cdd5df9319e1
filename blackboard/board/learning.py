"""How far the sources of a board may be believed, learned from how well they agree, without any truth. Pure.

For two sources i and j whose opinions rest on different evidence, d the difference of their means and S their covariances,
a = d^T (S_i + S_j)^-1 d / 2 is exponentially distributed with mean 1 where both are honest (2-D). So its median over a window says

    m = median(a) / ln 2,  about  (v_i + v_j) / 2 - rho s_i s_j sqrt(v_i v_j) / mean(s_i^2, s_j^2)

with v the *variance factor* of a source (above 1: over-confident) and rho the *correlation* of the errors of the two. m above 1 is
read as over-confidence, m below 1 as correlation: agreement alone cannot tell a source that claims too wide from one that echoes.
Who disagrees with a majority whose members agree is *outside* of it, and its variance factor is measured against the members.

Before any evidence the advice is the rule's default; an estimate counts with the share n / (n + PRIOR_COUNT) of n effective samples.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.believed import MAX_SUBJECTS, PAIR_WINDOW, SPACING, Pair, is_due, silent_longest
from blackboard.opinion.bell import spread
from blackboard.opinion.chi_squared import MEDIAN, quantile
from blackboard.opinion.cooperative import CAUTIOUS
from blackboard.opinion.grid import Array
from blackboard.opinion.provenance import Opinion

PRIOR_COUNT = 6.0  # effective samples that the default is worth
RIDGE = 0.15  # added to the correlations' diagonal: weights (1 + RIDGE) (R + RIDGE I)^-1 1
LEAST_COUNT = 4.0  # effective samples of a pair below which it is not looked at
NOISE = 1.0 / math.log(2)  # sqrt n times the standard deviation of median(a) / ln 2, a being exponentially distributed
DISAGREE = 3.0  # m, relative to what is usual in the team, from which two sources are held to disagree
LEAST_WEIGHT = 1e-3  # of an opinion that adds nothing to the others
LEAST_POWER = 1e-6  # so that what an opinion rules out stays ruled out
MOST_USUAL = 6.0  # the largest m that is held to be usual: all claim sigmas that are 2.4 times too small
ECHO = 0.95  # correlation from which a source is named an echo: one that claims thrice its sigma looks like .89
ECHO_COUNT = 10.0  # effective samples that this takes


@dataclass(frozen=True)
class Sample:
    """One comparison of a pair: its squared distance a, and what is needed to read it.

    `a` is rounded to 4 bytes and the others to 2, as on the wire, so that boards hand samples on to the bit.
    """

    a: float
    alike: float  # 2 s_i s_j / (s_i^2 + s_j^2): 1 where both are equally sharp
    turned: float  # cosine between this difference and the one before on the same subject; NaN where there is none


@dataclass(frozen=True)
class Pairing:
    """What the window of a pair says: m, the mean of `Sample.alike`, the mean of `Sample.turned` (NaN: unknown), the samples."""

    m: float
    alike: float
    turned: float
    samples: int


@dataclass(frozen=True)
class Advice:
    """How to pool some sources: opinion i to the power powers[i], which is at most 1, by a coalition with this independence."""

    independence: float
    powers: Array
    weights: Array  # 0 to 1: the exponent that each opinion gets where all agree, before its variance factor


@dataclass(frozen=True)
class Learned:
    """What was learned of a source: `variance` 1 and `echo` None where nothing speaks against it."""

    source: str
    samples: float  # effective comparisons with another source, the most of any pair
    variance: float  # of its errors, relative to what it claims
    correlation: float  # of its errors with those of the source that it resembles most
    echo: str | None  # that source, where the correlation is significant and at least ECHO
    since: float | None  # team time since which it has been held over-confident or an echo, in seconds


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Of `names`: variance factors (S,), correlations `raw` (S, S), NaN where unknown, their mean over the pairs that agree."""

    names: list[str]
    count: Array  # effective samples of each pair, (S, S)
    variance: Array
    raw: Array
    echoes: Array  # whether two are as good as the same
    mean: float
    mean_count: float  # effective samples of it
    spread: float  # variance of the true correlations between pairs


class Learner:
    """`hear` the opinions of each tick, ask for `advice` on the sources of a fusion. The order of opinions does not matter."""

    def __init__(self) -> None:
        # what it remembers, all of it (`blackboard.board.memory`)
        self.samples: dict[Pair, deque[Sample]] = {}
        self.heard: dict[str, float] = {}  # source -> team time of its newest sample
        self.last: dict[str, tuple[float, dict[str, Array]]] = {}  # subject -> time and means of its newest sample
        self.since: dict[str, float] = {}
        # what follows from it
        self._pairings: dict[Pair, Pairing] = {}  # of the same windows
        self._estimate: _Estimate | None = None  # of the samples as they are; None: to be made
        self._learned: list[Learned] | None = (
            None  # the same estimate as consensus and status show it; None: to be made
        )

    def remember(
        self,
        samples: dict[Pair, deque[Sample]],
        heard: dict[str, float],
        last: dict[str, tuple[float, dict[str, Array]]],
        since: dict[str, float],
    ) -> None:
        """Go on from what a learner remembered, instead of what this one did; from then on both do the same, to the bit."""
        self.samples, self.heard, self.last, self.since = samples, heard, last, since
        self._pairings = {pair: _pairing(window) for pair, window in samples.items()}
        self._estimate = self._learned = None

    def hear(self, subject: str, time: float, opinions: Sequence[Opinion]) -> None:
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
                    sample = _compare(mean_p - mean_q, cov_p + cov_q, (spreads[one], spreads[other]), step)
                    window = self.samples.setdefault((one, other), deque(maxlen=PAIR_WINDOW))
                    window.append(sample)
                    self._pairings[one, other] = _pairing(window)
        self._estimate = self._learned = None
        self._date(time)

    def advice(self, sources: Sequence[str], widths: Sequence[float]) -> Advice:
        """How to pool the opinions of these sources with these widths (`width`); without evidence, as with independence CAUTIOUS."""
        n = len(sources)
        if n < 2:
            return Advice(CAUTIOUS, np.ones(n), np.ones(n))
        found = self._found()
        known = [found.names.index(source) if source in found.names else -1 for source in sources]
        variance = np.array([found.variance[k] if k >= 0 else 1.0 for k in known])
        evidence = found.mean_count / (found.mean_count + PRIOR_COUNT)
        weights = _weights(_correlations(found, known), (np.array(widths) * np.sqrt(variance)) ** evidence)
        # n^(independence - 1) is the largest weight; without evidence it is CAUTIOUS to the last digit
        independence = min(1.0, max(0.0, round(1.0 + math.log(weights.max()) / math.log(n), 12)))
        powers = np.clip(np.round(weights * n ** (1.0 - independence) / variance, 12), LEAST_POWER, 1.0)
        return Advice(independence, powers, weights)

    def learned(self, sources: Sequence[str] | None = None) -> list[Learned]:
        """What was learned of these sources, or of all, sorted; those without a sample are left out."""
        if self._learned is None:
            self._learned = self._told()
        return [it for it in self._learned if sources is None or it.source in sources]

    def _told(self) -> list[Learned]:
        found = self._found()
        if not found.names:
            return []
        correlations = _correlations(found, list(range(len(found.names))))
        np.fill_diagonal(correlations, -math.inf)
        told = []
        for i, name in enumerate(found.names):
            count = found.count[i]
            if count.max() > 0:
                nearest = int(np.argmax(correlations[i]))
                echo = found.names[nearest] if found.echoes[i, nearest] else None
                told.append(
                    Learned(
                        source=name,
                        samples=float(count.max()),
                        variance=float(found.variance[i]),
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
        found = self._found()
        for i, name in enumerate(found.names):
            if found.variance[i] > 1.0 or found.echoes[i].any():
                self.since.setdefault(name, time)
            else:
                self.since.pop(name, None)

    def _found(self) -> _Estimate:
        if self._estimate is None:
            self._estimate = _estimate(sorted(self.heard), self._pairings)
        return self._estimate


# --- one comparison ----------------------------------------------------------------------------------------------------


def _compare(difference: Array, covariance: Array, spreads: tuple[float, float], before: Array | None) -> Sample:
    """A sample of two sources: the difference of their means, the sum of their covariances, and their `spread` (s_i^2, s_j^2)."""
    inverse = np.linalg.inv(covariance)
    n = len(difference)
    squared = float(difference @ inverse @ difference)
    a = 0.5 * squared * quantile(MEDIAN, 2) / quantile(MEDIAN, n)  # as if in two dimensions
    s, t = spreads
    turned = math.nan
    if before is not None:
        lengths = squared * float(before @ inverse @ before)
        turned = float(difference @ inverse @ before) / math.sqrt(lengths) if lengths > 1e-12 else math.nan
    return Sample(float(np.float32(a)), float(np.float16(2.0 * math.sqrt(s * t) / (s + t))), float(np.float16(turned)))


# --- from samples to variance factors and correlations -------------------------------------------------------------------


def _pairing(window: deque[Sample]) -> Pairing:
    turns = [sample.turned for sample in window if not math.isnan(sample.turned)]
    return Pairing(
        m=statistics.median(sample.a for sample in window) / math.log(2),
        alike=sum(sample.alike for sample in window) / len(window),
        turned=sum(turns) / len(turns) if len(turns) >= LEAST_COUNT else math.nan,
        samples=len(window),
    )


def _estimate(names: list[str], pairings: dict[Pair, Pairing]) -> _Estimate:
    size = len(names)
    index = {name: i for i, name in enumerate(names)}
    m, alike, count = np.ones((size, size)), np.ones((size, size)), np.zeros((size, size))
    turned = np.full((size, size), np.nan)
    for (one, other), told in pairings.items():
        i, j = index[one], index[other]
        m[i, j] = m[j, i] = told.m
        alike[i, j] = alike[j, i] = told.alike
        count[i, j] = count[j, i] = told.samples
        turned[i, j] = told.turned
    agree = _trusted(m, m * (1 - NOISE / np.sqrt(np.maximum(count, LEAST_COUNT))), count >= LEAST_COUNT)
    count *= _new_share(turned[np.ix_(agree, agree)])
    known = count >= LEAST_COUNT
    noise = NOISE / np.sqrt(np.maximum(count, LEAST_COUNT))
    trusted = _trusted(m, m * (1 - noise), known)
    variance = _variances(m, m * (1 - noise) > 1.0, count, known, trusted)
    claimed = 0.5 * (variance[:, np.newaxis] + variance)
    raw = np.where(known, np.clip((1.0 - m / claimed) / np.maximum(alike, 0.1), -1.0, 1.0), np.nan)
    echoes = (count >= ECHO_COUNT) & (m / claimed * (1 + 2 * noise) <= 1 - ECHO)
    upper = np.triu(known & trusted & trusted[:, np.newaxis], 1)
    if not upper.any():
        return _Estimate(names, count, variance, raw, echoes, 0.0, 0.0, 0.0)
    mean = float(raw[upper].mean())
    error = ((1 - np.clip(raw, 0, 1)) * noise)[upper] ** 2
    spread = max(0.0, float(np.mean((raw[upper] - mean) ** 2 - error)))
    # The mean over the pairs of N sources is worth N - 1 of them: two pairs that share a source have a correlation of 1/4.
    mean_count = float(np.median(count[upper])) * (int(trusted.sum()) - 1)
    return _Estimate(names, count, variance, raw, echoes, mean, mean_count, spread)


def _new_share(turned: Array) -> float:
    """The share of samples that count as new: (1 - phi^2) / (1 + phi^2), phi the correlation of a difference with the one before.

    turned (S, S): the mean cosine between the two, NaN where unknown, of sources that agree, as a lasting bias would turn nothing. In
    2-D it is pi/4 phi F(1/2, 1/2; 2; phi^2), of which this is the inverse within 0.01.
    """
    cosines = turned[~np.isnan(turned)]
    cosine = max(0.0, float(np.median(cosines))) if len(cosines) else 0.0
    phi = min(0.97, cosine * (4 / math.pi - (4 / math.pi - 1) * cosine**2))
    return float((1 - phi**2) / (1 + phi**2))


def _trusted(m: Array, least: Array, known: Array) -> Array:
    """Who agrees with all others that are trusted, shape (S,): who disagrees with the most is left out first."""
    usual = [float(np.quantile(row[of], 0.5, method="lower")) for row, of in zip(m, known, strict=True) if of.any()]
    limit = DISAGREE * min(MOST_USUAL, max(1.0, float(np.median(usual)))) if usual else math.inf
    against = known & (least > limit)
    trusted = np.ones(len(m), dtype=bool)
    while (against & trusted & trusted[:, np.newaxis]).any():
        among = against & trusted & trusted[:, np.newaxis]
        worst = max(range(len(m)), key=lambda i: (among[i].sum(), (m[i] * among[i]).sum()))
        trusted[worst] = False
    return trusted


def _variances(m: Array, significant: Array, count: Array, known: Array, trusted: Array) -> Array:
    """The variance factors, shape (S,), at least 1, from m = (v_i + v_j) / 2, shrunk towards 1 in their logarithm."""
    variance = np.ones(len(m))
    read = np.where(significant, m, 1.0)
    partner = known & trusted & ~np.eye(len(m), dtype=bool)  # row i: who i is measured against
    for _ in range(30):
        told = np.maximum(1.0, _median_of(2 * read - variance, partner))
        variance = np.where(trusted, 0.5 * (variance + told), 1.0)
    variance = np.where(trusted, variance, np.maximum(1.0, _median_of(2 * m - variance, partner)))
    n = np.maximum(0.0, _median_of(count, partner))
    return np.asarray(variance ** (n / (n + PRIOR_COUNT)))


def _median_of(values: Array, chosen: Array) -> Array:
    """The median of the chosen values of each row (S, S), shape (S,); -inf where a row has none."""
    ordered = np.sort(np.where(chosen, values, math.inf), axis=1)
    n = chosen.sum(axis=1)
    rows = np.arange(len(values))
    low, high = ordered[rows, np.maximum(n - 1, 0) // 2], ordered[rows, np.minimum(n // 2, len(values) - 1)]
    return np.where(n > 0, 0.5 * (low + high), -math.inf)


# --- from estimates to weights --------------------------------------------------------------------------------------------


def _correlations(found: _Estimate, known: list[int]) -> Array:
    """The correlations of some sources, -1 for one without samples, shape (N, N).

    That of a pair is drawn to the mean of all pairs, the more so the fewer its samples, and the mean to that of the default.
    """
    n = len(known)
    # With this correlation of all pairs the weights are n^(CAUTIOUS - 1), as those of a coalition are by default.
    prior = (1 + RIDGE) * (n ** (1 - CAUTIOUS) - 1) / (n - 1) if n > 1 else 0.0
    mean = (found.mean_count * max(0.0, found.mean) + PRIOR_COUNT * prior) / (found.mean_count + PRIOR_COUNT)
    matrix = np.full((n, n), mean)
    index = np.array(known, dtype=int)
    there = np.flatnonzero(index >= 0)
    at = np.ix_(index[there], index[there])
    raw, count = found.raw[at], np.maximum(found.count[at], LEAST_COUNT)
    share = found.spread / (found.spread + NOISE**2 / count) * count / (count + PRIOR_COUNT)
    matrix[np.ix_(there, there)] += np.where(np.isnan(raw), 0.0, share * (raw - mean))
    matrix = np.clip(matrix, 0.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def _weights(correlations: Array, widths: Array) -> Array:
    """Exponents of opinions with these correlations (N, N) and widths (N,), from 0 to 1, shape (N,), at least one of them above 0.

    (1 + RIDGE) s (R + RIDGE I)^-1 (1 / s): the shares of the best linear combination of estimates of covariance s_i R_ij s_j, each
    relative to its own information 1 / s_i^2. Who would get less than nothing is left out.
    """
    values, vectors = np.linalg.eigh(correlations)
    repaired = (vectors * (np.maximum(values, 0.0) + RIDGE)) @ vectors.T
    weights, left = np.zeros(len(widths)), np.arange(len(widths))
    while True:
        s = widths[left]
        found = (1 + RIDGE) * s * np.linalg.solve(repaired[np.ix_(left, left)], 1 / s)
        if found.min() > 0:
            break
        left = np.delete(left, int(np.argmin(found)))
    weights[left] = found
    return np.asarray(np.clip(weights, LEAST_WEIGHT, 1.0))
