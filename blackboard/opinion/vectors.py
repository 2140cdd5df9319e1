"""Probability vectors (PV): what goes into a pool is checked here, what comes out of it is normalised here.

`opinions` is always (N, *grid shape): N opinions over the same cells, each non-negative and summing to 1.
"""

import math

import numpy as np
import numpy.typing as npt

from blackboard.errors import OpinionError, VetoError
from blackboard.opinion.grid import Array

#: How far the sum of an opinion may be off 1: float32 on the wire is off by 1e-7, a forgotten normalisation by far more.
TOLERANCE = 1e-6


def checked(opinions: npt.ArrayLike) -> Array:
    """The opinions as a float64 array (N, *grid shape), not copied where they are one already.

    Raises OpinionError that names the opinion, the cell and the value.
    """
    try:
        stack = np.asarray(opinions, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OpinionError(f"opinions are no array of numbers ({error}); give equally shaped arrays") from None
    if stack.ndim < 2 or stack.size == 0:
        raise OpinionError(
            f"opinions of shape {stack.shape}: give (N, *grid shape) with at least one opinion and one cell"
        )
    with np.errstate(invalid="ignore", over="ignore"):
        totals = stack.sum(axis=tuple(range(1, stack.ndim)))
        if stack.min() >= 0 and bool(np.all(np.abs(totals - 1.0) <= TOLERANCE)):  # a NaN fails both
            return stack
    raise OpinionError(_fault(stack, totals))


def _fault(stack: Array, totals: Array) -> str:
    """The first thing wrong with the first wrong opinion."""
    for number, (opinion, total) in enumerate(zip(stack, totals, strict=True)):
        wrong = np.argwhere(~(np.isfinite(opinion) & (opinion >= 0)))
        if len(wrong):
            cell = tuple(int(i) for i in wrong[0])
            return f"opinion {number}, cell {cell}: {opinion[cell]} is no probability; give finite values of at least 0"
        if not abs(total - 1.0) <= TOLERANCE:
            return (
                f"opinion {number}: its cells sum to {total:.9g}, not to 1 within {TOLERANCE:g}; divide it by its sum"
            )
    raise AssertionError("every opinion is a probability vector")


def checked_weights(weights: npt.ArrayLike | None, n: int) -> Array:
    """Weights of n opinions as given, shape (n,); None means 1 each. Raises OpinionError that names the weight."""
    if weights is None:
        return np.ones(n)
    try:
        given = np.asarray(weights, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OpinionError(f"weights are no array of numbers ({error}); give one for each opinion") from None
    if given.shape != (n,):
        raise OpinionError(f"weights of shape {given.shape} for {n} opinions; give one for each")
    for number, weight in enumerate(given):
        if not (math.isfinite(weight) and weight >= 0):
            raise OpinionError(f"weight {number}: {weight}; give finite values of at least 0")
    if not given.any():
        raise OpinionError("all weights are 0; give at least one opinion a positive one")
    return given


def shares(weights: npt.ArrayLike | None, n: int) -> Array:
    """Weights of n opinions scaled to sum to 1, shape (n,); None means equal."""
    given = checked_weights(weights, n)
    scaled = given / given.max()  # first, so that the sum of huge weights stays finite
    return np.asarray(scaled / scaled.sum())


def tempered(opinions: Array, powers: Array) -> Array:
    """Checked opinions (N, *grid shape), each to its power, powers (N,) above 0, and normalised: below 1 it claims less."""
    if np.all(powers == 1):
        return opinions
    flat = opinions.reshape(len(opinions), -1)
    raised = (flat / flat.max(axis=1, keepdims=True)) ** powers[:, np.newaxis]
    return np.asarray((raised / raised.sum(axis=1, keepdims=True)).reshape(opinions.shape))


def positive(value: float, name: str) -> float:
    """An argument that must be positive and finite; otherwise OpinionError."""
    if not (math.isfinite(value) and value > 0):
        raise OpinionError(f"{name} {value}: give a finite value above 0")
    return value


def logarithm(p: Array) -> Array:
    """Natural logarithm, with ln 0 = -inf."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(p))


def from_logarithm(logs: Array, rule: str) -> Array:
    """exp(logs), normalised to sum to 1: only a true zero (-inf) is a veto, however small the rest.

    Raises VetoError where no cell survives.
    """
    peak = logs.max()
    if peak == -math.inf:
        raise VetoError(
            f"{rule}: no cell is left that its opinions hold possible together; "
            "give the opinions a floor or take a rule without veto (linear, cooperative)"
        )
    p = np.exp(logs - peak)
    return np.asarray(p / p.sum())
