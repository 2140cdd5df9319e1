"""A robot's report with beliefs and with evidence of every kind, for tests of what is done to reports."""

import numpy as np

from blackboard.opinion.belief import gaussian
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import HEADING, STATES, Motion, Nuisance
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack
from blackboard.wire.gaussians import pack_evidence
from blackboard.wire.messages import Informed, Report

GRID = Grid((30, 30), 0.5)


def report(heading: float = 0.5) -> Report:
    mean = np.zeros(STATES)
    mean[:2], mean[HEADING] = (7.0, 8.0), heading
    covariance = np.diag([0.4, 0.4, 0.01, *[1e-4] * (STATES - 3)])
    relative = Relative("robot/r1", "robot/r2", range=3.0, bearing=-0.2, range_variance=0.04, bearing_variance=0.01)
    increment = Increment(mean.copy(), np.diag([4.0, 4.0, *[0.0] * (STATES - 2)]), np.ones(STATES))
    state = Moments(mean, covariance)
    evidence = pack_evidence(Evidence("robot/r1", 0, 0, Motion(1.0), Nuisance(), state, increment, (relative,)))
    belief = pack(gaussian(GRID, (7.0, 8.0), 0.6))
    return Report(
        source="r1",
        subject="robot/r1",
        tick=3,
        time=1.5,
        belief=belief,
        informed=Informed(belief=belief, ancestors={"r2": 1.0}),
        evidence=evidence,
    )
