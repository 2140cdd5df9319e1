"""Intervals of a share among samples that are not independent: over blocks of samples, of which neighbours may share their errors."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Z = 1.959964  # of a normal distribution, two-sided 95 %
MAX_AUTOCORRELATION = (
    0.9  # of neighbouring blocks: so that (1 + r) / (1 - r) stays finite where all blocks of a run are nearly equal
)


def student(freedom: int) -> float:
    """Student's t, two-sided 95 %, within 1 % from 3 degrees of freedom on (Abramowitz and Stegun 1964, 26.7.5)."""
    terms = (
        (Z**3 + Z) / 4,
        (5 * Z**5 + 16 * Z**3 + 3 * Z) / 96,
        (3 * Z**7 + 19 * Z**5 + 17 * Z**3 - 15 * Z) / 384,
    )
    return Z + sum(term / float(freedom) ** n for n, term in enumerate(terms, start=1))


def wilson(share: float, n: float, z: float = Z) -> tuple[float, float]:
    """Wilson's interval of a share among n independent samples, n > 0 and not necessarily whole (JASA 22, 1927); 95 % by default."""
    middle, spread = share + z**2 / (2 * n), z * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return max(0.0, (middle - spread) / (1 + z**2 / n)), min(1.0, (middle + spread) / (1 + z**2 / n))


def autocorrelation(deviations: npt.ArrayLike) -> float:
    """The autocorrelation at lag 1 of deviations from a mean, shape (B,) in order of time, from 0 to `MAX_AUTOCORRELATION`.

    A negative one counts as 0. The estimate from few blocks is biased downwards (Marriott and Pope, Biometrika 41, 1954). The bias is
    not corrected, because the correction makes the intervals of short runs a fifth wider even where blocks are independent.
    """
    d = np.asarray(deviations, dtype=float)
    squares = float(d @ d)
    return min(MAX_AUTOCORRELATION, max(0.0, float(d[1:] @ d[:-1]) / squares)) if squares > 0 else 0.0


def effective_samples(hits: npt.ArrayLike, samples: npt.ArrayLike) -> float:
    """How many independent samples would give the share of hits the variance that it has over blocks.

    `hits` and `samples` are those of each block in order of time, both of shape (B,). With h_b hits among n_b samples, p the share of
    all and d_b = h_b - p n_b, the variance of p is the ratio estimator's, B / (B - 1) sum_b d_b^2 / n^2 (Cochran, Sampling Techniques,
    ch. 2.11, without the finite correction), times (1 + r) / (1 - r), where r is the `autocorrelation` of d (Bayley and Hammersley,
    J. R. Stat. Soc. Suppl. 8, 1946). The answer is p (1 - p) over it: at most the number of samples, so that luck in the blocks makes
    no interval narrower than independence does; at least (B - 1) (1 - r) / (1 + r) where blocks are equal. B where p is 0 or 1, and 1
    where there is one block: no spread can be seen.
    """
    h, n = np.asarray(hits, dtype=float), np.asarray(samples, dtype=float)
    blocks, total = len(n), float(n.sum())
    share = float(h.sum()) / total
    if blocks == 1 or share in (0.0, 1.0):
        return float(blocks)
    away = h - share * n
    r = autocorrelation(away)
    variance = blocks / (blocks - 1) * float(away @ away) / total**2 * (1 + r) / (1 - r)
    return min(total, share * (1 - share) / variance) if variance > 0 else total
