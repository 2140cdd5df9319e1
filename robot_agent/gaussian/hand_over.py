"""The hand-over from a grid to a Gaussian filter: once a robot that looked for its pose has one hypothesis left."""

import math

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.vehicle import wrap
from robot_agent.localizer import Localizer
from robot_agent.pose import PoseLocalizer

APART = 0.2  # total variation distance from a Gaussian, at most, of a grid that is handed over
WIDEST = 0.15  # sigma of it, as a share of the grid's shorter edge: a flat grid is no hypothesis
WIDEST_HEADING = 0.3  # radians


def pose_of(localizer: Localizer) -> Moments | None:
    """Mean and covariance of (x, y, heading), shape (3,) and (3, 3), of a localizer with one hypothesis; None of others.

    Only the localizer "pose" knows a heading that nobody told it. Moments are those of the belief's square, see `one_hypothesis`.
    """
    if not isinstance(localizer, PoseLocalizer):
        return None
    place = one_hypothesis(localizer.marginal())
    if place is None:
        return None
    poses = localizer.poses
    active = poses.slices()
    held = np.square(poses.p[active], dtype=float)
    held /= held.sum()
    by_bin = held.sum(axis=(1, 2))
    middle = float(np.angle(by_bin @ np.exp(1j * poses.headings[active])))
    off = wrap(poses.headings[active] - middle)
    x, y = poses.grid.mesh()
    axes = [x + poses.offsets[active, 0, None, None], y + poses.offsets[active, 1, None, None], off[:, None, None]]
    mean = np.array([float((held * axis).sum()) for axis in axes])
    apart = [axis - centre for axis, centre in zip(axes, mean, strict=True)]
    covariance = 2 * np.array([[float((held * a * b).sum()) for b in apart] for a in apart])
    covariance += np.diag([poses.grid.cell**2, poses.grid.cell**2, poses.bin**2]) / 12
    sigma = math.sqrt(covariance[2, 2])
    near = np.abs(off - mean[2]) < 4 * sigma
    if sigma > WIDEST_HEADING or poses.masses[active][near].sum() < (1 - APART) * poses.masses.sum():
        return None
    mean[2] = float(wrap(mean[2] + middle))
    return Moments(mean, covariance)


def one_hypothesis(belief: Belief) -> Moments | None:
    """Mean and covariance of a grid belief over (x, y) that is near to a Gaussian; None where it is not.

    The moments are those of the belief's square (the escort distribution), with twice its covariance: of a Gaussian they are
    its own, and a thin uniform share does not move them. Near: but `APART` of the mass is where that Gaussian has it.
    """
    grid = belief.grid
    escort = Belief(grid, belief.p**2 / float((belief.p**2).sum()))
    covariance = 2 * escort.covariance() + np.eye(2) * grid.cell**2 / 12
    if max(np.diag(covariance)) > (WIDEST * min(grid.shape) * grid.cell) ** 2:
        return None
    moments = Moments(escort.mean(), covariance)
    apart = 0.5 * float(np.abs(draw(grid, moments).p - belief.p).sum())
    return moments if apart < APART else None
