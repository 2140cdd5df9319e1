"""The paper's localizer: a grid over (x, y); the heading is a number, from the compass or from odometry alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.raster import diffused, log_ratio, resampled, sampled, squared_distance, whole_shift, with_outlier
from robot_agent.sensing import (
    SEEN_TO,
    Motion,
    bearing_variance,
    motion_since,
    position_likelihood,
    range_variance,
    uncertain_likelihood,
)


@dataclass(frozen=True, eq=False)
class PositionLocalizer:
    """Mass `p` on the team's grid shifted by `offset` (unit).

    Motion moves `p` by whole cells and leaves the remainder in `offset`, because interpolating at every step would blur.
    """

    settings: RobotSection
    grid: Grid
    p: Array
    offset: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0  # radians
    pending_covariance: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # xx, yy, xy in unit ** 2: motion noise not yet in `p`

    @classmethod
    def unknown(cls, settings: RobotSection, grid: Grid) -> PositionLocalizer:
        return cls(settings, grid, uniform(grid).p)

    def predict(self, motion: Motion, compass: float | None) -> PositionLocalizer:
        heading = self.heading + motion.turn if compass is None else compass
        c, s = math.cos(heading), math.sin(heading)
        x, y = self.offset[0] + motion.distance * c, self.offset[1] + motion.distance * s
        cell = self.grid.cell
        whole = round(x / cell), round(y / cell)
        p = whole_shift(whole_shift(self.p, whole[0], 0), whole[1], 1)
        xx, yy, xy = self.pending_covariance  # R diag(along, across) R^T for each step, R turning by the heading
        pending = (
            xx + motion.along * c * c + motion.across * s * s,
            yy + motion.along * s * s + motion.across * c * c,
            xy + (motion.along - motion.across) * c * s,
        )
        offset = x - whole[0] * cell, y - whole[1] * cell
        after = replace(self, p=p, offset=offset, heading=heading, pending_covariance=pending)
        if (
            max(pending[:2]) <= (cell / 3) ** 2
        ):  # a smaller blur hardly moves mass between cells: it is added to the next
            return after
        return replace(after, p=after._spread(), pending_covariance=(0.0, 0.0, 0.0))

    def update_with_fix(self, fix: Fix) -> PositionLocalizer:
        variance = fix.sigma**2 + self.grid.cell**2 / 12  # that of a uniform place within the cell
        x, y = self._centres()
        # ln N((x, y); fix, variance I)
        logs = -0.5 * ((x - fix.position[0]) ** 2 + (y - fix.position[1]) ** 2) / variance
        turned = self if fix.heading is None else replace(self, heading=fix.heading)
        return turned._update_with_likelihood(np.exp(logs))

    def update_with_sighting(
        self, sighting: Sighting, motion: Motion | None, place: Array, covariance: Array
    ) -> PositionLocalizer:
        x, y = self._centres()
        dx, dy = place[0] - x, place[1] - y
        seen = self._seen(sighting, motion)
        if self.settings.vision.kind != "position":
            noise = self._noise(sighting) + covariance
            likelihood = np.exp(-0.5 * squared_distance(dx - seen[0], dy - seen[1], noise))
        elif covariance.any():
            likelihood = uncertain_likelihood(dx, dy, seen, covariance, self.settings.vision)
        else:
            likelihood = position_likelihood(dx, dy, seen, self.settings.vision)
        return self._update_with_likelihood(likelihood + math.exp(-self.settings.vision.misread) * likelihood.max())

    def tempered(self, power: float) -> PositionLocalizer:
        p = self.p**power
        return replace(self, p=p / p.sum())

    def entropy(self) -> float:
        return entropy(self.p)

    def marginal(self) -> Belief:
        p = self._spread() if any(self.pending_covariance) else self.p
        p = resampled(p, self.offset[0] / self.grid.cell, self.offset[1] / self.grid.cell)
        return Belief(self.grid, p / p.sum())

    def fold(self, agreed: Belief, reported: Belief) -> PositionLocalizer:
        logs = log_ratio(agreed, reported)
        if logs is None:
            return replace(self, p=agreed.p, offset=(0.0, 0.0), pending_covariance=(0.0, 0.0, 0.0))
        cell = self.grid.cell
        # Jeffrey's rule, with agreed / reported read where the cells of `p` stand
        return self._update_with_likelihood(np.exp(sampled(logs, self.offset[0] / cell, self.offset[1] / cell)))

    def project(self, sighting: Sighting, motion: Motion | None) -> Belief:
        """The belief convolved with the likelihood of each displacement from robot to subject (exact, by FFT)."""
        nx, ny = self.grid.shape
        cell = self.grid.cell
        sees = SEEN_TO if self.settings.vision.kind == "position" else math.inf
        # cells from the robot to the kernel's edge
        rx, ry = (int(min(n - 1, sees // cell + 1)) for n in self.grid.shape)
        dx = np.arange(-rx, rx + 1)[:, None] * cell - self.offset[0]
        dy = np.arange(-ry, ry + 1)[None, :] * cell - self.offset[1]
        seen = self._seen(sighting, motion)
        if self.settings.vision.kind == "position":
            kernel = position_likelihood(dx, dy, seen, self.settings.vision)
        else:
            kernel = np.exp(-0.5 * squared_distance(dx - seen[0], dy - seen[1], self._noise(sighting)))
        size = nx + rx, ny + ry  # what wraps around falls outside the slice below
        full = np.fft.irfft2(np.fft.rfft2(self.p, size) * np.fft.rfft2(kernel, size), size)
        p = np.maximum(full[rx : rx + nx, ry : ry + ny], 0.0)
        return with_outlier(p, self.grid, self.settings.vision.outlier)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _spread(self) -> Array:
        """`p` with the pending motion noise."""
        xx, yy, xy = (v / self.grid.cell**2 for v in self.pending_covariance)
        return diffused(self.p, np.array([[xx, xy], [xy, yy]]))

    def _centres(self) -> tuple[Array, Array]:
        x, y = self.grid.mesh()
        return x + self.offset[0], y + self.offset[1]

    def _seen(self, sighting: Sighting, motion: Motion | None) -> tuple[float, float]:
        """The measured displacement from where the robot is now to the subject, in world axes (unit)."""
        driven, turned = motion_since(sighting, motion)
        angle = self.heading - turned + sighting.bearing
        return (
            sighting.range * math.cos(angle) - driven * math.cos(self.heading),
            sighting.range * math.sin(angle) - driven * math.sin(self.heading),
        )

    def _noise(self, sighting: Sighting) -> Array:
        """Covariance of the measured displacement, shape (2, 2), world axes: R diag(var r, r^2 var b) R^T + cell^2 / 12 I."""
        vision = self.settings.vision
        angle = self.heading + sighting.bearing
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        spread = np.diag([range_variance(sighting.range, vision), sighting.range**2 * bearing_variance(vision)])
        return np.asarray(turn @ spread @ turn.T + np.eye(2) * self.grid.cell**2 / 12)

    def _update_with_likelihood(self, likelihood: Array) -> PositionLocalizer:
        """Bayes' rule; a likelihood that is nowhere where `p` has mass replaces `p`."""
        p = self.p * likelihood  # Bayes' rule, normalised below
        total = p.sum()
        if total <= 1e-12 * likelihood.max():
            p, total = likelihood, likelihood.sum()
        return replace(self, p=p / total) if total > 0 else self
