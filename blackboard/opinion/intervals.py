"""Intervals of a share among samples that are not independent: over blocks of samples, of which neighbours may share their errors."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Z = 1.959964  # of a normal distribution, two-sided 95 %
MOST_ALIKE = 0.9  # correlation of neighbouring blocks: what is more alike cannot be told from a share that changes


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


def likeness(away: npt.ArrayLike) -> float:
    """The correlation of neighbours in a series of deviations from its mean, shape (B,), from 0 to `MOST_ALIKE`.

    A negative one counts as 0. From few of them it is found too small (Marriott and Pope, Biometrika 41, 1954), which is left
    so: where nothing is alike, adding that would make the intervals of short runs a fifth wider.
    """
    d = np.asarray(away, dtype=float)
    squares = float(d @ d)
    return min(MOST_ALIKE, max(0.0, float(d[1:] @ d[:-1]) / squares)) if squares > 0 else 0.0


def effective_samples(hits: npt.ArrayLike, samples: npt.ArrayLike) -> float:
    """How many independent samples would give the share of hits the variance that it has over blocks.

    `hits` and `samples` are those of each block in order of time, both of shape (B,). With h_b hits among n_b samples, p the share of
    all and d_b = h_b - p n_b, the variance of p is the ratio estimator's, B / (B - 1) sum_b d_b^2 / n^2 (Cochran, Sampling Techniques,
    ch. 2.11, without the finite correction), times (1 + r) / (1 - r) where neighbouring blocks have the correlation r = `likeness`
    of d (Bayley and Hammersley, J. R. Stat. Soc. Suppl. 8, 1946). The answer is p (1 - p) over it: at most the number of samples, so
    that luck in the blocks makes no interval narrower than independence does; at least (B - 1) (1 - r) / (1 + r) where blocks are
    equal. B where p is 0 or 1, and 1 where there is one block: no spread can be seen.
    """
    h, n = np.asarray(hits, dtype=float), np.asarray(samples, dtype=float)
    blocks, total = len(n), float(n.sum())
    share = float(h.sum()) / total
    if blocks == 1 or share in (0.0, 1.0):
        return float(blocks)
    away = h - share * n
    alike = likeness(away)
    variance = blocks / (blocks - 1) * float(away @ away) / total**2 * (1 + alike) / (1 - alike)
    return min(total, share * (1 - share) / variance) if variance > 0 else total
