"""Six robots that stand on a circle, and what an honest one of them says."""

import math

import numpy as np

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import AXES, RANGE, STATES, Motion, Nuisance

LIAR = "robot/r2"
PLACES = {f"robot/r{k}": 10.0 * np.array([math.cos(k), math.sin(k)]) for k in range(6)}
SPREAD = 0.3  # the variance of a place with which each robot enters
FIX = 3.0  # the sigma of what each robot is told of its place in each tick


def says(robot: str, tick: int, relatives: tuple[Relative, ...] = (), scale: float = 0.0) -> Evidence:
    """Evidence of a robot that stands: an initial belief near the true place, then an exact fix in each tick.

    `scale` is the sigma that it claims of its range scale.
    """
    mean, information = np.zeros(STATES), np.zeros((STATES, STATES))
    mean[AXES], information[AXES, AXES] = PLACES[robot], np.eye(2) / FIX**2
    belief = Moments(mean, np.diag([SPREAD, SPREAD, *[1e-4] * (STATES - 2)]))
    belief.covariance[RANGE, RANGE] = scale**2
    increment = Increment(mean, information, np.zeros(STATES)) if tick else None
    return Evidence(robot, 0, tick, Motion(), Nuisance(), belief if not tick else None, increment, relatives)
