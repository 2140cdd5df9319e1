"""Evidence for a joint board on the wire: what a robot gained in a tick, as a Gaussian, beside the belief that it reports.

The shapes are those of `blackboard.opinion.gaussian`: a state has 12 entries (x, y, heading, forward and turn scale, drift, bearing
bias, slip, range scale, curved way and turn, lag). A robot without the last three sends 9, and so do older members. A symmetric matrix
of n rows is sent as its upper triangle, row by row, n (n + 1) / 2 numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import astuple
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from blackboard.errors import Refused
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import NUMBERS, Bias, Relative, measured, triangle
from blackboard.opinion.gaussian.vehicle import POSE, STATES, Motion, Nuisance
from blackboard.opinion.grid import Array
from blackboard.wire.types import (
    LARGEST,
    LEAST,
    MAX_OPINIONS,
    Finite,
    Listed,
    Message,
    Name,
    NonNegative,
    Part,
    Point,
    Subject,
    Text,
    Tick,
)

FORMER = 9  # states of a robot whose scales do not depend on the kind of motion
MAX_RELATIVES = 64
MAX_PROFILE = 64
MAX_VALUES = 8
TIED = 1e-9  # the least eigenvalue of a sighting's covariance, of its scale
NEGATIVE = -1e-9  # of the largest eigenvalue: a smaller one is no rounding


State = Annotated[tuple[Finite, ...], Field(min_length=FORMER, max_length=STATES), Listed]
Triangle = Annotated[
    tuple[Finite, ...], Field(min_length=FORMER * (FORMER + 1) // 2, max_length=STATES * (STATES + 1) // 2), Listed
]


#: The sigma of a bias that lasts, and for how many seconds.
LastingBias = Annotated[tuple[NonNegative, Annotated[float, Field(gt=0, le=LARGEST)]], Listed]


def _check_sizes(upper: Sequence[float], *rows: Sequence[float]) -> None:
    """ValueError: a row has not as many numbers as the matrix has rows."""
    if any(len(upper) != len(row) * (len(row) + 1) // 2 or len(row) not in (FORMER, STATES) for row in rows):
        raise ValueError(f"a state has {FORMER} or {STATES} numbers, and its matrix is a triangle of as many rows")


class PackedState(Part):
    """Mean and covariance of a robot's whole block."""

    mean: State
    covariance: Triangle

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _check_sizes(self.covariance, self.mean)
        return self


class PackedIncrement(Part):
    """The likelihood exp(v . d - d . I d / 2) of d = state - reference: what was gained in one tick."""

    reference: State
    information: Triangle
    vector: State

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        _check_sizes(self.information, self.reference, self.vector)
        return self


class PackedMotion(Part):
    """The odometry since the epoch began, summed up, so that a lost report loses no motion: the fields of a `Motion` in its order."""

    distance: Finite  # unit, as told
    turn: Finite  # radians, as told
    time: NonNegative  # seconds
    moving: NonNegative  # seconds of them in motion
    along: NonNegative  # unit ** 2
    across: NonNegative  # unit ** 2
    heading: NonNegative  # radians ** 2
    curved: Finite = 0.0  # unit: of the distance, what was driven on a curve
    driven: Finite = 0.0  # radians: of the turn, what was not on the spot
    faster: Finite = 0.0  # unit / s: by how much the speed grew
    quicker: Finite = 0.0  # radians / s: by how much the rate of the turn grew


class PackedNuisance(Part):
    """How the lasting errors of wheels and camera behave (`vehicle.Nuisance`); a memory of 0 s is for ever."""

    forward: Finite
    turn: Finite
    sigmas: Annotated[tuple[NonNegative, ...], Field(min_length=6, max_length=9), Listed]
    walks: Annotated[tuple[NonNegative, ...], Field(min_length=3, max_length=6), Listed]
    memory: Annotated[tuple[NonNegative, ...], Field(min_length=3, max_length=3), Listed]


class PackedRelative(Part):
    """The newest sighting of a mate or an object, relative to the robot that took it; `biases` are (sigma, seconds)."""

    subject: Subject
    range: NonNegative
    bearing: Finite
    range_variance: NonNegative
    bearing_variance: NonNegative
    age: NonNegative = 0.0
    biases: Annotated[list[LastingBias], Field(max_length=4)] = Field(default_factory=list)
    group: Annotated[str, Field(max_length=80)] = ""


