"""What is measured absolutely, a fix and a compass: a pose to begin with, and corrections of a robot in a joint."""

from __future__ import annotations

import numpy as np

from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import AXES, FLAT, HEADING, STATES, correct, wrap
from blackboard.wire.messages import Readings


def starting_pose(readings: Readings, compass: float) -> Moments | None:
    """The pose (x, y, heading) that a fix and a compass (its sigma by the model, radians) give, its position flat without a fix.

    None without a heading.
    """
    fix, covariance = readings.fix, np.zeros((3, 3))
    if fix is not None and fix.heading is not None:
        heading, sigma = fix.heading, fix.heading_sigma
    elif readings.compass is not None:
        heading, sigma = readings.compass, readings.compass_sigma or compass
    else:
        return None
    place = (0.0, 0.0) if fix is None else fix.position
    covariance[AXES, AXES] = np.eye(2) * (FLAT if fix is None else fix.sigma**2)
    covariance[HEADING, HEADING] = sigma**2
    return Moments(np.array([*place, heading]), covariance)


def take_absolute(joint: Joint, robot: Block, readings: Readings, compass: float) -> None:
    """Correct a robot's block by the fix and by the compass (its sigma by the model, radians)."""
    fix, rows = readings.fix, np.eye(STATES)
    if fix is not None:
        off = np.array(fix.position) - joint.moments(robot).mean[AXES]
        correct(joint, Factor(off, {robot: rows[AXES]}, np.eye(2) * fix.sigma**2))
    headings = []
    if readings.compass is not None:
        headings.append((readings.compass, readings.compass_sigma or compass))
    if fix is not None and fix.heading is not None:
        headings.append((fix.heading, fix.heading_sigma))
    for heading, sigma in headings:
        off = np.array([wrap(heading - float(joint.moments(robot).mean[HEADING]))])
        correct(joint, Factor(off, {robot: rows[[HEADING]]}, np.array([[sigma**2]])))
