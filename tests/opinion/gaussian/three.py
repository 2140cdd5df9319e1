"""Three robots that know where they are, and what they may tell of each other."""

import numpy as np

from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import AXES, STATES

ROBOTS = ("robot/r1", "robot/r2", "robot/r3")


def drawn(rng: np.random.Generator) -> tuple[str, Factor]:
    """A sighting of one robot by another, or a fix of its own, by who tells it."""
    observer, observed = rng.choice(ROBOTS, 2, replace=False)
    rows = np.zeros((2, STATES))
    rows[:, AXES] = rng.normal(size=(2, 2))
    jacobians = {str(observer): rows} if rng.random() < 0.3 else {str(observer): -rows, str(observed): rows}
    return str(observer), Factor(rng.normal(size=2), jacobians, np.diag(rng.uniform(0.1, 2.0, 2)))


def beginning() -> Joint:
    """Three robots that know where they are, each by itself, and whose headings are no matter."""
    joint = Joint()
    for robot in ROBOTS:
        joint.add(robot, Moments(np.zeros(STATES), np.diag([1.0, 2.0, *[0.0] * (STATES - 2)])))
    return joint
