"""Beliefs that are near enough to a Gaussian for a mean and a covariance to say what they claim."""

import math

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array

BELL = 0.6  # width^2 of a belief relative to that of a Gaussian with its covariance; a flat square's is 0.48, a ring's less


def bell(belief: Belief) -> tuple[Array, Array] | None:
    """The `escort_moments` of a belief that is shaped like a bell; None of others, as rings and flat ones."""
    moments = escort_moments(belief)
    return moments if width(belief) ** 2 >= BELL * spread(moments[1]) else None


def escort_moments(belief: Belief) -> tuple[Array, Array]:
    """Mean (ndim,) and covariance (ndim, ndim) of a belief by its escort distribution p^2 / sum p^2, in the grid's unit.

    Twice the escort's covariance, and cell^2 / 12 for the width of a cell: those of a Gaussian, and hardly touched by a floor.
    """
    escort = (belief.p / belief.p.max()) ** 2
    mean, covariance = Belief(belief.grid, escort / escort.sum()).moments()
    return mean, 2.0 * covariance + np.eye(belief.grid.ndim) * belief.grid.cell**2 / 12


def width(belief: Belief) -> float:
    """The sigma of the Gaussian, equal on all axes, that has the same sum p^2, in the grid's unit: of any shape of belief."""
    n = belief.grid.ndim
    return math.pow(belief.grid.volume / float((belief.p**2).sum()), 1 / n) / math.sqrt(4 * math.pi)


def spread(covariance: Array) -> float:
    """The variance of the Gaussian, equal on all axes, that is as large as one with this covariance, (ndim, ndim)."""
    return math.pow(float(np.linalg.det(covariance)), 1 / len(covariance))
