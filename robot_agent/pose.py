"""The localizer of real robots: a grid over (heading, x, y), for range and bearing and an unknown heading.

A heading bin is a slice of the grid and moves with its own heading: by whole cells, the rest carried as the slice's offset,
because interpolating at every step would blur (mrclam/README.md). Turning rolls the slices by whole bins.
Only slices and cells that hold mass are worked on: what is below `FAINT` of the total is dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import log_ratio, sampled, shifted
from robot_agent.position import with_outlier
from robot_agent.sensing import Motion, bearing_variance, range_variance, rewound, wrap

FAINT = 1e-7  # of the total mass: a slice with less is dropped
PROJECTED = 1e-3  # of the total mass: a slice with less is left out of a projection
COMPASS_SIGMA = 0.03  # radians


@dataclass(frozen=True, eq=False)
class PoseLocalizer:
    """`p[i, ix, iy]`: heading bin i is i * 2 pi / headings + `turned`; slice i stands `offsets[i]` (unit) beside the grid."""

    settings: RobotSection
    grid: Grid
    p: Array
    offsets: Array  # (headings, 2)
    turned: float = 0.0  # radians, less than half a bin
    along: float = 0.0  # unit ** 2, owed to `p` and not yet blurred
    across: float = 0.0
    turning: float = 0.0  # radians ** 2, owed as well

    @classmethod
    def unknown(cls, settings: RobotSection, grid: Grid) -> PoseLocalizer:
        n = settings.headings
        p = np.full((n, *grid.shape), 1.0 / (n * grid.size), dtype=np.float32)
        return cls(settings, grid, p, np.zeros((n, 2)))

    @property
    def bin(self) -> float:
        return 2 * math.pi / len(self.p)

    @property
    def headings(self) -> Array:
        return np.arange(len(self.p)) * self.bin + self.turned

    def predict(self, motion: Motion, compass: float | None) -> PoseLocalizer:
        moved = self._turn(motion)._drive(motion)._owing(motion)._spread()
        return moved if compass is None else moved._pointed(compass)

    def fixed(self, fix: Fix) -> PoseLocalizer:
        variance = fix.sigma**2 + self.grid.cell**2 / 12
        x, y = self.grid.mesh()
        likelihood = self._empty()
        for i in range(len(self.p)):
            ox, oy = self.offsets[i]
            likelihood[i] = np.exp(
                -0.5 * ((x + ox - fix.position[0]) ** 2 + (y + oy - fix.position[1]) ** 2) / variance
            )
        if fix.heading is not None:
            spread = fix.heading_sigma**2 + self.bin**2 / 12
            likelihood *= np.exp(-0.5 * wrap(self.headings - fix.heading) ** 2 / spread)[:, None, None]
        return self._weighed(likelihood)

    def saw(self, sighting: Sighting, motion: Motion | None, place: Array, covariance: Array) -> PoseLocalizer:
        vision, cell = self.settings.vision, self.grid.cell
        driven, turned = rewound(sighting, motion)
        active = self._slices(FAINT)
        bx, by = self._box(active)
        gx, gy = self.grid.mesh()
        headings = self.headings[active]
        ox = self.offsets[active, 0] - driven * np.cos(headings)
        oy = self.offsets[active, 1] - driven * np.sin(headings)
        dx = place[0] - (gx[None, bx] + ox[:, None, None])
        dy = place[1] - (gy[None, :, by] + oy[:, None, None])
        distance = np.maximum(np.hypot(dx, dy), cell / 2)
        ux, uy = dx / distance, dy / distance
        (cxx, cxy), (_, cyy) = covariance + np.eye(2) * cell**2 / 12
        radial = range_variance(sighting.range, vision) + ux * ux * cxx + 2 * ux * uy * cxy + uy * uy * cyy
        across = uy * uy * cxx - 2 * ux * uy * cxy + ux * ux * cyy
        angular = bearing_variance(vision) + self.bin**2 / 12 + across / distance**2
        off = wrap(np.arctan2(dy, dx) - (headings - turned)[:, None, None] - sighting.bearing)
        squared = (sighting.range - distance) ** 2 / radial + off**2 / angular
        likelihood = np.exp(-0.5 * squared) / np.sqrt(radial * angular)
        floor = math.exp(-vision.misread) * likelihood.max()
        out = self._empty()
        out[active, bx, by] = self.p[active, bx, by] * (likelihood + floor)
        return self._normalised(out)

    def tempered(self, power: float) -> PoseLocalizer:
        active = self._slices(FAINT)
        bx, by = self._box(active)
        out = self._empty()
        out[active, bx, by] = self.p[active, bx, by] ** power
        return self._normalised(out)

    def entropy(self) -> float:
        active = self._slices(FAINT)
        bx, by = self._box(active)
        held = self.p[active, bx, by]
        return entropy(held / held.sum())

    def marginal(self) -> Belief:
        cell = self.grid.cell
        p = np.zeros(self.grid.shape)
        for i in self._slices(FAINT):
            p += shifted(self.p[i], self.offsets[i, 0] / cell, self.offsets[i, 1] / cell)
        return Belief(self.grid, p / p.sum())

    def fold(self, agreed: Belief, reported: Belief) -> PoseLocalizer:
        logs = log_ratio(agreed, reported)
        if logs is None:
            p = (self._masses[:, None, None] * agreed.p).astype(np.float32)
            return replace(self, p=p, offsets=np.zeros_like(self.offsets), along=0.0, across=0.0)
        if not logs.any():
            return self
        cell = self.grid.cell
        out = self._empty()
        for i in self._slices(FAINT):
            out[i] = self.p[i] * np.exp(sampled(logs, self.offsets[i, 0] / cell, self.offsets[i, 1] / cell))
        return self._normalised(out)

    def project(self, sighting: Sighting, motion: Motion | None) -> Belief:
        """Each slice moved along the line of sight and spread by range and bearing noise, exactly, in the Fourier domain."""
        vision, cell = self.settings.vision, self.grid.cell
        driven, turned = rewound(sighting, motion)
        reach = math.ceil(sighting.range / cell) + 16  # cells: what is moved further does not come round again
        nx, ny = (8 * math.ceil((n + reach) / 8) for n in self.grid.shape)
        fx, fy = _frequencies(nx, ny)
        total = np.zeros((nx, ny // 2 + 1), dtype=complex)
        radial = float(range_variance(sighting.range, vision))
        across = sighting.range**2 * (bearing_variance(vision) + self.bin**2 / 12)
        for i in self._slices(PROJECTED):
            heading = self.headings[i]
            angle = heading - turned + sighting.bearing
            c, s = math.cos(angle), math.sin(angle)
            x = (self.offsets[i, 0] - driven * math.cos(heading) + sighting.range * c) / cell
            y = (self.offsets[i, 1] - driven * math.sin(heading) + sighting.range * s) / cell
            ahead, aside = fx * c + fy * s, fy * c - fx * s
            spread = -0.5 * (radial * ahead**2 + across * aside**2) / cell**2
            total += np.fft.rfft2(self.p[i], (nx, ny)) * np.exp(spread - 1j * (fx * x + fy * y))
        p = np.fft.irfft2(total, (nx, ny))[: self.grid.shape[0], : self.grid.shape[1]]
        return with_outlier(np.maximum(p, 0.0), self.grid, vision.outlier)

    # --- motion -------------------------------------------------------------------------------------------------------

    def _turn(self, motion: Motion) -> PoseLocalizer:
        turned = self.turned + motion.turn
        whole = round(turned / self.bin)
        p, offsets = (np.roll(a, whole, axis=0) for a in (self.p, self.offsets)) if whole else (self.p, self.offsets)
        return replace(self, p=p, offsets=offsets, turned=turned - whole * self.bin)

    def _drive(self, motion: Motion) -> PoseLocalizer:
        """Every slice goes its own way; halfway through the turn it pointed half a turn back."""
        if motion.distance == 0:
            return self
        cell = self.grid.cell
        way = self.headings - motion.turn / 2
        offsets = self.offsets + motion.distance * np.stack([np.cos(way), np.sin(way)], axis=1)
        whole = np.rint(offsets / cell).astype(int)
        p = self._empty()
        for i in self._slices(FAINT):
            p[i] = shifted(self.p[i], int(whole[i, 0]), int(whole[i, 1]))
        return replace(self, p=p, offsets=offsets - whole * cell)

    def _owing(self, motion: Motion) -> PoseLocalizer:
        return replace(
            self,
            along=self.along + motion.along,
            across=self.across + motion.across,
            turning=self.turning + motion.heading,
        )

    def _spread(self) -> PoseLocalizer:
        """Blur once what is owed exceeds a third of a cell or a bin; less would vanish on the grid."""
        after = self
        if self.turning > (self.bin / 3) ** 2:
            after = after._blur_headings()
        if max(self.along, self.across) > (self.grid.cell / 3) ** 2:
            after = after._blur_positions()
        return after

    def _blur_positions(self) -> PoseLocalizer:
        cell, p = self.grid.cell, self._empty()
        for i in self._slices(FAINT):
            c, s = math.cos(self.headings[i]), math.sin(self.headings[i])
            variances = self.along * c * c + self.across * s * s, self.along * s * s + self.across * c * c
            p[i] = blur(self.p[i], [round(math.sqrt(v) / cell, 2) for v in variances])
        return replace(self, p=p, along=0.0, across=0.0)

    def _blur_headings(self) -> PoseLocalizer:
        """Diffuse between neighbouring slices, whose mass is moved by the difference of their offsets."""
        owed = self.turning / self.bin**2  # bins ** 2
        steps = max(1, math.ceil(owed / 0.5))
        after = self
        for _ in range(steps):
            after = after._mix(owed / steps / 2)
        return replace(after, turning=0.0)

    def _mix(self, share: float) -> PoseLocalizer:
        """Each slice gives `share` of its mass to either neighbour."""
        cell, n = self.grid.cell, len(self.p)
        out = self._empty()
        active = self._slices(FAINT)
        bx, by = self._box(active)
        out[active] += (1 - 2 * share) * self.p[active]
        for i in active:
            for j in ((i - 1) % n, (i + 1) % n):
                dx, dy = (self.offsets[i] - self.offsets[j]) / cell
                if abs(dx) + abs(dy) < 1e-9:
                    out[j, bx, by] += share * self.p[i, bx, by]
                else:
                    out[j, bx, by] += share * shifted(self.p[i, bx, by], dx, dy)
        return replace(self, p=out)

    # --- inside -------------------------------------------------------------------------------------------------------

    @cached_property
    def _masses(self) -> Array:
        """The mass of each heading bin."""
        return np.asarray(self.p.sum(axis=(1, 2)), dtype=float)

    def _slices(self, least: float) -> Array:
        """Indices of the heading bins that hold more than a share of the mass."""
        return np.flatnonzero(self._masses > least * self._masses.sum())

    def _box(self, active: Array) -> tuple[slice, slice]:
        """Where those slices hold mass, with a margin of two cells for what is shifted."""
        xy = self.p[active].sum(axis=0)
        held = xy > FAINT * xy.max()
        box = []
        for axis in (0, 1):
            hits = np.flatnonzero(held.any(axis=1 - axis))
            box.append(slice(max(0, int(hits[0]) - 2), int(hits[-1]) + 3))
        return box[0], box[1]

    def _pointed(self, compass: float) -> PoseLocalizer:
        off = wrap(self.headings - compass)
        weights = np.exp(-0.5 * off**2 / (COMPASS_SIGMA**2 + self.bin**2 / 12))
        return self._weighed(np.broadcast_to(weights[:, None, None], self.p.shape))

    def _weighed(self, likelihood: Array) -> PoseLocalizer:
        """Bayes; evidence that meets no mass at all replaces the belief."""
        p = np.asarray(self.p * likelihood, dtype=np.float32)
        met = p.sum() > 1e-12 * likelihood.max()
        return self._normalised(p if met else np.array(likelihood, dtype=np.float32))

    def _normalised(self, p: Array) -> PoseLocalizer:
        masses = p.sum(axis=(1, 2))
        total = float(masses.sum())
        if not (total > 0 and math.isfinite(total)):
            return self
        p[masses > 0] /= total
        return replace(self, p=p)

    def _empty(self) -> Array:
        """A grid without mass; float32 is precise enough and half as slow to move."""
        return np.zeros(self.p.shape, dtype=np.float32)


@lru_cache(maxsize=64)
def _frequencies(nx: int, ny: int) -> tuple[Array, Array]:
    """Angular frequencies of rfft2, radians per cell."""
    return 2 * math.pi * np.fft.fftfreq(nx)[:, None], 2 * math.pi * np.fft.rfftfreq(ny)[None, :]
