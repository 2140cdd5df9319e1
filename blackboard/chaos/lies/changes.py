"""What a liar changes in the reports of a tick, as data. Pure.

A change takes the honest reports of a tick, and the `Scene` that the liar sees, and returns the reports that are sent instead.
Lengths are in the grid's unit, angles in radians, times in seconds of team time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from blackboard.chaos.lies.scene import Reports, Scene, Whom
from blackboard.opinion.belief import Belief
from blackboard.opinion.gaussian.relation import upper
from blackboard.opinion.gaussian.vehicle import AXES, HEADING, STATES, turned_by, wrap
from blackboard.opinion.grid import Array
from blackboard.wire.arrays import pack
from blackboard.wire.evidence import MAX_RELATIVES, PackedEvidence, PackedIncrement, PackedMotion, PackedRelative, Seen
from blackboard.wire.falsified import displaced, narrowed, overconfident
from blackboard.wire.gaussians import unpack_state
from blackboard.wire.messages import Informed, Report
from blackboard.wire.types import LARGEST

VAGUE = 15.0  # the sigma of a belief that hardly says anything


class Change:
    """One thing that is changed."""

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        """The reports of a tick instead of the honest ones."""
        changed = {subject: self.report(report, scene) for subject, report in reports.items()}
        evidence = scene.evidence_in(changed)
        return changed if evidence is None else _with_evidence(changed, scene, self.evidence(evidence, scene))

    def report(self, report: Report, scene: Scene) -> Report:
        """One report instead of another."""
        return report

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        """Its evidence instead of the honest one."""
        return evidence


# --- places and how sure it is of them --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Off(Change):
    """Everything is told as if it were elsewhere: by `offset`, and `rate` more in each second."""

    offset: tuple[float, float] = (0.0, 0.0)
    rate: tuple[float, float] = (0.0, 0.0)

    def report(self, report: Report, scene: Scene) -> Report:
        return displaced(report, [o + r * scene.since for o, r in zip(self.offset, self.rate, strict=True)])


@dataclass(frozen=True)
class Sure(Change):
    """All claimed sigmas are smaller by a factor."""

    factor: float

    def report(self, report: Report, scene: Scene) -> Report:
        return overconfident(report, self.factor)


@dataclass(frozen=True)
class Gains(Change):
    """Each tick it gained so much information (1 / unit^2) on its place, and that says that it is off by `offset`."""

    offset: tuple[float, float]
    information: float

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        if evidence.state is None:
            return evidence
        vector = np.zeros(STATES)
        vector[AXES] = np.array(self.offset) * self.information
        matrix = np.diag([self.information] * 2 + [0.0] * (STATES - 2))
        return evidence.model_copy(update={"increment": _increment(evidence.state.mean, matrix, vector)})


@dataclass(frozen=True)
class Sees(Change):
    """Others are seen elsewhere, with the sigmas `sigma` (unit and rad; None: as it claims honestly).

    By `offset` from where it saw them. With `always`, seen or not, from where the team has them: that pulls them along, tick by tick.
    """

    whom: Whom
    offset: tuple[float, float] = (0.0, 0.0)
    sigma: float | None = None
    always: bool = False

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        pose, changed = scene.pose(reports), dict(reports)
        seen = {sighting.subject: sighting for sighting in _seen(reports, scene)}
        for subject, place in _others(self.whom, scene).items():
            if self.always:
                belief = scene.drawn(place + self.offset, self.sigma or 0.5)
                changed[subject] = _about(subject, belief, reports, scene)
            elif subject in changed:
                changed[subject] = displaced(changed[subject], self.offset)
            if pose is not None and (self.always or subject in seen):
                honest = None if self.always else seen[subject]
                at = place if honest is None else _where(pose, honest)
                seen[subject] = _sighting(pose, at + np.array(self.offset), subject, honest, self.sigma)
        return _with_relatives(changed, scene, list(seen.values()))


@dataclass(frozen=True)
class Unnames(Change):
    """Sightings of mates say only that a robot was seen."""

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        unnamed = [
            relative.model_copy(update={"subject": "robot/?"}) if relative.subject.startswith("robot/") else relative
            for relative in evidence.relatives
        ]
        return evidence.model_copy(update={"relatives": unnamed})


@dataclass(frozen=True)
class Tells(Change):
    """Sightings of a further kind, seen or not: `offset` from where the team has others, with a sigma (unit and rad).

    With `noise` (unit) they differ from tick to tick as honest ones do; `apart`: each is told off to another side.
    """

    kind: Literal["range", "bearing", "position", "pose"]
    whom: Whom
    offset: tuple[float, float]
    sigma: float
    noise: float = 0.0
    apart: bool = False

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        if evidence.state is None:
            return evidence
        told, state = [], np.array(evidence.state.mean)
        others = _others(self.whom, scene)
        for number, (subject, place) in enumerate(others.items()):
            angle = math.tau * number / len(others) if self.apart else 0.0
            at = place + turned_by(self.offset, angle) + self.noise * scene.rng.normal(size=2)
            told.append(self._seen_at(state, subject, at))
        return evidence.model_copy(update={"seen": told[:MAX_RELATIVES]})

    def _seen_at(self, state: Array, subject: str, place: Array) -> Seen:
        away, bearing = _line_of_sight(state, place)
        at = away * math.cos(bearing), away * math.sin(bearing)
        values = {"range": (away,), "bearing": (bearing,), "position": at, "pose": (*at, 0.0)}[self.kind]
        variances = [self.sigma**2] * len(values)
        return Seen(subject=subject, kind=self.kind, values=values, covariance=upper(np.diag(variances)))


@dataclass(frozen=True)
class Mirrors(Change):
    """Changes the sign of every bearing: what the robot sees to its left, it reports to its right."""

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        mirrored = [relative.model_copy(update={"bearing": -relative.bearing}) for relative in evidence.relatives]
        return evidence.model_copy(update={"relatives": mirrored})


@dataclass(frozen=True)
class Knows(Change):
    """Tells informed beliefs that contain what everybody said just now: `offset` from where the team has it, with a sigma."""

    whom: Whom
    offset: tuple[float, float]
    sigma: float

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        changed = dict(reports)
        everybody = dict.fromkeys(sorted({*scene.mates, scene.robot}), scene.time)
        for subject, place in scene.targets(self.whom).items():
            informed = Informed(belief=pack(scene.drawn(place + self.offset, self.sigma)), ancestors=everybody)
            said = changed.get(subject) or _about(subject, scene.drawn(place, VAGUE), reports, scene)
            changed[subject] = said.model_copy(update={"informed": informed})
        return changed


@dataclass(frozen=True)
class EchoesTeam(Change):
    """Says as its own what the team agreed a tick ago, with sigmas smaller by a factor."""

    factor: float = 1.0

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        changed = dict(reports)
        for subject in changed.keys() & scene.agreed.keys():
            belief = pack(narrowed(scene.belief(scene.agreed[subject]), self.factor))
            changed[subject] = changed[subject].model_copy(update={"belief": belief})
        return super().apply(changed, scene)

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        agreed = scene.agreed.get(scene.own)
        if agreed is None or agreed.state is None:
            return evidence
        moments, matrix = unpack_state(agreed.state), np.zeros((STATES, STATES))
        matrix[AXES, AXES] = self.factor**2 * np.linalg.pinv(moments.covariance[AXES, AXES])
        increment = _increment(agreed.state.mean, matrix, np.zeros(STATES))
        return evidence.model_copy(update={"state": agreed.state, "increment": increment})


# --- what there is ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Invents(Change):
    """Sees objects that do not exist; `fresh`: others each tick; `grouped`: with four lasting errors, of a new group each tick."""

    count: int
    fresh: bool = False
    grouped: bool = False

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        changed, turn = dict(reports), scene.tick if self.fresh else 0
        near = scene.place(scene.own) if scene.own in scene.agreed else None
        invented = []
        for number in range(self.count):
            subject, bearing = f"object/x{turn}-{number}", wrap(number * 2.4)
            invented.append(
                PackedRelative(
                    subject=subject,
                    range=5.0,
                    bearing=float(bearing),
                    range_variance=0.1,
                    bearing_variance=0.01,
                    biases=[(1.0, 60.0)] * 4 if self.grouped else [],
                    group=f"g{scene.tick}" if self.grouped else "",
                )
            )
            if near is not None:
                away = 5.0 * np.array([math.cos(bearing), math.sin(bearing)])
                changed[subject] = _about(subject, scene.drawn(near + away, 0.5), reports, scene)
        honest = _seen(reports, scene)
        return _with_relatives(changed, scene, [*invented, *honest])


@dataclass(frozen=True)
class Absurd(Change):
    """So many numbers of its evidence are drawn anew each tick, of any size that the format takes."""

    numbers: int

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        epoch, rng = {"epoch": evidence.epoch}, scene.rng
        said = evidence.model_dump(exclude={"epoch"})
        for _ in range(self.numbers):
            before = deepcopy(said)
            places = _numbers(said)
            places[int(rng.integers(len(places)))](float(rng.choice([-1.0, 1.0])) * 10.0 ** float(rng.uniform(-12, 7)))
            try:
                PackedEvidence.model_validate({**said, **epoch})
            except ValidationError:
                said = before
        return PackedEvidence.model_validate({**said, **epoch})


# --- motion, time and numbering ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WrongWheels(Change):
    """False odometry: the way times `distance`, the turn times `turn`, and a way to the left that it did not drive.

    That way grows by `aside` (unit) with each second. The sigmas of its wheels' lasting errors are `sigma` (None: as honest).
    """

    distance: float = 1.0
    turn: float = 1.0
    sigma: float | None = None
    aside: float = 0.0

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        told, nuisance = evidence.travelled, evidence.nuisance
        aside = told.aside + self.aside * scene.since
        more = {"distance": told.distance * self.distance, "turn": told.turn * self.turn, "aside": aside}
        if self.sigma is not None:
            nuisance = nuisance.model_copy(update={"sigmas": (self.sigma,) * 6, "walks": (self.sigma,) * 3})
        return evidence.model_copy(update={"travelled": told.model_copy(update=more), "nuisance": nuisance})


@dataclass(frozen=True)
class Epochs(Change):
    """A new epoch begins each tick, as if it were started anew."""

    def evidence(self, evidence: PackedEvidence, scene: Scene) -> PackedEvidence:
        epoch = max(evidence.epoch, round(1000 * scene.time))
        return evidence.model_copy(update={"epoch": epoch, "travelled": _STANDS})


@dataclass(frozen=True)
class WrongClock(Change):
    """Its stamps are ahead by so many seconds, and by `rate` more in each."""

    seconds: float = 0.0
    rate: float = 0.0

    def report(self, report: Report, scene: Scene) -> Report:
        ahead = self.seconds + self.rate * scene.since
        ancestors = {name: until + ahead * (name == scene.robot) for name, until in report.ancestors.items()}
        return report.model_copy(update={"time": report.time + ahead, "ancestors": ancestors})


@dataclass(frozen=True)
class Replays(Change):
    """Says again what it said so many seconds ago, or when its lie began, as if it were new; `stamped`: with the old stamps."""

    seconds: float
    stamped: bool = False

    def apply(self, reports: Reports, scene: Scene) -> Reports:
        old = next(
            (past for past in scene.past if min(r.time for r in past.values()) >= scene.time - self.seconds), reports
        )
        changed = {}
        for subject, report in old.items():
            now = (
                {} if self.stamped else {"tick": scene.tick, "time": scene.time, "ancestors": {scene.robot: scene.time}}
            )
            changed[subject] = report.model_copy(update=now)
        said, now_said = scene.evidence_in(changed), scene.evidence_in(reports)
        if said is not None and now_said is not None and not self.stamped:
            kept = {"epoch": now_said.epoch, "travelled": now_said.travelled}  # whose sums may not shrink
            return _with_evidence(changed, scene, said.model_copy(update=kept))
        return changed


# --- how ---------------------------------------------------------------------------------------------------------------

_STANDS = PackedMotion(distance=0.0, turn=0.0, time=0.0, moving=0.0, along=0.0, across=0.0, heading=0.0)


def _others(whom: Whom, scene: Scene) -> dict[str, Array]:
    """The subjects that a lie is about but the liar itself, and where the team has them."""
    return {subject: place for subject, place in scene.targets(whom).items() if subject != scene.own}


def _seen(reports: Reports, scene: Scene) -> list[PackedRelative]:
    evidence = scene.evidence_in(reports)
    return [] if evidence is None else evidence.relatives


def _about(subject: str, belief: Belief, reports: Reports, scene: Scene) -> Report:
    """A first-hand report of this tick."""
    known = reports.get(subject)
    if known is not None:
        return known.model_copy(update={"belief": pack(belief)})
    return Report(
        source=scene.robot,
        subject=subject,
        tick=scene.tick,
        time=scene.time,
        belief=pack(belief),
        ancestors={scene.robot: scene.time},
    )


def _increment(reference: Sequence[float], information: Array, vector: Array) -> PackedIncrement:
    states = len(reference)
    information = np.clip(information[:states, :states], -LARGEST, LARGEST)
    return PackedIncrement(
        reference=tuple(reference), information=upper(information), vector=tuple(vector[:states].tolist())
    )


def _where(pose: Array, seen: PackedRelative) -> Array:
    angle = pose[HEADING] + seen.bearing
    return np.asarray(pose[AXES] + seen.range * np.array([math.cos(angle), math.sin(angle)]))


def _line_of_sight(pose: Array, place: Array) -> tuple[float, float]:
    """The range and the bearing of a place."""
    x, y = place - pose[AXES]
    return math.hypot(x, y), float(wrap(math.atan2(y, x) - pose[HEADING]))


def _sighting(
    pose: Array, place: Array, subject: str, honest: PackedRelative | None, sigma: float | None
) -> PackedRelative:
    """What it would see of a subject at a place, with an honest sighting's variances or with others."""
    distance, bearing = _line_of_sight(pose, place)
    if honest is not None and sigma is None:
        return honest.model_copy(update={"range": distance, "bearing": bearing})
    variance = 0.25 if sigma is None else sigma**2
    return PackedRelative(
        subject=subject, range=distance, bearing=bearing, range_variance=variance, bearing_variance=min(variance, 0.04)
    )


def _with_relatives(reports: Reports, scene: Scene, relatives: list[PackedRelative]) -> Reports:
    evidence = scene.evidence_in(reports)
    if evidence is None:
        return reports
    return _with_evidence(reports, scene, evidence.model_copy(update={"relatives": relatives[:MAX_RELATIVES]}))


def _with_evidence(reports: Reports, scene: Scene, evidence: PackedEvidence) -> Reports:
    return {**reports, scene.own: reports[scene.own].model_copy(update={"evidence": evidence})}


def _numbers(part: Any) -> list[Callable[[float], None]]:
    """For every number below a map or a list what puts another one in its place; tuples are made lists."""
    setters: list[Callable[[float], None]] = []
    for at, value in list(part.items()) if isinstance(part, dict) else list(enumerate(part)):
        if isinstance(value, float):
            setters.append(partial(part.__setitem__, at))
        elif isinstance(value, dict | list | tuple):
            part[at] = inner = list(value) if isinstance(value, tuple) else value
            setters += _numbers(inner)
    return setters
