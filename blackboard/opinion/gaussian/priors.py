"""Lasting errors that are larger than a robot's model of its sensors allows: a camera that is mounted askew, wheels of another size.

A robot enters with N(m, s^2) for a state. Where that holds, its mean is spread by s^2 - v around m once the variance is v. That is the
prior predictive check of Box (J. Royal Statistical Society A 143(4), 1980). Beyond 99.9 % of it the model is contradicted. Then the
state gets the prior that it would have had if nothing had been known, with the sigma of `WIDE`. All else that is believed follows by
what ties it to that state, as if it had been so from the start.

Sensors of one kind often have the same error: a wrong unit, or the delay of an antenna. Robots that see each other then correct each
other towards their priors, and no single error is beyond the limit. So the mean of a state over n robots with the same prior is judged
in the same way, with the prior variance s^2 / n. Without any one of the robots it must still be beyond 99 %, so that one alone cannot
cause this. Then the mean gets the wide prior; the differences of the robots from the mean keep theirs.

A prior that was contradicted by two robots, and by half of those that have it, says nothing of the others. They get the wide one.

Sources of `WIDE`: scales of wheels that slip sideways, 0.5 to 2 (Mandow et al., IROS 2007); a camera that was fastened by eye, 11
degrees; a focal length from a data sheet, 20 %.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from blackboard.opinion.chi_squared import DOUBT, GATE, quantile
from blackboard.opinion.gaussian.joint import Joint, Moments
from blackboard.opinion.gaussian.vehicle import BEARING, FORWARD, RANGE, TURN, Nuisance, turn_ties
from blackboard.opinion.grid import Array

WIDE = {FORWARD: 0.5, TURN: 0.5, BEARING: 0.2, RANGE: 0.2}  # sigmas, of the bearing in radians
SHOWN = 0.5  # times a sigma of `WIDE`: so well a state must be known with the wide prior, or else what is seen says little of it
LEAST = 1e-6  # of a sigma: less is rounding
REFUTING = 2  # robots, and half of all, whose error contradicts a prior: it is none of the others, either
FEWEST = 3  # robots whose common error is judged: without one of them two must still agree
#: How boards call these states, and their units, among the parameters of a consensus.
FOUND = {
    FORWARD: "way scale found",
    TURN: "turn scale found",
    BEARING: "bearing bias found (rad)",
    RANGE: "range bias found (share)",
}
COMPASS_FOUND = "compass bias found (rad)"


class Contradiction(NamedTuple):
    """A lasting error whose prior is contradicted, with the mean and variance that it has by the wide prior."""

    state: int
    mean: float
    variance: float
    beyond: float  # its squared distance from the prior, over the limit; 0 where other robots contradicted that prior


#: Of a lasting error: its state; mean and variance by its prior and of what is believed; mean and sigma of the wide prior.
Judged = tuple[int, tuple[float, float], tuple[float, float], tuple[float, float]]


def contradicted(
    block: Moments, entered: Moments, nuisance: Nuisance, but: Collection[int] = ()
) -> Contradiction | None:
    """The lasting error of a robot that contradicts its prior by most sigmas; None: none does.

    `block` is what is believed of the robot now, shape (12,) and (12, 12), `entered` the same when it entered; the states of `but` are
    not looked at.
    """
    judged = list[Judged]()
    for state, wide in WIDE.items():
        before, now = entered.of(state), block.of(state)
        if state not in but and before[1] < wide**2:
            judged.append((state, before, now, (_usual(nuisance, state), wide)))
    return most_contradicted(judged)


def most_contradicted(judged: Iterable[Judged], doubt: float = 1.0) -> Contradiction | None:
    """The lasting error that is farthest from its prior. The limit is larger by `doubt`; None: no error is beyond it."""
    worst, limit = None, quantile(GATE, 1) * doubt
    for state, before, now, wide in judged:
        squared, mean, variance = by_wide_prior(before, now, wide)
        if squared > limit and (worst is None or squared / limit > worst.beyond):
            worst = Contradiction(state, mean, variance, squared / limit)
    return worst


def with_one_prior(nuisances: Mapping[str, Nuisance]) -> dict[tuple[int, float, float], list[str]]:
    """The robots whose lasting error has the same prior, by state and the prior's mean and sigma.

    Robots of one make are left out (`alike`): their priors have a common part already, so each follows the others.
    """
    groups = defaultdict[tuple[int, float, float], list[str]](list)
    for robot, nuisance in nuisances.items():
        for state, wide in WIDE.items():
            sigma = nuisance.sigmas[state - FORWARD]
            if 0 < sigma < wide and not nuisance.alike:
                groups[state, _usual(nuisance, state), sigma].append(robot)
    return groups


def contradicted_alike(state: int, prior: Moments, now: Moments, wide: tuple[float, float]) -> Contradiction | None:
    """The mean over robots of one lasting error, if it contradicts its prior, and no robot alone is the reason.

    Without any one of them the mean must be beyond 99 %, always to the same side. The measurements must hold as much information on
    the mean as the prior of one robot. With less, taking out the prior would multiply errors of linearisation by more than n + 1.
    `prior` and `now` are the errors of n robots by their priors and as they are believed, shape (n,) and (n, n) each. `wide` is mean
    and sigma of the wide prior of their mean.
    """
    robots, limit, without = len(now.mean), quantile(GATE, 1), list[float]()
    before, after = (_of_mean(errors, np.ones(robots)) for errors in (prior, now))
    squared, mean, variance = by_wide_prior(before, after, wide)
    if squared <= limit or after[1] > before[1] * robots / (robots + 1):
        return None
    for others in 1.0 - np.eye(robots):
        before, after = _of_mean(prior, others), _of_mean(now, others)
        without.append(math.copysign(by_wide_prior(before, after, wide)[0], after[0] - before[0]))
    is_common = max(min(without), -max(without)) > quantile(DOUBT, 1)
    return Contradiction(state, mean, variance, squared / limit) if is_common else None


def is_refuted(contradicting: int, robots: int) -> bool:
    """Whether a prior that some robots have of an error is none, because that of so many of them contradicted it."""
    return contradicting >= max(REFUTING, robots / 2)


def _of_mean(errors: Moments, counted: Array) -> tuple[float, float]:
    """Mean and variance of the mean of some errors: of those for which `counted`, shape (n,), is 1, and not 0."""
    share = counted / counted.sum()
    return float(share @ errors.mean), float(share @ errors.covariance @ share)


def by_wide_prior(
    before: tuple[float, float], now: tuple[float, float], wide: tuple[float, float]
) -> tuple[float, float, float]:
    """By how many sigmas, squared, what was seen of a state contradicts its prior, and its mean and variance by a wide one.

    `before` and `now` are mean and variance by the prior and of what is believed, `wide` mean and sigma of the wide prior. 0 sigmas:
    too little was seen for that, or it contradicts the wide prior, too.
    """
    (then, prior), (mean, left) = before, now
    middle, sigma = wide
    if not LEAST**2 < left < prior:
        return 0.0, mean, left
    information = 1 / left - 1 / prior + 1 / sigma**2
    led = (mean / left - then / prior + middle / sigma**2) / information
    holds = (led - middle) ** 2 <= quantile(GATE, 1) * (sigma**2 - 1 / information)
    enough = information * (SHOWN * sigma) ** 2 > 1 and holds
    return (mean - then) ** 2 / (prior - left) if enough else 0.0, led, 1 / information


def _usual(nuisance: Nuisance, state: int) -> float:
    """The prior mean of a state; of all but the scales 0."""
    return {FORWARD: nuisance.forward, TURN: nuisance.turn}.get(state, 0.0)


def widen(joint: Joint, states: int | Sequence[int], variance: float, moved: Array) -> None:
    """`Joint.widen`, where the errors of places are held in coordinates that turn with the heading's (`vehicle.correct`)."""
    joint.widen(states, variance, moved)
    turn_ties(joint, moved)


def replace_prior(joint: Joint, state: int, mean: float, variance: float) -> None:
    """Give a state, by its index, the mean and variance that it has by the wide prior; all else follows by regression on it."""
    widen(joint, state, variance, joint.regression(state) * (mean - joint.mean[state]))


def found_in(parameters: Mapping[str, object]) -> dict[str, float]:
    """Those parameters of a consensus that tell sensor errors (`FOUND`): name -> value; what is no number is left out."""
    return {
        name: value for name in (*FOUND.values(), COMPASS_FOUND) if isinstance(value := parameters.get(name), float)
    }


def spread_of_means(before: float, after: float, wide: float) -> float:
    """The sigma of the change of a state's mean when its variance goes from `before` to `after`, if the `wide` prior is right."""
    return (1 - before / after) * math.sqrt(max(0.0, wide**2 - after))
