"""From comparisons of sources to variance factors, correlations and weights; `learning` says what they mean. Pure."""

import math
import statistics
from collections import deque
from dataclasses import dataclass

import numpy as np

from blackboard.opinion.believed import Pair
from blackboard.opinion.chi_squared import MEDIAN, quantile
from blackboard.opinion.cooperative import CAUTIOUS
from blackboard.opinion.grid import Array

PRIOR_COUNT = 6.0  # effective samples that the default is worth
RIDGE = 0.15  # added to the correlations' diagonal: weights (1 + RIDGE) (R + RIDGE I)^-1 1
LEAST_COUNT = 4.0  # effective samples of a pair below which it is not looked at
NOISE = 1.0 / math.log(2)  # sqrt n times the standard deviation of median(a) / ln 2, a being exponentially distributed
DISAGREE = 3.0  # m, relative to what is usual in the team, from which two sources are held to disagree
LEAST_WEIGHT = 1e-3  # of an opinion that adds nothing to the others
MOST_USUAL = 6.0  # the largest m that is held to be usual: all claim sigmas that are 2.4 times too small
ECHO = 0.95  # correlation from which a source is named an echo: one that claims thrice its sigma looks like .89
ECHO_COUNT = 10.0  # effective samples that this takes


@dataclass(frozen=True)
class Comparison:
    """One comparison of a pair: its squared distance a, and what is needed to read it.

    `a` is rounded to 4 bytes and the others to 2, as on the wire, so that boards hand samples on to the bit.
    """

    a: float
    alike: float  # 2 s_i s_j / (s_i^2 + s_j^2): 1 where both are equally sharp
    turned: float  # cosine between this difference and the one before on the same subject; NaN where there is none


@dataclass(frozen=True)
class Pairing:
    """What the window of a pair says: m, the mean of `Comparison.alike`, that of `Comparison.turned` (NaN: unknown), the samples."""

    m: float
    alike: float
    turned: float
    samples: int


@dataclass(frozen=True, eq=False)
class SourceEstimate:
    """Of `names`: variance factors (S,), correlations `raw` (S, S), NaN where unknown, their mean over the pairs that agree."""

    names: list[str]
    count: Array  # effective samples of each pair, (S, S)
    variance: Array
    raw: Array
    echoes: Array  # whether two are as good as the same
    mean: float
    mean_count: float  # effective samples of it
    spread: float  # variance of the true correlations between pairs


# --- one comparison ----------------------------------------------------------------------------------------------------


def compared(difference: Array, covariance: Array, spreads: tuple[float, float], before: Array | None) -> Comparison:
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
    return Comparison(
        float(np.float32(a)), float(np.float16(2.0 * math.sqrt(s * t) / (s + t))), float(np.float16(turned))
    )


# --- from samples to variance factors and correlations -------------------------------------------------------------------


def pairing(window: deque[Comparison]) -> Pairing:
    turns = [sample.turned for sample in window if not math.isnan(sample.turned)]
    return Pairing(
        m=statistics.median(sample.a for sample in window) / math.log(2),
        alike=sum(sample.alike for sample in window) / len(window),
        turned=sum(turns) / len(turns) if len(turns) >= LEAST_COUNT else math.nan,
        samples=len(window),
    )


def estimate(names: list[str], pairings: dict[Pair, Pairing]) -> SourceEstimate:
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
        return SourceEstimate(names, count, variance, raw, echoes, 0.0, 0.0, 0.0)
    mean = float(raw[upper].mean())
    error = ((1 - np.clip(raw, 0, 1)) * noise)[upper] ** 2
    spread = max(0.0, float(np.mean((raw[upper] - mean) ** 2 - error)))
    # The mean over the pairs of N sources is worth N - 1 of them: two pairs that share a source have a correlation of 1/4.
    mean_count = float(np.median(count[upper])) * (int(trusted.sum()) - 1)
    return SourceEstimate(names, count, variance, raw, echoes, mean, mean_count, spread)


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
        before, variance = variance, np.where(trusted, 0.5 * (variance + told), 1.0)
        if (variance == before).all():
            break
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


def correlations_of(estimated: SourceEstimate, known: list[int]) -> Array:
    """The correlations of some sources, -1 for one without samples, shape (N, N).

    That of a pair is drawn to the mean of all pairs, the more so the fewer its samples, and the mean to that of the default.
    """
    n = len(known)
    # With this correlation of all pairs the weights are n^(CAUTIOUS - 1), as those of a coalition are by default.
    prior = (1 + RIDGE) * (n ** (1 - CAUTIOUS) - 1) / (n - 1) if n > 1 else 0.0
    mean = (estimated.mean_count * max(0.0, estimated.mean) + PRIOR_COUNT * prior) / (
        estimated.mean_count + PRIOR_COUNT
    )
    matrix = np.full((n, n), mean)
    index = np.array(known, dtype=int)
    there = np.flatnonzero(index >= 0)
    at = np.ix_(index[there], index[there])
    raw, count = estimated.raw[at], np.maximum(estimated.count[at], LEAST_COUNT)
    share = estimated.spread / (estimated.spread + NOISE**2 / count) * count / (count + PRIOR_COUNT)
    matrix[np.ix_(there, there)] += np.where(np.isnan(raw), 0.0, share * (raw - mean))
    matrix = np.clip(matrix, 0.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def weights_of(correlations: Array, widths: Array) -> Array:
    """Exponents of opinions with these correlations (N, N) and widths (N,), from 0 to 1, shape (N,), at least one of them above 0.

    (1 + RIDGE) s (R + RIDGE I)^-1 (1 / s): the shares of the best linear combination of estimates of covariance s_i R_ij s_j, each
    relative to its own information 1 / s_i^2. Who would get less than nothing is left out.
    """
    values, vectors = np.linalg.eigh(correlations)
    repaired = (vectors * (np.maximum(values, 0.0) + RIDGE)) @ vectors.T
    weights, left = np.zeros(len(widths)), np.arange(len(widths))
    while True:
        s = widths[left]
        solved = (1 + RIDGE) * s * np.linalg.solve(repaired[np.ix_(left, left)], 1 / s)
        if solved.min() > 0:
            break
        left = np.delete(left, int(np.argmin(solved)))
    weights[left] = solved
    return np.asarray(np.clip(weights, LEAST_WEIGHT, 1.0))
