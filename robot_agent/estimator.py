"""An estimator: a robot's beliefs about its own pose and about objects, from a stream of readings. A value, like a localizer.

A robot runs two: the first-hand estimator on its own readings alone, and the informed estimator, into which the team's agreed
beliefs are folded.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.errors import UserError
from blackboard.opinion.agreement import bhattacharyya_coefficient
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.classes import is_class
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.pools import chernoff
from blackboard.opinion.weights import entropy_of
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Readings, Sighting
from blackboard.wire.types import capped
from robot_agent.config import RobotSection
from robot_agent.localizer import Localizer, TakesParts
from robot_agent.localizers import localizer_factory
from robot_agent.sensing import PARTS, TickMotion, motion, still
from robot_agent.untold import ALL_TOLD, Untold

#: Below this Bhattacharyya coefficient a sighting contradicts the tracked belief, and both hypotheses are kept.
CONTRADICTION = 0.01

#: Weights w that split covariance intersection tries, besides 1 (the sighting is not used).
SPLIT_WEIGHTS = (0.95, 0.8, 0.5, 0.2)

#: A team-mate whose agreed position has a larger standard deviation than this (cells, both axes together) is no landmark.
VAGUE = 10.0

#: Seconds for which the error of a mate's place stays the same. All ranges or bearings of it within them have one error in
#: common, so each takes the mate's covariance times their number.
LASTING = 5.0


@dataclass(frozen=True, eq=False)
class Mate:
    """A team-mate's agreed position, to be used as an uncertain landmark."""

    mean: Array  # (2,), unit
    covariance: Array  # (2, 2), unit ** 2
    ancestors: Mapping[str, float]  # whose information it contains, until when (seconds)


@dataclass(frozen=True, eq=False)
class Estimator:
    """A robot's beliefs after some readings."""

    settings: RobotSection
    grid: Grid
    robot: str
    localizer: Localizer
    untold: Untold = ALL_TOLD  # its unmeasured motion
    moved: TickMotion | None = None  # in the tick of the newest readings
    objects: dict[str, Belief] = field(default_factory=dict)
    seen: dict[str, Belief] = field(default_factory=dict)  # mates, only where sighted in this tick
    ancestors: dict[str, float] = field(default_factory=dict)
    #: Mate -> team time (s) of the last range or bearing alone by which it served as a landmark.
    parts: dict[str, float] = field(default_factory=dict)
    pending_variance: float = 0.0  # unit ** 2: the objects' motion by which their beliefs are not yet blurred

    @classmethod
    def begin(cls, settings: RobotSection, grid: Grid, robot: str, untold: Untold = ALL_TOLD) -> Estimator:
        """An estimator without any reading yet; `untold` is its unmeasured motion before.

        UserError: the settings name no localizer, or one that is none.
        """
        localizer = localizer_factory(settings.localizer)(settings, grid)
        if not isinstance(localizer, Localizer):
            raise UserError(
                f"robot.localizer: {settings.localizer!r} makes a {type(localizer).__name__}, which has not all methods of "
                "robot_agent.localizer.Localizer; add them"
            )
        return cls(settings, grid, robot, localizer, untold)

    def advance(self, readings: Readings, mates: Mapping[str, Mate] | None = None) -> Estimator:
        """Predict with the odometry, update with the readings, project what was seen; `mates` (by subject) serve as landmarks."""
        told, untold = readings.odometry, self.untold.after(readings)
        moved = None if told is None else motion(told, self.settings.odometry, untold.lapse)
        localizer = self.localizer.predict(moved or still(untold), readings.compass)
        if readings.fix is not None:
            localizer = localizer.update_with_fix(readings.fix)
        exact = np.zeros((2, 2))
        everything: list[Sighting | Seen] = [*readings.sightings, *readings.seen]
        for sighting in everything:
            if sighting.landmark is not None:
                localizer = _updated(localizer, sighting, moved, np.array(sighting.landmark), exact)
        after = replace(
            self,
            localizer=localizer,
            untold=untold,
            moved=moved,
            ancestors={**self.ancestors, self.robot: readings.time},
            seen={},
        )
        return after._update_with_mates(readings, moved, mates or {})._track(readings, moved)

    def beliefs(self) -> dict[str, Belief]:
        """All that is believed about somebody's place on the team's grid, by subject."""
        return {f"robot/{self.robot}": self.localizer.marginal(), **self.objects, **self.seen}

    def place(self, sighting: Sighting) -> Belief:
        """Where something is that was seen in the newest readings."""
        return self.localizer.project(sighting, self.moved)

    def folded(self, agreed: Belief, reported: Belief | None, ancestors: Mapping[str, float]) -> Estimator:
        """Fold the team's agreed belief about this robot back; `reported` is what the robot reported, None if nothing.

        `ancestors` says whose information the agreed belief contains, until when (seconds).
        """
        merged = {**self.ancestors}
        for name, until in ancestors.items():
            merged[name] = max(until, merged.get(name, until))
        localizer = self.localizer.fold(agreed, reported or self.localizer.marginal())
        return replace(self, localizer=localizer, ancestors=capped(merged, lambda: {self.robot}))

    # --- inside -------------------------------------------------------------------------------------------------------

    def _update_with_mates(self, readings: Readings, moved: TickMotion | None, mates: Mapping[str, Mate]) -> Estimator:
        """Use each team-mate that was seen, and whose agreed position is not vague, as an uncertain landmark."""
        estimator = self
        sightings: list[Sighting | Seen] = [*newest(readings.sightings), *_parts_of(readings, mates)]
        for sighting in sightings:
            mate = mates.get(sighting.subject)
            if mate is None or math.sqrt(np.trace(mate.covariance)) > VAGUE * self.grid.cell:
                continue
            by_part = isinstance(sighting, Seen)
            if set(mate.ancestors).isdisjoint(estimator.ancestors):
                localizer = _updated(estimator.localizer, sighting, moved, mate.mean, mate.covariance)
            elif by_part and self.robot not in mate.ancestors:
                apart = max(readings.time - self.parts.get(sighting.subject, -math.inf), 1e-9)
                lasting = max(1.0, LASTING / apart) * mate.covariance
                localizer = _updated(estimator.localizer, sighting, moved, mate.mean, lasting)
            else:
                localizer = estimator._intersected(sighting, moved, mate)
            ancestors = capped({**mate.ancestors, **estimator.ancestors}, lambda: {self.robot})
            parts = {**estimator.parts, sighting.subject: readings.time} if by_part else estimator.parts
            estimator = replace(estimator, localizer=localizer, ancestors=ancestors, parts=parts)
        return estimator

    def _intersected(self, sighting: Sighting | Seen, moved: TickMotion | None, mate: Mate) -> Localizer:
        """Split covariance intersection (Julier & Uhlmann) with the w of least entropy.

        P(own)^w P(sighting; mate's covariance / (1 - w)): conservative whatever evidence the two have in common. The
        sighting's own noise is independent of both and is not divided. w = 1 leaves the sighting out.
        """
        options = [self.localizer]
        for w in SPLIT_WEIGHTS:
            discounted = mate.covariance / (1 - w)  # P(own)^w P(sighting; mate's covariance / (1 - w))
            options.append(_updated(self.localizer.tempered(w), sighting, moved, mate.mean, discounted))
        return min(options, key=lambda option: option.entropy())

    def _track(self, readings: Readings, moved: TickMotion | None) -> Estimator:
        """Move the objects by their motion model, then update with what was seen through the robot's own pose."""
        estimator = self._drift(moved.dt if moved is not None else 0.0)
        objects, seen = dict(estimator.objects), {}
        for sighting in newest(readings.sightings):
            if sighting.landmark is not None or sighting.subject == f"robot/{self.robot}":
                continue
            belief = estimator.localizer.project(sighting, moved)
            if sighting.subject.startswith("robot/"):
                seen[sighting.subject] = belief
            else:
                objects[sighting.subject] = combined(objects.get(sighting.subject), belief, self.settings.objects.fresh)
        return replace(estimator, objects=objects, seen=seen)

    def _drift(self, dt: float) -> Estimator:
        """The objects' random walk of `dt` seconds; beliefs that became nearly uniform are dropped."""
        variance = self.pending_variance + self.settings.objects.drift**2 * dt
        cell = self.grid.cell
        if variance <= (cell / 3) ** 2:  # a smaller blur hardly moves mass between cells: it is added to the next one
            return replace(self, pending_variance=variance)
        most = self.settings.objects.forget * math.log(self.grid.size)
        blurred = {s: Belief(self.grid, blur(b.p, math.sqrt(variance) / cell)) for s, b in self.objects.items()}
        return replace(self, objects={s: b for s, b in blurred.items() if entropy_of(b.p) < most}, pending_variance=0.0)


