"""The localizer of real robots: a grid over (heading, x, y), for sightings in range and bearing and an unknown heading."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.pose_grid import PoseGrid
from robot_agent.raster import log_ratio, sampled, shifted, with_outlier
from robot_agent.sensing import (
    TickMotion,
    along_and_across,
    bearing_variance,
    motion_since,
    part_variance,
    range_variance,
)

PROJECTED = 1e-3  # share of the mass: a heading bin with less is left out of a projection
COMPASS_SIGMA = 0.03  # radians
FARTHEST = 2  # times both sides of the grid: what is seen farther away is not on it


@dataclass(frozen=True, eq=False)
class PoseLocalizer:
    """A pose grid, and the motion noise by which it is not yet blurred: `along` and `across` the way, and in `heading`."""

    settings: RobotSection
    poses: PoseGrid
    along: float = 0.0  # unit ** 2
    across: float = 0.0  # unit ** 2
    heading: float = 0.0  # radians ** 2

    @classmethod
    def unknown(cls, settings: RobotSection, grid: Grid) -> PoseLocalizer:
        return cls(settings, PoseGrid.uniform(grid, settings.headings))

    def heading_moments(self) -> tuple[float, float]:
        """The mean heading (radians) and the variance about it."""
        headings, masses = self.poses.headings, self.poses.masses / self.poses.masses.sum()
        middle = float(np.angle(masses @ np.exp(1j * headings)))
        return middle, float(masses @ wrap(headings - middle) ** 2)

    def predict(self, motion: TickMotion, compass: float | None) -> PoseLocalizer:
        moved = replace(
            self,
            poses=self.poses.turn(motion.turn).drive(motion.distance, motion.turn),
            along=self.along + motion.along,
            across=self.across + motion.across,
            heading=self.heading + motion.heading,
        )._blurred()
        return moved if compass is None else moved._update_with_compass(compass)

    def update_with_fix(self, fix: Fix) -> PoseLocalizer:
        poses = self.poses
        variance = fix.sigma**2 + poses.grid.cell**2 / 12  # that of a uniform place within the cell
        x, y = poses.grid.mesh()
        likelihood = poses.empty()
        for i, (ox, oy) in enumerate(poses.offsets):
            squared = (x + ox - fix.position[0]) ** 2 + (y + oy - fix.position[1]) ** 2
            likelihood[i] = np.exp(-0.5 * squared / variance)
        if fix.heading is not None:
            spread = fix.heading_sigma**2 + poses.bin**2 / 12
            likelihood *= np.exp(-0.5 * wrap(poses.headings - fix.heading) ** 2 / spread)[:, None, None]
        return self._update_with_likelihood(likelihood)

    def update_with_sighting(
        self, sighting: Sighting, motion: TickMotion | None, place: Array, covariance: Array
    ) -> PoseLocalizer:
        """p(range, bearing | pose): Gaussian in both, the place's covariance taken along and across the line of sight."""
        vision = self.settings.vision
        distance, off, sight = self._seen_from(sighting, motion, place, sighting.bearing)
        along, angle = self._spread(distance, sight, covariance)
        radial, angular = range_variance(sighting.range, vision) + along, bearing_variance(vision) + angle
        squared = (sighting.range - distance) ** 2 / radial + off**2 / angular
        likelihood = np.exp(-0.5 * squared) / np.sqrt(radial * angular)
        return self._weighed(likelihood)

    def update_with_part(self, seen: Seen, motion: TickMotion | None, place: Array, covariance: Array) -> PoseLocalizer:
        distance, bearing, sight = self._seen_from(seen, motion, place, seen.values[0])
        along, angle = self._spread(distance, sight, covariance)
        off, spread = (seen.values[0] - distance, along) if seen.kind == "range" else (bearing, angle)
        spread = spread + part_variance(seen, self.settings)
        return self._weighed(np.exp(-0.5 * off**2 / spread) / np.sqrt(spread))

    def tempered(self, power: float) -> PoseLocalizer:
        active = self.poses.slices()
        bx, by = self.poses.box(active)
        out = self.poses.empty()
        out[active, bx, by] = self.poses.p[active, bx, by] ** power
        return replace(self, poses=self.poses.normalised(out))

    def entropy(self) -> float:
        active = self.poses.slices()
        bx, by = self.poses.box(active)
        held = self.poses.p[active, bx, by]
        return entropy_of(held / held.sum())

    def marginal(self) -> Belief:
        poses, cell = self.poses, self.poses.grid.cell
        p = np.zeros(poses.grid.shape)
        for i in poses.slices():
            p += shifted(poses.p[i], poses.offsets[i, 0] / cell, poses.offsets[i, 1] / cell)
        return Belief(poses.grid, p / p.sum())

    def fold(self, agreed: Belief, reported: Belief) -> PoseLocalizer:
        logs = log_ratio(agreed, reported)
        poses, cell = self.poses, self.poses.grid.cell
        if logs is None:
            p = (poses.masses[:, None, None] * agreed.p).astype(np.float32)
            poses = replace(poses, p=p, offsets=np.zeros_like(poses.offsets))
            return replace(self, poses=poses, along=0.0, across=0.0)
        if not logs.any():
            return self
        out = poses.empty()
        for i in poses.slices():  # Jeffrey's rule, with agreed / reported read where the cells of the slice stand
            out[i] = poses.p[i] * np.exp(sampled(logs, poses.offsets[i, 0] / cell, poses.offsets[i, 1] / cell))
        return replace(self, poses=poses.normalised(out))

    def project(self, sighting: Sighting, motion: TickMotion | None) -> Belief:
        """Each slice moved along the line of sight and blurred by range and bearing noise, exactly, in the Fourier domain."""
        vision, poses, cell = self.settings.vision, self.poses, self.poses.grid.cell
        driven, turned = motion_since(sighting, motion)
        reach = math.ceil(sighting.range / cell) + 16  # cells: what is moved less far does not wrap around
        if reach > FARTHEST * sum(poses.grid.shape):
            return with_outlier(np.zeros(poses.grid.shape), poses.grid, vision.outlier)
        nx, ny = (8 * math.ceil((n + reach) / 8) for n in poses.grid.shape)
        fx, fy = _frequencies(nx, ny)
        total = np.zeros((nx, ny // 2 + 1), dtype=complex)
        radial = float(range_variance(sighting.range, vision))
        across = sighting.range**2 * (bearing_variance(vision) + poses.bin**2 / 12)
        for i in poses.slices(PROJECTED):
            heading = poses.headings[i]
            angle = heading - turned + sighting.bearing
            c, s = math.cos(angle), math.sin(angle)
            x = (poses.offsets[i, 0] - driven * math.cos(heading) + sighting.range * c) / cell
            y = (poses.offsets[i, 1] - driven * math.sin(heading) + sighting.range * s) / cell
            ahead, aside = fx * c + fy * s, fy * c - fx * s
            spread = -0.5 * (radial * ahead**2 + across * aside**2) / cell**2  # ln of a Gaussian's transform
            total += np.fft.rfft2(poses.p[i], (nx, ny)) * np.exp(spread - 1j * (fx * x + fy * y))
        p = np.fft.irfft2(total, (nx, ny))[: poses.grid.shape[0], : poses.grid.shape[1]]
        return with_outlier(np.maximum(p, 0.0), poses.grid, vision.outlier)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _seen_from(
        self, sighting: Sighting | Seen, motion: TickMotion | None, place: Array, bearing: float
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """Of a place from each held pose when it was seen: the distance, by how much the bearing is off, the line of sight."""
        poses = self.poses
        driven, turned = motion_since(sighting, motion)
        active = poses.slices()
        bx, by = poses.box(active)
        gx, gy = poses.grid.mesh()
        headings = poses.headings[active]
        ox = poses.offsets[active, 0] - driven * np.cos(headings)  # where the slice was when the sighting was taken
        oy = poses.offsets[active, 1] - driven * np.sin(headings)
        dx = place[0] - (gx[None, bx] + ox[:, None, None])
        dy = place[1] - (gy[None, :, by] + oy[:, None, None])
        distance = np.maximum(np.hypot(dx, dy), poses.grid.cell / 2)
        off = wrap(np.arctan2(dy, dx) - (headings - turned)[:, None, None] - bearing)
        return distance, off, (dx / distance, dy / distance)

    def _spread(self, distance: Array, sight: tuple[Array, Array], covariance: Array) -> tuple[Array, Array]:
        """Variances of a range (unit ** 2) and a bearing (radians ** 2) that come from a place's covariance and from the grid."""
        along, across = along_and_across(*sight, covariance + np.eye(2) * self.poses.grid.cell**2 / 12)
        return along, self.poses.bin**2 / 12 + across / distance**2

    def _weighed(self, likelihood: Array) -> PoseLocalizer:
        """Bayes' rule with a likelihood of the held poses, which may be misread."""
        poses = self.poses
        active = poses.slices()
        bx, by = poses.box(active)
        floor = math.exp(-self.settings.vision.misread) * likelihood.max()
        out = poses.empty()
        out[active, bx, by] = poses.p[active, bx, by] * (likelihood + floor)
        return replace(self, poses=poses.normalised(out))

    def _blurred(self) -> PoseLocalizer:
        """Blur once the pending noise exceeds a third of a cell or of a bin: less hardly moves mass between them."""
        after = self
        if self.heading > (self.poses.bin / 3) ** 2:
            after = replace(after, poses=after.poses.blur_headings(self.heading), heading=0.0)
        if max(self.along, self.across) > (self.poses.grid.cell / 3) ** 2:
            after = replace(after, poses=after.poses.blur_positions(self.along, self.across), along=0.0, across=0.0)
        return after

    def _update_with_compass(self, compass: float) -> PoseLocalizer:
        off = wrap(self.poses.headings - compass)
        weights = np.exp(-0.5 * off**2 / (COMPASS_SIGMA**2 + self.poses.bin**2 / 12))
        return self._update_with_likelihood(np.broadcast_to(weights[:, None, None], self.poses.p.shape))

    def _update_with_likelihood(self, likelihood: Array) -> PoseLocalizer:
        """Bayes' rule; a likelihood that is nowhere where the belief has mass replaces it."""
        p = np.asarray(self.poses.p * likelihood, dtype=np.float32)
        met = p.sum() > 1e-12 * likelihood.max()
        return replace(self, poses=self.poses.normalised(p if met else np.array(likelihood, dtype=np.float32)))


@lru_cache(maxsize=64)
def _frequencies(nx: int, ny: int) -> tuple[Array, Array]:
    """Angular frequencies of rfft2, radians per cell."""
    return 2 * math.pi * np.fft.fftfreq(nx)[:, None], 2 * math.pi * np.fft.rfftfreq(ny)[None, :]