class Seen(Part):
    """A sighting of a further kind, from the robot that took it: "range", "bearing", "position" or "pose" (relative to its own).

    A reader that does not know the kind leaves it out, and counts it. `covariance` is an upper triangle; in readings it may be empty:
    by the robot's model. A `landmark` is for readings, `biases` and `group` are as in PackedRelative.
    """

    subject: Subject
    kind: Text
    values: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=MAX_VALUES), Listed]
    covariance: Annotated[tuple[Finite, ...], Field(max_length=MAX_VALUES * (MAX_VALUES + 1) // 2), Listed] = ()
    landmark: Point | None = None
    age: NonNegative = 0.0
    biases: Annotated[list[LastingBias], Field(max_length=4)] = Field(default_factory=list)
    group: Annotated[str, Field(max_length=80)] = ""

    @property
    def is_known(self) -> bool:
        """Whether the kind is known here."""
        return self.kind in NUMBERS

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        size = NUMBERS.get(self.kind)
        if size is None:
            return self
        if len(self.values) != size:
            raise ValueError(f"a {self.kind} has {size} values, not {len(self.values)}")
        if self.kind == "range" and self.values[0] < 0:
            raise ValueError("a range is not negative")
        if not self.covariance and size == 1:
            return self
        if len(self.covariance) != size * (size + 1) // 2:
            raise ValueError(f"the covariance of a {self.kind} is {size * (size + 1) // 2} numbers")
        matrix = triangle(self.covariance)
        scale = np.sqrt(np.maximum(np.diag(matrix), LEAST**2))
        if np.diag(matrix).min() < LEAST**2 or np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] < TIED:
            raise ValueError("the covariance must be positive definite")
        return self


class PackedEvidence(Part):
    """What a robot contributes to the joint in one tick, numbered by its source, its epoch and the tick."""

    epoch: Annotated[int, Field(ge=0, lt=1 << 53)]
    travelled: PackedMotion
    nuisance: PackedNuisance
    state: PackedState | None = None
    increment: PackedIncrement | None = None
    relatives: Annotated[list[PackedRelative], Field(max_length=MAX_RELATIVES)] = Field(default_factory=list)
    profile: Annotated[list[Annotated[tuple[NonNegative, NonNegative], Listed]], Field(max_length=MAX_PROFILE)] = Field(
        default_factory=list
    )
    seen: Annotated[list[Seen], Field(max_length=MAX_RELATIVES)] = Field(default_factory=list)  # of further kinds

    @property
    def subjects(self) -> list[str]:
        """What was seen, in all kinds of sightings."""
        return [*(it.subject for it in self.relatives), *(it.subject for it in self.seen)]


class Forwarded(Part):
    """The evidence of one robot in one tick, as its board took it from the robot's report."""

    robot: Name
    tick: Tick
    evidence: PackedEvidence
    age: Finite = 0.0  # seconds from the time of the report, by the board's clock, to that of the Forward


class Forward(Message):
    """The evidence of a sub-team's robots in one tick, from its board to the other boards, so that each can settle all of it."""

    board: Name
    sub_team: Name
    tick: Tick
    time: Finite
    evidence: Annotated[list[Forwarded], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)


# --- ours to the wire ------------------------------------------------------------------------------------------------------


def pack_evidence(
    epoch: int,
    travelled: Motion,
    nuisance: Nuisance,
    state: Moments | None,
    increment: Increment | None,
    relatives: Sequence[Relative],
) -> PackedEvidence:
    """The evidence of one tick for a Report, but for a sighting with an error that no message holds; the profile is sent once."""
    errors = [(it.range_variance, it.bearing_variance, *(bias.sigma for bias in it.biases)) for it in relatives]
    sound = [it for it, its in zip(relatives, errors, strict=True) if max(its) <= LARGEST]
    told = [it for it in sound if it.kind == "range-bearing"]
    if not all(it.profile for it in told):  # one profile is of all sightings of a message
        told = [it.without_profile() for it in told]
    states = STATES if any(nuisance.sigmas[6:]) else FORMER
    sums = dict(zip(PackedMotion.model_fields, _row(np.array(astuple(travelled))), strict=True))
    return PackedEvidence(
        epoch=epoch,
        travelled=PackedMotion.model_validate(sums),
        nuisance=PackedNuisance(
            forward=nuisance.forward,
            turn=nuisance.turn,
            sigmas=nuisance.sigmas if states == STATES else nuisance.sigmas[:6],
            walks=nuisance.walks if states == STATES else nuisance.walks[:3],
            memory=tuple(0.0 if np.isinf(seconds) else seconds for seconds in nuisance.memory),
        ),
        state=None if state is None else pack_state(state, states),
        increment=None
        if increment is None
        else PackedIncrement(
            reference=_row(increment.reference[:states]),
            information=_upper(increment.information[:states, :states]),
            vector=_row(increment.vector[:states]),
        ),
        relatives=[
            PackedRelative(
                subject=it.subject,
                range=it.range,
                bearing=it.bearing,
                range_variance=it.range_variance,
                bearing_variance=it.bearing_variance,
                age=it.age,
                biases=[(bias.sigma, bias.seconds) for bias in it.biases],
                group=it.group,
            )
            for it in told[:MAX_RELATIVES]
        ],
        profile=list(told[0].profile) if told else [],
        seen=[_seen(it) for it in sound if it.kind != "range-bearing"][:MAX_RELATIVES],
    )


def _seen(it: Relative) -> Seen:
    values, covariance = it.numbers()
    biases = [(bias.sigma, bias.seconds) for bias in it.biases]
    return Seen(
        subject=it.subject,
        kind=it.kind,
        values=values,
        covariance=covariance,
        age=it.age,
        biases=biases,
        group=it.group,
    )


def pack_state(state: Moments, states: int | None = None) -> PackedState:
    """Mean, shape (12,), and covariance, shape (12, 12), of a robot's block; by default without those that are all 0."""
    if states is None:
        states = STATES if state.mean[FORMER:].any() or state.covariance[FORMER:].any() else FORMER
    return PackedState(mean=_row(state.mean[:states]), covariance=_upper(state.covariance[:states, :states]))


# --- the wire to ours ------------------------------------------------------------------------------------------------------


def unpack_state(packed: PackedState) -> Moments:
    """Mean, shape (12,), and covariance, shape (12, 12). Refused: "mass", a covariance that is none."""
    return Moments(_whole(packed.mean), _symmetric(packed.covariance, "state.covariance"))


def pose_of(packed: PackedState | None) -> Moments | None:
    """Mean (x, y, heading), shape (3,), and covariance, shape (3, 3), of a robot's block; None without a sound one."""
    if packed is None:
        return None
    with suppress(Refused):
        state = unpack_state(packed)
        return Moments(state.mean[POSE], state.covariance[POSE, POSE])
    return None


def unpack_increment(packed: PackedIncrement) -> Increment:
    """Refused: "mass", an information matrix with a negative eigenvalue."""
    information = _symmetric(packed.information, "increment.information")
    return Increment(_whole(packed.reference), information, _whole(packed.vector))


def unpack_motion(packed: PackedMotion) -> Motion:
    return Motion(*(value for _, value in packed))


def unpack_nuisance(packed: PackedNuisance) -> Nuisance:
    memory = tuple(seconds or np.inf for seconds in packed.memory)
    return Nuisance(packed.forward, packed.turn, packed.sigmas, packed.walks, memory)


def unpack_relatives(packed: PackedEvidence, observer: str) -> tuple[Relative, ...]:
    """The relative beliefs of a robot, named by its subject, `robot/r1`; without those of kinds that are not known here."""
    profile = tuple(packed.profile)
    found = [unpack_seen(it, observer) for it in packed.seen if it.is_known and it.covariance]
    return tuple(found) + tuple(
        Relative(
            observer=observer,
            subject=it.subject,
            range=it.range,
            bearing=it.bearing,
            range_variance=it.range_variance,
            bearing_variance=it.bearing_variance,
            age=it.age,
            biases=tuple(Bias(sigma, seconds) for sigma, seconds in it.biases),
            group=it.group,
            profile=profile,
        )
        for it in packed.relatives
    )


def unpack_seen(it: Seen, observer: str) -> Relative:
    """A sighting of a further kind that is known here, with its covariance."""
    biases = tuple(Bias(sigma, seconds) for sigma, seconds in it.biases)
    return measured(it.kind, observer, it.subject, it.values, it.covariance, it.age, biases, it.group)  # type: ignore[arg-type]


def _row(values: Array) -> tuple[float, ...]:
    """The numbers, at most as large as a message can hold: a robot whose readings are absurd says so, and is refused."""
    return tuple(float(v) for v in np.clip(values, -LARGEST, LARGEST))


def _upper(matrix: Array) -> tuple[float, ...]:
    return _row(matrix[np.triu_indices(len(matrix))])


def _whole(row: Sequence[float]) -> Array:
    """The numbers of all states: those that were not sent are exactly 0."""
    return np.pad(np.array(row), (0, STATES - len(row)))


def _symmetric(upper: Sequence[float], field: str) -> Array:
    matrix = triangle(upper)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scaled = matrix / np.outer(scale + (scale == 0), scale + (scale == 0))
    values = np.linalg.eigvalsh(scaled)
    if values[0] < NEGATIVE * max(1.0, float(values[-1])):
        raise Refused("mass", f"{field} has a negative eigenvalue, {values[0]:.3g} of its scale")
    if values[0] < 0:  # rounding, or somebody who would have others fail on it
        values, axes = np.linalg.eigh(scaled)
        scaled = (axes * np.maximum(values, 0.0)) @ axes.T
        matrix = 0.5 * (scaled + scaled.T) * np.outer(scale, scale)
    return np.pad(matrix, (0, STATES - len(matrix)))