def newest(sightings: list[Sighting]) -> list[Sighting]:
    """The last sighting of each subject that is named: frames that follow each other share their error."""
    return list({sighting.subject: sighting for sighting in sightings if not is_class(sighting.subject)}.values())


def _parts_of(readings: Readings, mates: Collection[str]) -> list[Seen]:
    """The last range alone, and the last bearing alone, of each of some mates."""
    parts = [seen for seen in readings.seen if seen.kind in PARTS and seen.subject in mates]
    return list({(seen.subject, seen.kind): seen for seen in parts}.values())


def _updated(
    localizer: Localizer, sighting: Sighting | Seen, moved: TickMotion | None, place: Array, covariance: Array
) -> Localizer:
    """Bayes with a sighting of any kind; what a localizer does not take changes nothing."""
    if isinstance(sighting, Sighting):
        return localizer.update_with_sighting(sighting, moved, place, covariance)
    if sighting.kind in PARTS and isinstance(localizer, TakesParts):
        return localizer.update_with_part(sighting, moved, place, covariance)
    return localizer


def combined(tracked: Belief | None, seen: Belief, fresh: float) -> Belief:
    """A tracked object's belief after a new sighting of it.

    Both rest on the robot's own pose, so they are not simply multiplied. Where they contradict each other, both hypotheses are
    kept (linear pool). Otherwise it is the Chernoff pool, tracked^w seen^(1 - w) with the w of least entropy. Where that is w =
    1, it is tracked * seen^fresh, because the share `fresh` of the sighting is new.
    """
    if tracked is None:
        return seen
    if bhattacharyya_coefficient(tracked.p, seen.p) < CONTRADICTION:
        return Belief(seen.grid, 0.5 * (tracked.p + seen.p))
    p, w = chernoff(tracked.p, seen.p)
    if w == 1.0:
        p = tracked.p * seen.p**fresh  # P(tracked) P(seen)^fresh
        p = p / p.sum()
    return Belief(seen.grid, p)
