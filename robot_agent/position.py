"""The paper's localizer: a grid over (x, y); the heading is a number, from the compass or from odometry alone.

On a grid of more than `SMALL` cells only a window of cells is worked on. What is left out is at most `FAINT` a cell, 4e-11 of
the mass on 200 x 200 cells. Each of these cells counts as holding `FILL`. It comes in again where evidence raises it above
`FAINT`, so that a robot that is wrong finds itself again. Evidence that meets the share s of a belief makes of what was left
out FAINT / s a cell at most. A belief to a power (`tempered`) is on all cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.belief import Belief, shift_along, uniform
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.evidence import LEAST_MET, LazyLikelihood, gaussian_evidence
from robot_agent.raster import (
    common_floor,
    convolved,
    diffused,
    reach_of,
    resampled,
    sampled,
    squared_distance,
    with_outlier,
)
from robot_agent.sensing import (
    NODES,
    SEEN_TO,
    TickMotion,
    along_and_across,
    displacement,
    displacement_covariance,
    motion_since,
    part_variance,
    place_likelihood,
    position_likelihood,
)
from robot_agent.window import Window, around, bounds, embedded, whole

#: A window of so few cells is not made smaller: finding a smaller one would cost as much as it saves.
SMALL = 4096

#: The mass of a cell below which it may be left out of the window. The Fourier transforms leave 1e-17 at most where nothing is.
FAINT = 1e-15

#: The mass of a cell beside the window before it is taken to a power: about what the Fourier transforms leave where nothing is.
NOISE = 1e-19

#: The mass that a cell beside the window counts as.
FILL = FAINT / 4


@dataclass(frozen=True, eq=False)
class PositionLocalizer:
    """Mass `p` on a window of the team's grid shifted by `offset` (unit).

    Motion moves `p` by whole cells and leaves the remainder in `offset`, because interpolating at every step would blur.
    """

    settings: RobotSection
    grid: Grid
    p: Array  # (nx, ny), of the window whose first cell is `corner`; of the whole grid at first
    corner: tuple[int, int] = (0, 0)
    offset: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0  # radians
    # xx, yy, xy in unit ** 2: motion noise not yet in `p`
    pending_covariance: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def unknown(cls, settings: RobotSection, grid: Grid) -> PositionLocalizer:
        return cls(settings, grid, uniform(grid).p)

    @property
    def window(self) -> Window:
        """The cells of `p`."""
        (x, y), (nx, ny) = self.corner, self.p.shape
        return Window(x, x + nx, y, y + ny)

    def heading_moments(self) -> tuple[float, float]:
        """The heading (radians); its variance is not estimated, and taken for that of any heading."""
        return math.remainder(self.heading, math.tau), math.pi**2 / 3

    def predict(self, motion: TickMotion, compass: float | None) -> PositionLocalizer:
        heading = self.heading + motion.turn if compass is None else compass
        c, s = math.cos(heading), math.sin(heading)
        x, y = self.offset[0] + motion.distance * c, self.offset[1] + motion.distance * s
        cell = self.grid.cell
        steps = round(x / cell), round(y / cell)
        moved = self._trimmed()._moved(steps)
        xx, yy, xy = self.pending_covariance  # R diag(along, across) R^T for each step, R turning by the heading
        pending = (
            xx + motion.along * c * c + motion.across * s * s,
            yy + motion.along * s * s + motion.across * c * c,
            xy + (motion.along - motion.across) * c * s,
        )
        offset = x - steps[0] * cell, y - steps[1] * cell
        after = replace(moved, offset=offset, heading=heading, pending_covariance=pending)
        # a smaller blur hardly moves mass between cells: it is added to the next
        return after if max(pending[:2]) <= (cell / 3) ** 2 else after._spread()

    def update_with_fix(self, fix: Fix) -> PositionLocalizer:
        variance = fix.sigma**2 + self.grid.cell**2 / 12  # that of a uniform place within the cell

        def likelihood(window: Window) -> Array:
            x, y = self._centres(window)
            # ln N((x, y); fix, variance I)
            logs = -0.5 * ((x - fix.position[0]) ** 2 + (y - fix.position[1]) ** 2) / variance
            return np.asarray(np.exp(logs))

        turned = self if fix.heading is None else replace(self, heading=fix.heading)
        mean = self._on_grid(*fix.position)
        return turned._update(gaussian_evidence(likelihood, self.grid, mean, np.eye(2) * variance))

    def update_with_sighting(
        self, sighting: Sighting, motion: TickMotion | None, place: Array, covariance: Array
    ) -> PositionLocalizer:
        vision, seen = self.settings.vision, displacement(sighting, motion, self.heading)
        misread = math.exp(-vision.misread)
        if vision.kind != "position":
            noise = self._noise(sighting) + covariance

            def likelihood(window: Window) -> Array:
                x, y = self._centres(window)
                dx, dy = place[0] - x, place[1] - y
                return np.asarray(np.exp(-0.5 * squared_distance(dx - seen[0], dy - seen[1], noise)))

            mean = self._on_grid(place[0] - seen[0], place[1] - seen[1])
            return self._update(gaussian_evidence(likelihood, self.grid, mean, noise, misread))

        def seen_from(window: Window) -> Array:
            x, y = self._centres(window)
            return place_likelihood(place[0] - x, place[1] - y, seen, covariance, vision)

        # nothing is seen from further away, at no node of the place's uncertainty
        reach = SEEN_TO + float(NODES[0].max()) * math.sqrt(np.trace(covariance))
        near = around(self.grid, self._on_grid(*place), (reach, reach))
        return self._update(LazyLikelihood(seen_from, near, near, misread))

    def update_with_part(
        self, seen: Seen, motion: TickMotion | None, place: Array, covariance: Array
    ) -> PositionLocalizer:
        driven, turned = motion_since(seen, motion)
        c, s = math.cos(self.heading), math.sin(self.heading)
        variance, there = part_variance(seen, self.settings), covariance + np.eye(2) * self.grid.cell**2 / 12

        def likelihood(window: Window) -> Array:
            x, y = self._centres(window)
            dx, dy = place[0] - x + driven * c, place[1] - y + driven * s
            distance = np.maximum(np.hypot(dx, dy), self.grid.cell / 2)
            along, across = along_and_across(dx / distance, dy / distance, there)
            if seen.kind == "range":
                off, spread = seen.values[0] - distance, variance + along
            else:
                off = wrap(np.arctan2(dy, dx) - (self.heading - turned) - seen.values[0])
                spread = variance + across / distance**2
            return np.asarray(np.exp(-0.5 * off**2 / spread) / np.sqrt(spread))

        everywhere = whole(self.grid.shape)  # a ring, or a ray, has no box that is smaller by much
        return self._update(LazyLikelihood(likelihood, everywhere, everywhere, math.exp(-self.settings.vision.misread)))

    def tempered(self, power: float) -> PositionLocalizer:
        # a power raises what is beside the window most, and by it a robot that was carried away finds itself again
        p = embedded(self.p, self.window, whole(self.grid.shape), NOISE) ** power
        return replace(self, p=p / p.sum(), corner=(0, 0))

    def entropy(self) -> float:
        return entropy_of(self.p)

    def marginal(self) -> Belief:
        spread = self._spread() if any(self.pending_covariance) else self
        spread = spread._over(spread.window.grown(2, self.grid.shape))  # so far `resampled` moves mass
        p = resampled(spread.p, self.offset[0] / self.grid.cell, self.offset[1] / self.grid.cell)
        total = p.sum() + FILL * (self.grid.size - p.size)
        return Belief(self.grid, embedded(p / total, spread.window, whole(self.grid.shape), FILL / total))

    def fold(self, agreed: Belief, reported: Belief) -> PositionLocalizer:
        floor = common_floor(agreed, reported)
        if floor is None:
            return replace(self, p=agreed.p, corner=(0, 0), offset=(0.0, 0.0), pending_covariance=(0.0, 0.0, 0.0))
        cell = self.grid.cell

        def ratio(window: Window) -> Array:
            """Jeffrey's rule, with agreed / reported read where the cells of `p` stand."""
            wide = window.grown(1, self.grid.shape)  # what is read between cells needs the next ones
            logs = np.log((agreed.p[wide.slices] + floor) / (reported.p[wide.slices] + floor))
            read = sampled(logs, self.offset[0] / cell, self.offset[1] / cell)
            return np.asarray(np.exp(read[window.within(wide)]))

        everywhere = whole(self.grid.shape)
        likelier = everywhere if self.window == everywhere else bounds(agreed.p > floor).grown(1, self.grid.shape)
        return self._update(LazyLikelihood(ratio, everywhere, likelier))

    def project(self, sighting: Sighting, motion: TickMotion | None) -> Belief:
        """The belief convolved with the likelihood of each displacement from robot to subject (exact, by FFT)."""
        cell, vision = self.grid.cell, self.settings.vision
        sees = SEEN_TO if vision.kind == "position" else math.inf
        steps = []  # whole cells from the robot to the subject, which is in sight and on the grid
        for n, corner, held in zip(self.grid.shape, self.corner, self.p.shape, strict=True):
            reach = int(min(n - 1, sees // cell + 1))
            steps.append(np.arange(max(-reach, 1 - corner - held), min(reach, n - 1 - corner) + 1))
        dx, dy = steps[0][:, None] * cell - self.offset[0], steps[1][None, :] * cell - self.offset[1]
        seen = displacement(sighting, motion, self.heading)
        if vision.kind == "position":
            kernel = position_likelihood(dx, dy, seen, vision)
        else:
            kernel = np.exp(-0.5 * squared_distance(dx - seen[0], dy - seen[1], self._noise(sighting)))
        first = self.corner[0] + steps[0][0], self.corner[1] + steps[1][0]
        return with_outlier(convolved(self.p, kernel, first, self.grid.shape), self.grid, vision.outlier)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _trimmed(self) -> PositionLocalizer:
        """Without the outer rows and columns that hold no more than FAINT a cell."""
        if self.p.size <= SMALL:
            return self
        inner = bounds(self.p > FAINT)
        return replace(self, p=self.p[inner.slices], corner=(self.corner[0] + inner.x0, self.corner[1] + inner.y0))

    def _over(self, window: Window) -> PositionLocalizer:
        """The same belief on a larger window."""
        if window == self.window:
            return self
        return replace(self, p=embedded(self.p, self.window, window, FILL), corner=(window.x0, window.y0))

    def _moved(self, steps: tuple[int, int]) -> PositionLocalizer:
        """Moved by whole cells: the window as far as the grid goes, and the mass within the window by the rest."""
        if steps == (0, 0):
            return self
        p, corner = self.p, [0, 0]
        for axis, by in enumerate(steps):
            target = self.corner[axis] + by
            corner[axis] = max(0, min(target, self.grid.shape[axis] - p.shape[axis]))
            p = shift_along(p, target - corner[axis], axis)
        return replace(self, p=p, corner=(corner[0], corner[1]))

    def _spread(self) -> PositionLocalizer:
        """The same belief with the pending motion noise blurred into `p`."""
        xx, yy, xy = (v / self.grid.cell**2 for v in self.pending_covariance)
        reach, (nx, ny) = reach_of(max(xx, yy)), self.grid.shape
        window = self.window.grown(reach, self.grid.shape)
        walls = (window.x0 == 0, window.x1 == nx), (window.y0 == 0, window.y1 == ny)
        p = embedded(self.p, self.window, window, FILL)
        p = diffused(p, np.array([[xx, xy], [xy, yy]]), walls)
        return replace(self, p=p, corner=(window.x0, window.y0), pending_covariance=(0.0, 0.0, 0.0))

    def _centres(self, window: Window) -> tuple[Array, Array]:
        (x, y), (bx, by) = self.grid.mesh(), window.slices
        return x[bx] + self.offset[0], y[:, by] + self.offset[1]

    def _on_grid(self, x: float, y: float) -> tuple[float, float]:
        """Where a place (unit) lies on the team's grid without its offset."""
        return float(x) - self.offset[0], float(y) - self.offset[1]

    def _noise(self, sighting: Sighting) -> Array:
        """Covariance of the measured displacement between cells, shape (2, 2), world axes (unit ** 2)."""
        spread = displacement_covariance(sighting, self.heading, self.settings.vision)
        return spread + np.eye(2) * self.grid.cell**2 / 12

    def _update(self, evidence: LazyLikelihood) -> PositionLocalizer:
        """Bayes' rule; a likelihood that is nowhere where `p` has mass replaces `p`."""
        window, peak = self.window, evidence.peak
        near = evidence.support.meet(window)
        there = evidence.of(near)
        top = float((there if window.holds(peak) else evidence.of(peak)).max(initial=0.0))
        likelihood = np.full(self.p.shape, evidence.floor * top)
        likelihood[near.within(window)] += there
        p = self.p * likelihood  # Bayes' rule, normalised below
        total = p.sum()
        if top * FILL > total * FAINT and not window.holds(peak):  # cells beside the window rise above FAINT
            return self._over(window.hull(peak))._update(evidence)
        if total <= LEAST_MET * (top + evidence.floor * top):
            p, window = evidence.of(whole(self.grid.shape)) + evidence.floor * top, whole(self.grid.shape)
            total = p.sum()
        return replace(self, p=p / total, corner=(window.x0, window.y0)) if total > 0 else self
