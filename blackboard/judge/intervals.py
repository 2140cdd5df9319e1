"""Numbers with their 95 % intervals, over blocks of time or over runs. Pure; the random generator is an argument.

Over blocks: samples that follow each other are alike, so samples are summed in blocks, which are the observations. A share's
interval also knows that neighbouring blocks may share their errors.

Over runs: each run is one observation, and runs are drawn anew (the bootstrap). From MANY runs on the interval is the bootstrap's
own (percentiles), which over fewer runs is too narrow. There it is the bootstrap's standard error times Student's t, and over
fewer than FEWEST runs there is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from blackboard.opinion.grid import Array

Z = 1.959964  # of a normal distribution, two-sided 95 %
#: Of neighbouring blocks: so that (1 + r) / (1 - r) stays finite where all blocks of a run are nearly equal.
MAX_AUTOCORRELATION = 0.9
RESAMPLES = 400  # of the bootstrap
FEWEST = 4  # runs: with fewer there is no interval
MANY = 40  # runs from which on the bootstrap's percentiles are wide enough


@dataclass(frozen=True)
class Estimate:
    """A number and its 95 % interval; None where there are too few observations to give one."""

    value: float
    low: float | None = None
    high: float | None = None

    def is_above(self, limit: float) -> bool:
        """Whether there is an interval, and all of it is above a limit."""
        return self.low is not None and self.low > limit

    def is_below(self, limit: float) -> bool:
        """Whether there is an interval, and all of it is below a limit."""
        return self.high is not None and self.high < limit

    def within(self, least: float, most: float) -> Estimate:
        """The estimate with its interval cut off where its number cannot be."""
        if self.low is None or self.high is None:
            return self
        return Estimate(self.value, max(least, self.low), min(most, self.high))


def shown(estimate: Mapping[str, Any], places: int = 3, sign: str = "", without: str = "") -> str:
    """An estimate in JSON as text: "0.12 [0.08, 0.16]"; `without` stands for the interval where there is none, "-" for no value."""
    value, low, high = (estimate[key] for key in ("value", "low", "high"))
    if value is None:
        return "-"
    form = f"{sign}.{places}f"
    return f"{value:{form}}" + (without if low is None else f" [{low:{form}}, {high:{form}}]")


def student(freedom: int) -> float:
    """Student's t, two-sided 95 %, within 1 % from 3 degrees of freedom on (Abramowitz and Stegun 1964, 26.7.5)."""
    terms = ((Z**3 + Z) / 4, (5 * Z**5 + 16 * Z**3 + 3 * Z) / 96, (3 * Z**7 + 19 * Z**5 + 17 * Z**3 - 15 * Z) / 384)
    return Z + sum(term / float(freedom) ** n for n, term in enumerate(terms, start=1))


def wilson(share: float, n: float, z: float = Z) -> Estimate:
    """Wilson's interval of a share of n independent samples, n > 0 and not necessarily whole (JASA 22, 1927); 95 % by default."""
    middle, spread = share + z**2 / (2 * n), z * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Estimate(share, (middle - spread) / (1 + z**2 / n), (middle + spread) / (1 + z**2 / n)).within(0.0, 1.0)


# --- over blocks -------------------------------------------------------------------------------------------------------


def mean_of_blocks(sums: npt.ArrayLike, samples: npt.ArrayLike) -> Estimate:
    """The mean of samples by their sums and their number in each block, shape (B,), B >= 2, of blocks that are independent.

    Student's interval with the variance of the ratio estimator (Cochran, Sampling Techniques, ch. 2.11). Where all blocks have as
    many samples it is that of the method of batch means (Law, Simulation Modeling and Analysis).
    """
    s, n = np.asarray(sums, dtype=float), np.asarray(samples, dtype=float)
    mean = float(s.sum() / n.sum())
    half = student(len(n) - 1) * math.sqrt(_variance(s - mean * n, n))
    return Estimate(mean, mean - half, mean + half)


