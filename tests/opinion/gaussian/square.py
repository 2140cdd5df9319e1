"""Four robots that stand on the corners of a square, what they say, and where they see each other."""

import math

import numpy as np

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, STATES, Motion, Nuisance, entering

PLACES = {"robot/r1": (0.0, 0.0), "robot/r2": (5.0, 0.0), "robot/r3": (0.0, 5.0), "robot/r4": (5.0, 5.0)}


def sees(observer: str, subject: str, at: tuple[float, float]) -> Relative:
    dx, dy = np.subtract(at, PLACES[observer])
    return Relative(observer, subject, math.hypot(dx, dy), math.atan2(dy, dx), 0.01, 0.0004)


def evidence_of(
    robot: str, tick: int, *relatives: Relative, increment: Increment | None = None, variance: float = 0.04
) -> Evidence:
    at = PLACES[robot] if increment is None else increment.reference[AXES]  # first-hand it believes what it has gained
    pose = Moments(np.array([*at, 0.0]), np.diag([variance, variance, 0.0004]))
    belief = entering(pose, Nuisance())
    return Evidence(robot, 0, tick, Motion(), Nuisance(), belief, increment, relatives)


def new_team() -> TeamJoint:
    """Four robots that stand, each known to 0.2."""
    team = TeamJoint()
    team.settle(0, 1.0, [evidence_of(robot, 0) for robot in PLACES])
    return team


def increment_at(x: float, y: float) -> Increment:
    """What a robot says of its own place, to 0.2."""
    reference, information = np.zeros(STATES), np.zeros((STATES, STATES))
    reference[AXES] = x, y
    information[AXES, AXES] = np.eye(2) / 0.04
    return Increment(reference, information, np.zeros(STATES))


def compass(heading: float = 0.0) -> Increment:
    """What a robot says of its heading alone, to 0.02."""
    reference, information = np.zeros(STATES), np.zeros((STATES, STATES))
    reference[HEADING] = heading
    information[HEADING, HEADING] = 1 / 0.0004
    return Increment(reference, information, np.zeros(STATES))
