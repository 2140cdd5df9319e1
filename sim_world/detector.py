"""What a detector makes of what the sensors see: [world.detector] of a scenario. Random numbers are an argument. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np

from blackboard.config.world import DetectorSection, WorldVisionSection
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Readings, Sighting, Truth
from blackboard.wire.types import MAX_OPINIONS
from sim_world.sensor_source import Changed
from sim_world.sensors import FAR, NEAR
from sim_world.world import Place, Streams

S = TypeVar("S", Sighting, Seen)

NOTHING = ""  # who is seen where nobody is


@dataclass
class Detected(Changed):
    """A `SensorSource` whose sightings went through each robot's detector; the truth says who the unnamed ones show.

    Each robot has random streams of its own, so one more changes nothing about the others.
    """

    settings: DetectorSection
    vision: WorldVisionSection
    streams: Streams

    def __post_init__(self) -> None:
        self._noise = cache(self.streams)  # goes on where it was left

    def advance(self, run: str, tick: int) -> tuple[Truth, list[Readings]]:
        truth, readings = self.source.advance(run, tick)
        told = [self._detected(given, truth) for given in readings]
        unnamed = {given.robot: shown for given, shown in told if shown}
        return truth.model_copy(update={"unnamed": unnamed}), [given for given, _ in told]

    def _detected(self, readings: Readings, truth: Truth) -> tuple[Readings, list[str]]:
        """The readings of a robot as its detector gives them, and whom its unnamed sightings show, in their order."""
        sightings = [sighting for sighting in readings.sightings if self._is_detected(readings.robot, sighting, truth)]
        seen = [sighting for sighting in readings.seen if self._is_detected(readings.robot, sighting, truth)]
        sightings = self._exchanged(readings.robot, sightings)
        named = [sighting for sighting in sightings if not self._is_unnamed(sighting.subject)]
        others = [(sighting.subject, sighting) for sighting in sightings if self._is_unnamed(sighting.subject)]
        others += [(NOTHING, sighting) for sighting in self._clutter(readings.robot, truth)]
        # The order that things have in the world would tell who they are.
        others = sorted(others, key=lambda pair: (-pair[1].age, pair[1].bearing, pair[1].range))[
            : MAX_OPINIONS - len(named)
        ]
        further = sorted(
            (sighting for sighting in seen if self._is_unnamed(sighting.subject)),
            key=lambda sighting: (-sighting.age, sighting.values),
        )
        unnamed, unnamed_seen = [_without_name(sighting) for _, sighting in others], [*map(_without_name, further)]
        kept = [sighting for sighting in seen if not self._is_unnamed(sighting.subject)]
        told = readings.model_copy(update={"sightings": [*named, *unnamed], "seen": [*kept, *unnamed_seen]})
        return told, [*(who for who, _ in others), *(sighting.subject for sighting in further)]

    def _is_unnamed(self, subject: str) -> bool:
        return kind_of(subject) in self.settings.anonymous

    def _is_detected(self, robot: str, sighting: Sighting | Seen, truth: Truth) -> bool:
        if kind_of(sighting.subject) == "landmark":
            return True
        if self.settings.missed and self._noise(f"{robot} misses {sighting.subject}").random() < self.settings.missed:
            return False
        return not (self.settings.body and is_hidden(f"robot/{robot}", sighting.subject, truth, self.settings.body))

    def _exchanged(self, robot: str, sightings: list[Sighting]) -> list[Sighting]:
        """The sightings, in which two mates may have each other's names."""
        mates = [
            i
            for i, sighting in enumerate(sightings)
            if kind_of(sighting.subject) == "robot" and not self._is_unnamed(sighting.subject)
        ]
        if not self.settings.exchanged or len({sightings[i].subject for i in mates}) < 2:
            return sightings
        noise = self._noise(f"{robot} exchanges")
        if noise.random() >= self.settings.exchanged:
            return sightings
        names = sorted({sightings[i].subject for i in mates})
        one, other = (names[i] for i in noise.choice(len(names), 2, replace=False))
        instead = {one: other, other: one}
        return [
            sighting.model_copy(update={"subject": instead.get(sighting.subject, sighting.subject)})
            for sighting in sightings
        ]

    def _clutter(self, robot: str, truth: Truth) -> list[Sighting]:
        """Sightings of nothing, uniform in the field of the camera."""
        if not self.settings.clutter:
            return []
        noise = self._noise(f"{robot} clutter")
        classes = {f"{kind}/?" for kind in self.settings.anonymous if kind != "object"}
        there = sorted(classes | {class_of(subject) for subject in truth.positions if self._is_unnamed(subject)})
        clutter = []
        for _ in range(int(noise.poisson(self.settings.clutter)) if there else 0):
            distance = math.sqrt(noise.uniform(NEAR**2, FAR**2))
            bearing = noise.uniform(-self.vision.half_angle, self.vision.half_angle)
            clutter.append(Sighting(subject=str(noise.choice(there)), range=distance, bearing=bearing))
        return clutter


def _without_name(sighting: S) -> S:
    """A sighting that says only of which class its subject is."""
    return sighting.model_copy(update={"subject": class_of(sighting.subject), "landmark": None})


def kind_of(subject: str) -> str:
    return subject.partition("/")[0]


def class_of(subject: str) -> str:
    """The class that a detector gives to a thing without a name: of an object its name without a number at the end."""
    kind, _, name = subject.partition("/")
    return f"{kind}/{name.rstrip('0123456789?') if kind == 'object' else ''}?"


def is_hidden(observer: str, subject: str, truth: Truth, radius: float) -> bool:
    """Whether the body of another robot or person, a disc of some radius (unit), is between the two."""
    places = truth.positions
    if observer not in places or subject not in places:
        return False
    others = [s for s in places if kind_of(s) in ("robot", "person") and s not in (observer, subject)]
    return any(is_between(places[observer], places[subject], places[other], radius) for other in others)


def is_between(start: Place, end: Place, middle: Place, radius: float) -> bool:
    """Whether the way from `start` to `end` meets the disc around `middle`, whose centre is neither before nor behind it."""
    way, off = np.subtract(end, start), np.subtract(middle, start)
    length = math.hypot(*way)
    along = float(way @ off) / length if length else 0.0
    return 0.0 < along < length and math.hypot(*off) ** 2 - along**2 < radius**2