def share_of_blocks(hits: npt.ArrayLike, samples: npt.ArrayLike, z: float = Z) -> Estimate:
    """The share of hits among the samples by their numbers in each block in order of time, shape (B,): Wilson's interval."""
    h, n = np.asarray(hits, dtype=float), np.asarray(samples, dtype=float)
    return wilson(float(h.sum() / n.sum()), effective_samples(h, n), z)


def effective_samples(hits: npt.ArrayLike, samples: npt.ArrayLike) -> float:
    """How many independent samples would give the share of hits the variance that it has over blocks.

    `hits` and `samples` are those of each block in order of time, both of shape (B,). With h_b hits among n_b samples, p the
    share of all and d_b = h_b - p n_b, the variance of p is the ratio estimator's times (1 + r) / (1 - r), where r is the
    `autocorrelation` of d (Bayley and Hammersley, J. R. Stat. Soc. Suppl. 8, 1946). The answer is p (1 - p) over it. It is at
    most the number of samples, so that chance in the blocks makes no interval narrower than independence does. Where blocks are
    equal it is at least (B - 1) (1 - r) / (1 + r). B where p is 0 or 1, and 1 where there is one block: no spread can be seen.
    """
    h, n = np.asarray(hits, dtype=float), np.asarray(samples, dtype=float)
    total = float(n.sum())
    share = float(h.sum()) / total
    if len(n) == 1 or share in (0.0, 1.0):
        return float(len(n))
    away = h - share * n
    r = autocorrelation(away)
    variance = _variance(away, n) * (1 + r) / (1 - r)
    return min(total, share * (1 - share) / variance) if variance > 0 else total


def autocorrelation(deviations: npt.ArrayLike) -> float:
    """The autocorrelation at lag 1 of deviations from a mean, shape (B,) in order of time, from 0 to `MAX_AUTOCORRELATION`.

    A negative one counts as 0. The estimate from few blocks is biased downwards (Marriott and Pope, Biometrika 41, 1954). The bias is
    not corrected, because the correction makes the intervals of short runs a fifth wider even where blocks are independent.
    """
    d = np.asarray(deviations, dtype=float)
    squares = float(d @ d)
    return min(MAX_AUTOCORRELATION, max(0.0, float(d[1:] @ d[:-1]) / squares)) if squares > 0 else 0.0


def _variance(deviations: Array, samples: Array) -> float:
    """The ratio estimator's variance: B / (B - 1) sum_b d_b^2 / n^2 (Cochran, ch. 2.11, without the finite correction)."""
    blocks = len(samples)
    return blocks / (blocks - 1) * float(deviations @ deviations) / float(samples.sum()) ** 2


# --- over runs ---------------------------------------------------------------------------------------------------------


def means(rows: Array, rng: np.random.Generator, least: float = -math.inf, most: float = math.inf) -> list[Estimate]:
    """The mean over runs of each column of rows (runs, columns), with its interval, cut off at the least and the most it can be."""
    estimates = over_runs(rows.mean(axis=0), resamples(len(rows), rng) @ rows / len(rows), len(rows))
    return [estimate.within(least, most) for estimate in estimates]


def over_runs(values: Array, drawn: Array, runs: int) -> list[Estimate]:
    """Some numbers, shape (n,), with their intervals by what they are when the runs are drawn anew, shape (RESAMPLES, n)."""
    if runs < FEWEST:
        return [Estimate(float(value)) for value in values]
    if runs >= MANY:
        low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    else:  # the bootstrap's variance is (runs - 1) / runs of the unbiased one
        half = student(runs - 1) * math.sqrt(runs / (runs - 1)) * drawn.std(axis=0)
        low, high = values - half, values + half
    return [Estimate(*(float(v) for v in column)) for column in zip(values, low, high, strict=True)]


def resamples(runs: int, rng: np.random.Generator) -> Array:
    """How often each run was drawn in each resample, shape (RESAMPLES, runs)."""
    return np.asarray(rng.multinomial(runs, np.full(runs, 1 / runs), RESAMPLES).astype(float))
