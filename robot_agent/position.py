"""The paper's localizer: a grid over (x, y), the heading known from a compass (or dead reckoned)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import Belief, blur, uniform
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import log_ratio, sampled, shifted, whole_shift
from robot_agent.sensing import (
    SEEN_TO,
    Motion,
    bearing_variance,
    position_likelihood,
    range_variance,
    rewound,
    uncertain_likelihood,
)


@dataclass(frozen=True, eq=False)
class PositionLocalizer:
    """`p` on the team's grid, moved beside it by `offset` (unit): whole cells are moved, the rest is carried."""

    settings: RobotSection
    grid: Grid
    p: Array
    offset: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0
    variance: tuple[float, float] = (0.0, 0.0)  # unit ** 2, owed to `p` and not yet blurred

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
        variance = (
            self.variance[0] + motion.along * c * c + motion.across * s * s,
            self.variance[1] + motion.along * s * s + motion.across * c * c,
        )
        if max(variance) > (cell / 3) ** 2:  # less would vanish on the grid
            p, variance = blur(p, [math.sqrt(v) / cell for v in variance]), (0.0, 0.0)
        return replace(self, p=p, offset=(x - whole[0] * cell, y - whole[1] * cell), heading=heading, variance=variance)

    def fixed(self, fix: Fix) -> PositionLocalizer:
        variance = fix.sigma**2 + self.grid.cell**2 / 12
        x, y = self._centres()
        logs = -0.5 * ((x - fix.position[0]) ** 2 + (y - fix.position[1]) ** 2) / variance
        told = self if fix.heading is None else replace(self, heading=fix.heading)
        return told._weighed(np.exp(logs))

    def saw(self, sighting: Sighting, motion: Motion | None, place: Array, covariance: Array) -> PositionLocalizer:
        x, y = self._centres()
        dx, dy = place[0] - x, place[1] - y
        seen = self._seen(sighting, motion)
        if self.settings.vision.kind != "position":
            likelihood = np.exp(-0.5 * _quadratic(dx - seen[0], dy - seen[1], self._noise(sighting) + covariance))
        elif covariance.any():
            likelihood = uncertain_likelihood(dx, dy, seen, covariance, self.settings.vision)
        else:
            likelihood = position_likelihood(dx, dy, seen, self.settings.vision)
        return self._weighed(likelihood + math.exp(-self.settings.vision.misread) * likelihood.max())

    def tempered(self, power: float) -> PositionLocalizer:
        p = self.p**power
        return replace(self, p=p / p.sum())

    def entropy(self) -> float:
        return entropy(self.p)

    def marginal(self) -> Belief:
        p = shifted(self.p, self.offset[0] / self.grid.cell, self.offset[1] / self.grid.cell)
        if max(self.variance) > 0:
            p = blur(p, [math.sqrt(v) / self.grid.cell for v in self.variance])
        return Belief(self.grid, p / p.sum())

    def fold(self, agreed: Belief, reported: Belief) -> PositionLocalizer:
        logs = log_ratio(agreed, reported)
        if logs is None:
            return replace(self, p=agreed.p, offset=(0.0, 0.0), variance=(0.0, 0.0))
        cell = self.grid.cell
        return self._weighed(np.exp(sampled(logs, self.offset[0] / cell, self.offset[1] / cell)))

    def project(self, sighting: Sighting, motion: Motion | None) -> Belief:
        """The belief convolved with the sensor's kernel over displacements (exact, by FFT)."""
        nx, ny = self.grid.shape
        cell = self.grid.cell
        sees = SEEN_TO if self.settings.vision.kind == "position" else math.inf
        rx, ry = (int(min(n - 1, sees // cell + 1)) for n in self.grid.shape)  # how far the kernel reaches, cells
        dx = np.arange(-rx, rx + 1)[:, None] * cell - self.offset[0]
        dy = np.arange(-ry, ry + 1)[None, :] * cell - self.offset[1]
        seen = self._seen(sighting, motion)
        if self.settings.vision.kind == "position":
            kernel = position_likelihood(dx, dy, seen, self.settings.vision)
        else:
            kernel = np.exp(-0.5 * _quadratic(dx - seen[0], dy - seen[1], self._noise(sighting)))
        size = (max(nx + rx, 2 * rx + 1), max(ny + ry, 2 * ry + 1))  # what comes round again is cut off below
        full = np.fft.irfft2(np.fft.rfft2(self.p, size) * np.fft.rfft2(kernel, size), size)
        p = np.maximum(full[rx : rx + nx, ry : ry + ny], 0.0)
        return with_outlier(p, self.grid, self.settings.vision.outlier)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _centres(self) -> tuple[Array, Array]:
        x, y = self.grid.mesh()
        return x + self.offset[0], y + self.offset[1]

    def _seen(self, sighting: Sighting, motion: Motion | None) -> tuple[float, float]:
        """The displacement that the sighting says, in world axes."""
        driven, turned = rewound(sighting, motion)
        angle = self.heading - turned + sighting.bearing
        return (
            sighting.range * math.cos(angle) - driven * math.cos(self.heading),
            sighting.range * math.sin(angle) - driven * math.sin(self.heading),
        )

    def _noise(self, sighting: Sighting) -> Array:
        """Covariance of the displacement of a range and a bearing, world axes."""
        vision = self.settings.vision
        angle = self.heading + sighting.bearing
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        spread = np.diag([range_variance(sighting.range, vision), sighting.range**2 * bearing_variance(vision)])
        return np.asarray(turn @ spread @ turn.T + np.eye(2) * self.grid.cell**2 / 12)

    def _weighed(self, likelihood: Array) -> PositionLocalizer:
        """Bayes; evidence that meets no mass at all replaces the belief."""
        p = self.p * likelihood
        total = p.sum()
        if total <= 1e-12 * likelihood.max():
            p, total = likelihood, likelihood.sum()
        return replace(self, p=p / total) if total > 0 else self


def with_outlier(p: Array, grid: Grid, outlier: float) -> Belief:
    """A belief from a sighting, with a uniform share for the case that it was none of the subject; uniform where p is empty."""
    total = p.sum()
    if not total > 0:
        return uniform(grid)
    return Belief(grid, (1 - outlier) * p / total + outlier / grid.size)


def _quadratic(dx: Array, dy: Array, covariance: Array) -> Array:
    """d^T C^-1 d."""
    inverse = np.linalg.inv(covariance)
    return np.asarray(inverse[0, 0] * dx * dx + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy * dy)
