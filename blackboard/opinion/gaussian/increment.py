"""Evidence increments: what a first-hand belief gained over its own prediction, to be multiplied in elsewhere once.

A belief divided by its own prediction is the likelihood of what came in between, whatever was known before: the idea of
the channel filter (Grime and Durrant-Whyte, Control Engineering Practice 2(5), 1994).
"""

from dataclasses import dataclass

import numpy as np

from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import ANYWHERE, HEADING, wrap
from blackboard.opinion.grid import Array

KNOWN = 1e-18  # a prior variance below this is taken for none: the state is known and cannot gain
LEAST_LEFT = 1e-12  # of a prior variance that is taken to be left, so that what was gained is a number
NOTHING = 1e-3  # an increment with this share of the information in a uniform heading (1 / ANYWHERE), or less, says nothing of it
FAINT = 1e-6  # a gain below this share of the prior information is rounding


@dataclass(frozen=True, eq=False)
class Increment:
    """A likelihood exp(v^T d - d^T I d / 2) of d = state - reference; the heading's difference is wrapped.

    `reference` and `vector` v have shape (12,), `information` I has shape (12, 12) and no negative eigenvalue.
    """

    reference: Array
    information: Array
    vector: Array

    @property
    def tells_heading(self) -> bool:
        """Whether it has information on the heading. That of a robot with a GPS and without odometry has none."""
        return float(self.information[HEADING, HEADING]) > NOTHING / ANYWHERE


def gained(prediction: Moments, belief: Moments) -> Increment | None:
    """The belief over its own prediction, both of a robot's block; None where nothing was gained.

    Directions in which the belief is wider than its prediction (a new linearisation point) are left out.
    """
    rows, moved, gain = along_axes(prediction, belief, FAINT)
    if not len(gain):
        return None
    return Increment(prediction.mean.copy(), (rows.T * gain) @ rows, rows.T @ (moved * (1 + gain)))


def along_axes(prediction: Moments, belief: Moments, least: float) -> tuple[Array, Array, Array]:
    """The axes along which a belief gained over its prediction, both of a robot's block, at least this share of information.

    For each axis its row, shape (axes, 12), that turns a state into sigmas of the prediction; by how many of these the mean moved;
    and the information gained, as a share of the prediction's. The errors along two axes are independent.
    """
    scale = np.sqrt(np.diag(prediction.covariance))
    known = scale <= KNOWN**0.5
    scale = np.where(known, 1.0, scale)
    free = np.flatnonzero(~known)
    prior = (prediction.covariance / np.outer(scale, scale))[np.ix_(free, free)]
    after = (belief.covariance / np.outer(scale, scale))[np.ix_(free, free)]
    shift = belief.mean - prediction.mean
    shift[HEADING] = wrap(float(shift[HEADING]))
    root = np.linalg.cholesky(prior + 1e-12 * np.eye(len(free)))
    white = np.linalg.solve(root, np.linalg.solve(root, after).T)
    left, axes = np.linalg.eigh(0.5 * (white + white.T))
    gain = 1 / np.maximum(left, LEAST_LEFT) - 1
    told = gain > least
    gain, axes = gain[told], axes[:, told]
    rows = np.zeros((len(gain), len(scale)))
    rows[:, free] = np.linalg.solve(root.T, axes).T / scale[free]
    moved = axes.T @ np.linalg.solve(root, (shift / scale)[free])
    return rows, moved, gain


def likelihood(joint: Joint, robot: Block, increment: Increment) -> Factor | None:
    """The increment as independent measurements along its axes; None where it says nothing."""
    place = joint.blocks[robot]
    scale = np.sqrt(joint.variances[place])
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(increment.information * np.outer(scale, scale))
    told = values > max(1e-9, 1e-13 * float(values.max()))
    if not told.any():
        return None
    values, axes = values[told], axes[:, told]
    rows = axes.T / scale
    apart = joint.mean[place] - increment.reference
    apart[HEADING] = wrap(float(apart[HEADING]))
    measured = (axes.T @ (increment.vector * scale)) / values
    of_place = not increment.tells_heading
    return Factor(measured - rows @ apart, {robot: rows}, np.diag(1 / values), of_place=of_place)
