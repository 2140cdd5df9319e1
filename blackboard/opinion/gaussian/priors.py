"""Lasting errors that are larger than a robot's model of its sensors allows: a camera that is mounted askew, wheels of another size.

A robot enters with N(m, s^2) for a state. Where that holds, its mean is spread by s^2 - v around m once the variance is v. That is the
prior predictive check of Box (J. Royal Statistical Society A 143(4), 1980). Beyond 99.9 % of it the model is contradicted. Then the
state gets the prior that it would have had if nothing had been known, with the sigma of `WIDE`. All else that is believed follows by
what ties it to that state, as if it had been so from the start.

Sources of `WIDE`: scales of wheels that slip sideways, 0.5 to 2 (Mandow et al., IROS 2007); a camera that was fastened by eye, 11
degrees; a focal length from a data sheet, 20 %.
"""

import math
from collections.abc import Collection, Mapping

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import BEARING, FORWARD, RANGE, TURN, Nuisance, turn_ties
from blackboard.opinion.grid import Array

WIDE = {FORWARD: 0.5, TURN: 0.5, BEARING: 0.2, RANGE: 0.2}  # sigmas, of the bearing in radians
SHOWN = 0.5  # times a sigma of `WIDE`: so well a state must be known with the wide prior, or else what is seen says little of it
LEAST = 1e-6  # of a sigma: less is rounding
#: How boards call these states, and their units, among the parameters of a consensus.
FOUND = {
    FORWARD: "way scale found",
    TURN: "turn scale found",
    BEARING: "bearing bias found (rad)",
    RANGE: "range bias found (share)",
}


def contradicted(
    block: Moments, entered: Moments, nuisance: Nuisance, but: Collection[int] = ()
) -> tuple[int, float, float] | None:
    """The state of a robot's block, shape (12,), that contradicts most with what the robot `entered`, `but` some; None: none.

    With it come the mean and the variance that it would have by the wide prior.
    """
    means, farthest, worst = nuisance.prior().mean, quantile(GATE, 1), None
    for state, wide in WIDE.items():
        before, left = float(entered.covariance[state, state]), float(block.covariance[state, state])
        if state in but or not LEAST**2 < left < before < wide**2:
            continue
        beyond = float(block.mean[state] - entered.mean[state]) ** 2 / (before - left)
        information = 1 / left - 1 / before + 1 / wide**2
        if beyond > farthest and information * (SHOWN * wide) ** 2 > 1:
            told = float(block.mean[state]) / left - float(entered.mean[state]) / before
            mean = (told + float(means[state - FORWARD]) / wide**2) / information
            worst, farthest = (state, mean, 1 / information), beyond
    return worst


def retell(joint: Joint, state: int, variance: float, way: Array) -> None:
    """Give a state, by its index in the joint, a larger variance, and let the means of all states go a way, shape (n,)."""
    joint.retell(state, variance, way)
    turn_ties(joint, way)


def found_in(parameters: Mapping[str, object]) -> dict[str, float]:
    """What the parameters of a consensus say of `FOUND`."""
    return {name: value for name in FOUND.values() if isinstance(value := parameters.get(name), float)}


def spread_of_means(before: float, after: float, state: int) -> float:
    """Sigma of how far the mean of a state moves, from one variance to another, where the wide prior is right."""
    return (1 - before / after) * math.sqrt(max(0.0, WIDE[state] ** 2 - after))
