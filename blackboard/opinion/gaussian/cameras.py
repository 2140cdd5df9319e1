"""How noisy cameras of one make are: who sees landmarks finds it, and that says it of mates who see none.

A robot holds the noise of its camera to be so many times what its model says. The logarithms of these factors are exchangeable among
robots of one make (Gelman et al., Bayesian Data Analysis, chapter 5): a share of their variance is the make's, and all have it in
common. Each robot tells what it has found alone, and its sightings with it. A joint corrects them by what its mates have found.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from blackboard.opinion.gaussian.relation import Bias, Relative

MOST = 1.0  # sigmas of the prior: a mate's factor counts for no more, because nobody can check it
TINY = 1e-3  # of a sigma, and of a precision: less counts as this much, and as nothing
#: Mean and sigma of the binary logarithm of a factor. Its prior is 0 and 1.
Found = tuple[float, float]
UNKNOWN: Found = (0.0, 1.0)


@dataclass(frozen=True)
class CameraFound:
    """What a robot has found alone: the factors of the sigmas of its ranges and bearings, over those of a model.

    `model` are the numbers of that model. Factors over different models are not compared.
    """

    model: tuple[float, ...]
    range: Found = UNKNOWN
    bearing: Found = UNKNOWN


def scaled(relative: Relative, ranges: float, bearings: float) -> Relative:
    """A sighting by a camera whose fresh variances of ranges and bearings are so many times as large.

    The lasting errors of a range go with it. A sighting that says itself how exact it is, or has a profile, stays as it is.
    """
    if not relative.stretched or relative.kind != "range-bearing":
        return relative
    return replace(
        relative,
        range_variance=relative.range_variance * ranges,
        bearing_variance=relative.bearing_variance * bearings,
        biases=tuple(Bias(bias.sigma * ranges**0.5, bias.seconds) for bias in relative.biases),
    )


def by_mates(own: CameraFound, mates: Iterable[CameraFound], alike: float) -> tuple[float, float]:
    """By how much the variances of a robot's ranges and bearings are larger than it has found alone, as its mates say.

    `alike` is the share of the make in the variance of a factor's logarithm.
    """
    like = [mate for mate in mates if mate.model == own.model]
    ranges, bearings = [mate.range for mate in like], [mate.bearing for mate in like]
    return _corrected(own.range, ranges, alike), _corrected(own.bearing, bearings, alike)


def _corrected(own: Found, mates: Sequence[Found], alike: float) -> float:
    total = weighted = 0.0  # precisions of what mates say of the make's factor, and their sum with its values
    for value, precision in map(_learned, mates):
        if precision:
            counts = 1.0 / (1.0 - alike + 1.0 / precision)
            total += counts
            weighted += counts * max(-MOST, min(MOST, value))
    if not total:
        return 1.0
    variance = 1.0 / (1.0 / alike + total)
    prior = 1.0 / (1.0 - alike + variance)
    value, precision = _learned(own)
    mean = (prior * variance * weighted + precision * value) / (prior + precision)
    return float(4.0 ** (mean - own[0]))


def _learned(told: Found) -> Found:
    """What a robot learned beyond its prior, as a measurement: its value and its precision, 0 of nothing."""
    mean, sigma = told
    precision = 1.0 / max(sigma, TINY) ** 2 - 1.0
    return (mean * (1.0 + precision) / precision, precision) if precision > TINY else (0.0, 0.0)
