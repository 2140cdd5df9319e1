"""Quantiles of the chi-squared distribution: what a squared Mahalanobis distance stays below where all models hold.

A sum of the squares of f independent standard normal numbers is chi-squared with f degrees of freedom.
"""

import math

MEDIAN, DOUBT, GATE = 0.5, 0.99, 0.999  # the shares whose quantiles are asked for
#: By share, for 1 to 9 degrees of freedom (Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, table 26.8).
TABLE = {
    MEDIAN: (0.455, 2 * math.log(2), 2.366, 3.357, 4.351, 5.348, 6.346, 7.344, 8.343),
    DOUBT: (6.63, 9.21, 11.34, 13.28, 15.09, 16.81, 18.48, 20.09, 21.67),
    GATE: (10.83, 13.82, 16.27, 18.47, 20.52, 22.46, 24.32, 26.12, 27.88),
}
SIGMAS = {MEDIAN: 0.0, DOUBT: 2.326, GATE: 3.090}  # the quantiles of the normal distribution (the same, table 26.5)


def quantile(share: float, freedom: int) -> float:
    """The squared distance that a share of them stays below; KeyError: a share that is not in the table."""
    values = TABLE[share]
    return values[freedom - 1] if freedom <= len(values) else wilson_hilferty(share, freedom)


def wilson_hilferty(share: float, freedom: float) -> float:
    """The quantile for any degrees of freedom, within 3 % of itself from 2 on (Wilson and Hilferty, PNAS 17, 1931)."""
    part = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - part + SIGMAS[share] * math.sqrt(part)) ** 3
