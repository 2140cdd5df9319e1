"""Probability mass over (heading, x, y), and its motion.

A heading bin is a slice of the grid and moves along its own heading, by whole cells. The remainder is kept as the slice's
offset, because interpolation at every step would blur. Turning rolls the slices by whole bins, with the remainder in `turned`.
Only slices and cells that hold mass are worked on: what is below `FAINT` of the total is dropped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blackboard.opinion.belief import blur
from blackboard.opinion.grid import Array, Grid
from robot_agent.raster import shifted
from robot_agent.window import bounds

#: Slices and cells with a smaller share of the mass than this are treated as empty.
FAINT = 1e-7


@dataclass(frozen=True, eq=False)
class PoseGrid:
    """`p[i, ix, iy]` is the mass of heading bin i in a cell. A value: every operation returns a new one."""

    grid: Grid  # the team's, over (x, y)
    p: Array  # (headings, *grid.shape), float32: precise enough, and half as slow to move
    offsets: Array  # (headings, 2), unit: slice i stands offsets[i] beside the team's grid
    turned: float = 0.0  # radians: the heading of bin 0

    @classmethod
    def uniform(cls, grid: Grid, headings: int) -> PoseGrid:
        p = np.full((headings, *grid.shape), 1.0 / (headings * grid.size), dtype=np.float32)
        return cls(grid, p, np.zeros((headings, 2)))

    @property
    def bin(self) -> float:
        """Width of a heading bin, radians."""
        return 2 * math.pi / len(self.p)

    @property
    def headings(self) -> Array:
        """The heading of each bin, radians, shape (headings,)."""
        return np.arange(len(self.p)) * self.bin + self.turned

    @cached_property
    def masses(self) -> Array:
        """The mass of each heading bin, shape (headings,)."""
        return np.asarray(self.p.sum(axis=(1, 2)), dtype=float)

    def slices(self, least: float = FAINT) -> Array:
        """Indices of the heading bins that hold more than the share `least` of the mass."""
        return np.flatnonzero(self.masses > least * self.masses.sum())

    def box(self, active: Array) -> tuple[slice, slice]:
        """The cells in which those slices hold mass, with a margin of two cells for what is shifted."""
        xy = self.p[active].sum(axis=0)
        held = xy > FAINT * xy.max()
        return bounds(held).grown(2, self.grid.shape).slices

    def empty(self) -> Array:
        """An array like `p` without mass."""
        return np.zeros(self.p.shape, dtype=np.float32)

    def normalised(self, p: Array) -> PoseGrid:
        """The same grid with the mass `p`, scaled to sum to 1 (in place); unchanged where `p` has no mass."""
        masses = p.sum(axis=(1, 2))
        total = float(masses.sum())
        if not (total > 0 and math.isfinite(total)):
            return self
        p[masses > 0] /= total
        return replace(self, p=p)

    # --- motion -------------------------------------------------------------------------------------------------------

    def turn(self, angle: float) -> PoseGrid:
        """Every heading turned by `angle` (radians)."""
        turned = self.turned + angle
        whole = round(turned / self.bin)
        p, offsets = (np.roll(a, whole, axis=0) for a in (self.p, self.offsets)) if whole else (self.p, self.offsets)
        return replace(self, p=p, offsets=offsets, turned=turned - whole * self.bin)

    def drive(self, distance: float, turned: float) -> PoseGrid:
        """Every slice moved by `distance` (unit) during a turn of `turned` (radians) that has been made already.

        The way is the chord of the arc, so its direction is the heading halfway through the turn.
        """
        if distance == 0:
            return self
        cell = self.grid.cell
        way = self.headings - turned / 2
        offsets = self.offsets + distance * np.stack([np.cos(way), np.sin(way)], axis=1)
        whole = np.rint(offsets / cell).astype(int)
        p = self.empty()
        for i in self.slices():
            p[i] = shifted(self.p[i], int(whole[i, 0]), int(whole[i, 1]))
        return replace(self, p=p, offsets=offsets - whole * cell)

    def blur_positions(self, along: float, across: float) -> PoseGrid:
        """Each slice blurred by a variance along its heading and one across it (unit ** 2), of which it takes the x and y parts."""
        cell, p = self.grid.cell, self.empty()
        for i in self.slices():
            c, s = math.cos(self.headings[i]), math.sin(self.headings[i])
            variances = along * c * c + across * s * s, along * s * s + across * c * c
            p[i] = blur(self.p[i], [round(math.sqrt(v) / cell, 2) for v in variances])
        return replace(self, p=p)

    def blur_headings(self, variance: float) -> PoseGrid:
        """The heading blurred by a variance (radians ** 2): a random walk between neighbouring bins."""
        bins = variance / self.bin**2  # variance in bins ** 2
        steps = max(1, math.ceil(bins / 0.5))
        share = bins / steps / 2  # a step of +-1 bin, each with probability q, has the variance 2 q
        return self._mix(share) if steps == 1 else self._walk(steps, share)

    def _walk(self, steps: int, share: float) -> PoseGrid:
        """Mix `steps` times at once: each slice is moved once, onto the grid."""
        cell, n = self.grid.cell, len(self.p)
        kernel = np.fft.irfft((1 - 2 * share * (1 - np.cos(np.fft.rfftfreq(n) * math.tau))) ** steps, n)
        shares = np.maximum(kernel, 0.0)[(np.arange(n)[:, None] - np.arange(n)) % n].astype(np.float32)
        placed = self.empty()
        for i in self.slices():
            placed[i] = shifted(self.p[i], *(self.offsets[i] / cell))
        return replace(self, p=np.tensordot(shares, placed, 1), offsets=np.zeros_like(self.offsets))

    def _mix(self, share: float) -> PoseGrid:
        """Each slice gives `share` of its mass to either neighbour, moved by the difference of their offsets."""
        cell, n = self.grid.cell, len(self.p)
        out = self.empty()
        active = self.slices()
        bx, by = self.box(active)
        out[active] += (1 - 2 * share) * self.p[active]
        for i in active:
            for j in ((i - 1) % n, (i + 1) % n):
                dx, dy = (self.offsets[i] - self.offsets[j]) / cell
                if abs(dx) + abs(dy) < 1e-9:
                    out[j, bx, by] += share * self.p[i, bx, by]
                else:
                    out[j, bx, by] += share * shifted(self.p[i, bx, by], dx, dy)
        return replace(self, p=out)
