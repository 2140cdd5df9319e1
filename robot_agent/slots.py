"""When a robot speaks where messages are counted, and what it saw meanwhile: one datagram in each of its slots. Pure.

Slots are of team time, so all robots of a team speak in the same ticks. A joint then holds a sighting against where both ends were.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.gaussian.relation import NEAREST, triangle, upper
from blackboard.opinion.gaussian.vehicle import AXES, turned_by, wrap
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import PackedEvidence, PackedRelative, Seen
from robot_agent.short import single
from robot_agent.sightings import fresh_error
from robot_agent.told_way import Shift, ToldWay

DATAGRAM = 1200  # bytes of a message at most, its key included: a packet of UDP on any network
MOST = 24  # sightings that wait to be told
EARLY = 1e-6  # of a slot: a tick that ends as it begins must not miss it by rounding


@dataclass(frozen=True)
class HeldSighting:
    """A sighting that waits, and when it was taken (team time, s)."""

    time: float
    seen: PackedRelative | Seen

    @property
    def what(self) -> tuple[str, str, str]:
        """What can be averaged has the same of this: the subject, the kind, and with what it shares errors."""
        return self.seen.subject, "" if isinstance(self.seen, PackedRelative) else self.seen.kind, self.seen.group


@dataclass
class Slots:
    """Mutable. In each tick either `wait`, or once it is `due` `told` and then `said`."""

    pace: float  # messages a second of team time
    _last: int | None = None
    _epoch: int = -1
    _waiting: list[HeldSighting] = field(default_factory=list)  # the newest first

    def due(self, time: float) -> bool:
        """Whether a slot has begun, by a team time (s), in which nothing was said."""
        return self._slot(time) != self._last

    def wait(self, time: float, evidence: PackedEvidence | None) -> None:
        """Nothing is sent in this tick: what it saw is sent in the next slot."""
        self._epoch, self._waiting = (-1, []) if evidence is None else (evidence.epoch, self._gathered(time, evidence))

    def with_means(self, time: float, evidence: PackedEvidence, way: ToldWay) -> PackedEvidence:
        """The evidence of a tick, with the mean of all sightings of a subject since the last slot.

        It tells how the robot came here by its `way`, which has taken this tick.
        """
        alike = _alike(self._gathered(time, evidence))
        profile = [] if any(len(several) > 1 for several in alike) else evidence.profile
        relatives, seen = list[PackedRelative](), list[Seen]()
        for several in alike:
            mean = _mean(several, time, evidence, way, alone=bool(profile))
            if isinstance(mean, Seen):
                seen.append(mean)
            else:
                relatives.append(mean)
        return evidence.model_copy(update={"relatives": relatives, "seen": seen, "profile": profile})

    def said(self, time: float) -> None:
        """Something was said in the slot of a team time (s)."""
        self._last, self._waiting = self._slot(time), []

    def _slot(self, time: float) -> int:
        return math.floor(time * self.pace + EARLY)

    def _gathered(self, time: float, evidence: PackedEvidence) -> list[HeldSighting]:
        """What waits, and what this tick saw. In an epoch that is over it was seen from a place that is no longer believed."""
        before = self._waiting if evidence.epoch == self._epoch else []
        seen: list[PackedRelative | Seen] = [*evidence.relatives, *evidence.seen]
        new = [HeldSighting(time - sighting.age, sighting) for sighting in seen]
        return [*new, *before][:MOST]


def _alike(waiting: Sequence[HeldSighting]) -> list[list[HeldSighting]]:
    """The sightings that are averaged, the newest first.

    Several of one moment are different things, and so may those of a class be (`robot/?`): the newest stay as they are.
    """
    by_kind: dict[tuple[str, str, str], list[HeldSighting]] = {}
    for sighted in waiting:
        by_kind.setdefault(sighted.what, []).append(sighted)
    groups = list[list[HeldSighting]]()
    for several in by_kind.values():
        is_class = several[0].seen.subject.endswith("?")
        if len({sighted.time for sighted in several}) == len(several) and not is_class:
            groups.append(several)
        else:
            groups += [[sighted] for sighted in several if sighted.time == several[0].time]
    return groups


def _mean(
    several: Sequence[HeldSighting], time: float, evidence: PackedEvidence, way: ToldWay, alone: bool
) -> PackedRelative | Seen:
    """The mean of sightings of one subject: where it was at their mean time, from where boards have the robot at that time.

    Their fresh errors are independent, and what lasts is in all of them. `alone`: the profile of the evidence, if it has one, is
    sent too.
    """
    count = len(several)
    age = max(0.0, time - sum(sighted.time for sighted in several) / count)
    shifts = [way.shift(time - sighted.time, age) for sighted in several]
    relatives = [
        (held.seen, shift) for held, shift in zip(several, shifts, strict=True) if isinstance(held.seen, PackedRelative)
    ]
    if not relatives:
        seen = [(held.seen, shift) for held, shift in zip(several, shifts, strict=True) if isinstance(held.seen, Seen)]
        return _mean_of_kind(seen, age)
    newest, shift = relatives[0]
    if count == 1 and not shift:
        return newest.model_copy(update={"age": single(age)})
    x, y = np.mean([shift.moved(_place(relative.range, relative.bearing)) for relative, shift in relatives], axis=0)
    numbers = {"range": math.hypot(x, y), "bearing": math.atan2(y, x), "age": age}
    if not alone:
        away = max(numbers["range"], NEAREST)
        along, across = np.mean([fresh_error(relative, evidence) for relative, _ in relatives], axis=0) / count
        numbers |= {"range_variance": along, "bearing_variance": across / away**2}
    return newest.model_copy(update={name: single(value) for name, value in numbers.items()})


def _mean_of_kind(told: Sequence[tuple[Seen, Shift]], age: float) -> Seen:
    """The mean of sightings of one further kind. A range alone stays as it is, and a bearing alone is turned."""
    newest, count = told[0][0], len(told)
    rows, spreads = list[Array](), list[Array]()
    for seen, shift in told:
        values, spread = np.array(seen.values), triangle(seen.covariance)
        if len(values) > 1:
            frame = np.eye(len(values))
            frame[AXES, AXES] = np.stack(
                [turned_by(np.array(axis), shift.turned) for axis in ((1.0, 0.0), (0.0, 1.0))], axis=1
            )
            spread = frame @ spread @ frame.T
            values[AXES] = shift.moved(values[AXES])
        if seen.kind in ("bearing", "pose"):
            first = newest.values[-1] + told[0][1].turned
            values[-1] = first + wrap(float(values[-1]) + shift.turned - first)
        rows.append(values)
        spreads.append(spread)
    covariance = upper(np.mean(spreads, axis=0) / count)
    changes = {"values": tuple(map(single, np.mean(rows, axis=0))), "covariance": tuple(map(single, covariance))}
    return newest.model_copy(update={**changes, "age": single(age)})


def _place(distance: float, bearing: float) -> Array:
    return distance * np.array([math.cos(bearing), math.sin(bearing)])
