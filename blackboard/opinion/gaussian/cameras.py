"""How noisy cameras of one make are. A robot that sees landmarks measures its camera's noise; mates that see none learn from it.

Each robot estimates a factor: its camera's true sigma over its model's. The logarithms of these factors are exchangeable among robots
of one make (Gelman et al., Bayesian Data Analysis, chapter 5): the make's mean has a share of their variance. A robot scales its
sightings by its own estimate and tells it. The joint scales them further, to the estimate given what all robots of the make told.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from blackboard.opinion.gaussian.relation import Bias, Relative

#: The estimate that another robot sends of its camera's noise is clipped to the prior mean +- this many sigmas, because nobody else
#: can verify it.
MOST = 1.0
TINY = 1e-3  # the least sigma that is believed, and the least precision that counts
#: Mean and sigma of the binary logarithm of a factor. Its prior is 0 and 1.
Found = tuple[float, float]
UNKNOWN: Found = (0.0, 1.0)


@dataclass(frozen=True)
class CameraFound:
    """A robot's own estimates of the factors for its ranges and its bearings.

    `model` are the sigmas that the factors multiply (`Camera`). Factors of different models are not compared.
    """

    model: tuple[float, ...]
    range: Found = UNKNOWN
    bearing: Found = UNKNOWN


def scaled(relative: Relative, ranges: float, bearings: float) -> Relative:
    """A sighting by a camera whose fresh variances of ranges and bearings are so many times as large.

    The lasting errors of a range go with it. A sighting that says itself how exact it is, or has a profile, stays as it is.
    """
    if not relative.biases or relative.kind != "range-bearing":
        return relative
    return replace(
        relative,
        range_variance=relative.range_variance * ranges,
        bearing_variance=relative.bearing_variance * bearings,
        biases=tuple(Bias(bias.sigma * ranges**0.5, bias.seconds) for bias in relative.biases),
    )


def by_mates(own: CameraFound, mates: Iterable[CameraFound], alike: float) -> tuple[float, float]:
    """By what to multiply the variances of a robot's ranges and bearings, which it has scaled by its own estimates.

    `alike` is the share of the make in the variance of a factor's logarithm.
    """
    like = [mate for mate in mates if mate.model == own.model]
    ranges, bearings = [mate.range for mate in like], [mate.bearing for mate in like]
    return _corrected(own.range, ranges, alike), _corrected(own.bearing, bearings, alike)


def _corrected(own: Found, mates: Sequence[Found], alike: float) -> float:
    total = weighted = 0.0  # of the mates' estimates: the sum of precisions, and of precisions times values
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
    """An estimate without its prior, as a measurement: value and precision, which is 0 where nothing was measured."""
    mean, sigma = told
    precision = 1.0 / max(sigma, TINY) ** 2 - 1.0
    return (mean * (1.0 + precision) / precision, precision) if precision > TINY else (0.0, 0.0)
