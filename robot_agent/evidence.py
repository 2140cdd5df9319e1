"""A likelihood over a grid of two axes, and in which windows it has to be computed."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from blackboard.opinion.grid import Array, Grid
from robot_agent.window import Window, around, whole

#: A likelihood that gives a belief no more than this share of its largest value meets nothing of it.
LEAST_MET = 1e-12

#: What is less is zero.
LEAST_FLOAT = 5e-324


@dataclass(frozen=True)
class LazyLikelihood:
    """A likelihood that is computed where it is asked for, to which `floor` times its largest value is added everywhere."""

    of: Callable[[Window], Array]  # in the cells of a window, as an array of its shape
    support: Window  # outside, the likelihood is zero, or lost to rounding when the floor is added
    peak: Window  # holds the largest value; outside, Bayes' rule does not more than double a cell's share of the mass
    floor: float = 0.0


def gaussian_evidence(
    likelihood: Callable[[Window], Array], grid: Grid, mean: Sequence[float], covariance: Array, floor: float = 0.0
) -> LazyLikelihood:
    """The likelihood exp(-d^T C^-1 d / 2) at the displacements d of the cells from `mean` (unit); C is the `covariance`, (2, 2)."""
    d = []  # from the mean to the nearest cell
    for axis in (0, 1):
        first = grid.origin[axis] + grid.cell / 2
        nearest = min(max(round((mean[axis] - first) / grid.cell), 0), grid.shape[axis] - 1)
        d.append(first + nearest * grid.cell - mean[axis])
    (xx, xy), (_, yy) = covariance.tolist()
    if xx * yy <= xy * xy:  # no covariance to numbers of this size: nothing is known of where it matters
        everywhere = whole(grid.shape)
        return LazyLikelihood(likelihood, everywhere, everywhere, floor)
    squared = yy * d[0] ** 2 - 2 * xy * d[0] * d[1] + xx * d[1] ** 2
    least = max(0.0, squared / (xx * yy - xy * xy))  # d^T C^-1 d

    def likelier(share: float) -> Window:
        """All cells whose likelihood is at least a share of that of the nearest one: the box about an ellipse."""
        most = least - 2 * math.log(share)
        return around(grid, mean, (math.sqrt(most * xx), math.sqrt(most * yy)))

    lost = max(floor * 2.0**-54, LEAST_FLOAT)
    return LazyLikelihood(likelihood, likelier(lost), likelier(max(floor, LEAST_MET)), floor)
