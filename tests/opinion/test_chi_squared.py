"""The quantiles of chi-squared against its distribution function, by the recursion from f to f + 2 degrees of freedom."""

import math

import pytest

from blackboard.opinion.chi_squared import GATE, TABLE, quantile, wilson_hilferty


def beyond(squared: float, freedom: int) -> float:
    """The probability of more than a squared distance."""
    half, first = squared / 2, 2 - freedom % 2
    tail = math.exp(-half) if first == 2 else math.erfc(math.sqrt(half))
    return tail + math.fsum(half ** (f / 2) * math.exp(-half) / math.gamma(f / 2 + 1) for f in range(first, freedom, 2))


@pytest.mark.parametrize("share", TABLE)
@pytest.mark.parametrize("freedom", range(1, 31))
def test_a_quantile_is_exceeded_by_what_is_left_of_all(share: float, freedom: int) -> None:
    squared = quantile(share, freedom)
    assert beyond(squared, freedom) == pytest.approx(1 - share, rel=0.01 if freedom < 10 else 0.07)
    assert wilson_hilferty(share, freedom) == pytest.approx(squared, rel=0.035)


def test_between_whole_degrees_of_freedom_quantiles_grow() -> None:
    quantiles = [wilson_hilferty(GATE, 1 + f / 10) for f in range(100)]
    assert quantiles == sorted(quantiles)
