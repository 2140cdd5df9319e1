"""A chain: what one head believes about itself and about objects, from a stream of readings. A value, like a localizer.

A robot runs two: the first-hand chain on its own readings alone, and the informed chain, into which the team's agreed
beliefs are folded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.agreement import bhattacharyya_coefficient
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import chernoff
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Readings, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import Localizer, make
from robot_agent.sensing import Motion, motion

#: Below this Bhattacharyya coefficient a sighting and the tracked belief are about two places, and both are kept.
CONTRADICTION = 0.01

#: Weights of the robot's own belief that are tried where an uncertain landmark may hold its own evidence.
SPLITS = (0.95, 0.8, 0.5, 0.2)

#: A mate whose agreed position is less certain than this many cells (one standard deviation) is no landmark.
VAGUE = 10.0


@dataclass(frozen=True, eq=False)
class Mate:
    """Where the team agrees that a mate is, as a landmark: mean (unit), covariance (unit ** 2), whose information it holds."""

    mean: np.ndarray
    covariance: np.ndarray
    ancestors: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Chain:
    """A robot's beliefs after some readings."""

    settings: RobotSection
    grid: Grid
    robot: str
    localizer: Localizer
    objects: dict[str, Belief] = field(default_factory=dict)
    seen: dict[str, Belief] = field(default_factory=dict)  # mates, only where sighted in this tick
    ancestors: dict[str, float] = field(default_factory=dict)
    owed: float = 0.0  # unit ** 2 of the objects' motion, not yet blurred

    @classmethod
    def begin(cls, settings: RobotSection, grid: Grid, robot: str) -> Chain:
        return cls(settings, grid, robot, make(settings, grid))

    def advance(self, readings: Readings, mates: Mapping[str, Mate] | None = None) -> Chain:
        """Predict with the odometry, update with the readings, project what was seen; `mates` serve as landmarks."""
        moved = None if readings.odometry is None else motion(readings.odometry, self.settings.odometry)
        localizer = self._predicted(readings, moved)
        if readings.fix is not None:
            localizer = localizer.fixed(readings.fix)
        known = np.zeros((2, 2))
        for sighting in readings.sightings:
            if sighting.landmark is not None:
                localizer = localizer.saw(sighting, moved, np.array(sighting.landmark), known)
        after = replace(
            self,
            localizer=localizer,
            ancestors={**self.ancestors, self.robot: readings.time},
            seen={},
        )
        return after._learned(readings, moved, mates or {})._looked(readings, moved)

    def folded(self, agreed: Belief, reported: Belief | None, ancestors: Mapping[str, float]) -> Chain:
        """Take the team's agreed belief about this robot back; `reported` is what it had told the team."""
        merged = {**self.ancestors}
        for name, until in ancestors.items():
            merged[name] = max(until, merged.get(name, until))
        before = reported or self.localizer.marginal()
        return replace(self, localizer=self.localizer.fold(agreed, before), ancestors=merged)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _predicted(self, readings: Readings, moved: Motion | None) -> Localizer:
        if moved is None:
            moved = Motion(0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        return self.localizer.predict(moved, readings.compass)

    def _learned(self, readings: Readings, moved: Motion | None, mates: Mapping[str, Mate]) -> Chain:
        """A seen mate of agreed position tells where the robot itself is."""
        chain = self
        for sighting in newest(readings.sightings):
            mate = mates.get(sighting.subject)
            if mate is None or math.sqrt(np.trace(mate.covariance)) > VAGUE * self.grid.cell:
                continue
            if set(mate.ancestors).isdisjoint(chain.ancestors):
                localizer = chain.localizer.saw(sighting, moved, mate.mean, mate.covariance)
            else:
                localizer = chain._split(sighting, moved, mate)
            ancestors = {**mate.ancestors, **chain.ancestors}
            chain = replace(chain, localizer=localizer, ancestors=ancestors)
        return chain

    def _split(self, sighting: Sighting, moved: Motion | None, mate: Mate) -> Localizer:
        """Split covariance intersection (Julier & Uhlmann) with the least entropy.

        The robot's belief counts to the power w and the mate's covariance is divided by 1 - w: right whatever they have in
        common. The noise of the sighting itself is new and counts in full.
        """
        options = [self.localizer]
        for w in SPLITS:
            options.append(self.localizer.tempered(w).saw(sighting, moved, mate.mean, mate.covariance / (1 - w)))
        return min(options, key=lambda option: option.entropy())

    def _looked(self, readings: Readings, moved: Motion | None) -> Chain:
        """Objects drift; what was seen is projected through the robot's own pose."""
        chain = self._drifted(moved.dt if moved is not None else 0.0)
        objects, seen = dict(chain.objects), {}
        for sighting in newest(readings.sightings):
            if sighting.landmark is not None or sighting.subject == f"robot/{self.robot}":
                continue
            belief = chain.localizer.project(sighting, moved)
            if sighting.subject.startswith("robot/"):
                seen[sighting.subject] = belief
            else:
                objects[sighting.subject] = combined(objects.get(sighting.subject), belief, self.settings.objects.fresh)
        return replace(chain, objects=objects, seen=seen)

    def _drifted(self, dt: float) -> Chain:
        owed = self.owed + self.settings.objects.drift**2 * dt
        cell = self.grid.cell
        if owed <= (cell / 3) ** 2:
            return replace(self, owed=owed)
        most = self.settings.objects.forget * math.log(self.grid.size)
        spread = {s: Belief(self.grid, blur(b.p, math.sqrt(owed) / cell)) for s, b in self.objects.items()}
        return replace(self, objects={s: b for s, b in spread.items() if entropy(b.p) < most}, owed=0.0)


def newest(sightings: list[Sighting]) -> list[Sighting]:
    """The last sighting of each subject: frames that follow each other share their error."""
    return list({sighting.subject: sighting for sighting in sightings}.values())


def combined(tracked: Belief | None, seen: Belief, fresh: float) -> Belief:
    """A tracked object and a new sighting of it. Both rest on the robot's own pose, so they are not simply multiplied:

    the geometric mean of least entropy; where that would leave the tracked belief as it is, Bayes with the sighting to the
    power `fresh`, the share of it that is new; both hypotheses where they contradict each other.
    """
    if tracked is None:
        return seen
    if bhattacharyya_coefficient(tracked.p, seen.p) < CONTRADICTION:
        return Belief(seen.grid, 0.5 * (tracked.p + seen.p))
    p, kept = chernoff(tracked.p, seen.p)
    if kept == 1.0:
        p = tracked.p * seen.p**fresh
        p = p / p.sum()
    return Belief(seen.grid, p)
