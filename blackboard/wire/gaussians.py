"""States, increments and sightings as the messages of `evidence` have them, and back."""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.classes import is_class
from blackboard.opinion.gaussian.cameras import CameraFound
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.mounts import CompassReading
from blackboard.opinion.gaussian.relation import Bias, Relative, measured, triangle, upper
from blackboard.opinion.gaussian.vehicle import POSE, STATES, TRACK, Motion, Nuisance, curved_and_driven
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import (
    FORMER,
    MAX_RELATIVES,
    PackedCamera,
    PackedCompass,
    PackedEvidence,
    PackedIncrement,
    PackedMotion,
    PackedNuisance,
    PackedPose,
    PackedRelative,
    PackedState,
    PackedTrack,
    PackedVelocity,
    Seen,
)
from blackboard.wire.messages import Odometry
from blackboard.wire.types import LARGEST, LEAST

FULL = ("range", "bearing", "range_variance", "bearing_variance")  # of a sighting that measures both
NEGATIVE = -1e-9  # of the largest eigenvalue: a smaller one is no rounding


# --- ours to the wire ------------------------------------------------------------------------------------------------------


def pack_evidence(evidence: Evidence) -> PackedEvidence:
    """The evidence of one tick for a Report, but for a sighting with an error that no message holds; the profile is sent once."""
    relatives, returned, camera = evidence.relatives, evidence.returned, evidence.camera
    errors = [
        (sighting.range_variance, sighting.bearing_variance, *(bias.sigma for bias in sighting.biases))
        for sighting in relatives
    ]
    sound = [sighting for sighting, its in zip(relatives, errors, strict=True) if max(its) <= LARGEST]
    told = [sighting for sighting in sound if sighting.kind == "range-bearing"]
    # A message holds one profile, for all its sightings or for none.
    if not all(sighting.profile for sighting in told):
        told = [sighting.without_profile() for sighting in told]
    states = STATES if any(evidence.nuisance.sigmas[6:]) else FORMER
    return PackedEvidence(
        epoch=evidence.epoch,
        travelled=_packed_motion(evidence.travelled),
        nuisance=_packed_nuisance(evidence.nuisance, states),
        state=None if evidence.belief is None else pack_state(evidence.belief, states),
        increment=None if evidence.increment is None else _packed_increment(evidence.increment, states),
        relatives=[PackedRelative(**_packed(sighting, *FULL)) for sighting in told[:MAX_RELATIVES]],
        profile=list(told[0].profile) if told else [],
        seen=[_seen(sighting) for sighting in sound if sighting.kind != "range-bearing"][:MAX_RELATIVES],
        returned=None if returned is None else pack_state(returned, states),
        camera=None if camera is None else PackedCamera(model=camera.model, range=camera.range, bearing=camera.bearing),
        compass=None if evidence.compass is None else _packed_compass(evidence.compass),
    )


def _packed_compass(reading: CompassReading) -> PackedCompass:
    return PackedCompass(
        heading=reading.heading,
        sigma=max(reading.sigma, LEAST),
        noise=reading.noise,
        most=None if math.isinf(reading.most) else max(1.0, reading.most),
        bias=reading.bias,
        bias_sigma=reading.bias_sigma,
        tie=reading.tie,
    )


def _packed_motion(motion: Motion) -> PackedMotion:
    sums = dict(zip(PackedMotion.model_fields, _row(np.array(motion.numbers())), strict=True))
    return PackedMotion.model_validate(sums)


def _packed_nuisance(nuisance: Nuisance, states: int) -> PackedNuisance:
    return PackedNuisance(
        forward=nuisance.forward,
        turn=nuisance.turn,
        sigmas=nuisance.sigmas if states == STATES else nuisance.sigmas[:6],
        walks=nuisance.walks if states == STATES else nuisance.walks[:3],
        memory=tuple(0.0 if np.isinf(seconds) else seconds for seconds in nuisance.memory),
        alike=nuisance.alike,
    )


def _packed_increment(increment: Increment, states: int) -> PackedIncrement:
    return PackedIncrement(
        reference=_row(increment.reference[:states]),
        information=_upper(increment.information[:states, :states]),
        vector=_row(increment.vector[:states]),
    )


def _seen(sighting: Relative) -> Seen:
    values, covariance = sighting.numbers()
    return Seen(kind=sighting.kind, values=values, covariance=covariance, **_packed(sighting))


def _packed(sighting: Relative, *more: str) -> dict[str, Any]:
    """The fields that sightings of all kinds have, and some `more`."""
    same = {name: getattr(sighting, name) for name in ("subject", "age", "group", "confidence", "mark", *more)}
    return {**same, "biases": [(bias.sigma, bias.seconds) for bias in sighting.biases]}


def pack_state(state: Moments, states: int | None = None) -> PackedState:
    """Mean, shape (12,), and covariance, shape (12, 12), of a robot's block; by default without those that are all 0."""
    if states is None:
        states = STATES if state.mean[FORMER:].any() or state.covariance[FORMER:].any() else FORMER
    return PackedState(mean=_row(state.mean[:states]), covariance=_upper(state.covariance[:states, :states]))


def pack_pose(place: Moments) -> PackedPose:
    """Mean, shape (2,), and covariance, shape (2, 2), of an object's place."""
    (x, y), (xx, xy, yy) = _row(place.mean), _upper(place.covariance)
    return PackedPose(mean=(x, y), covariance=(xx, xy, yy))


def pack_velocity(velocity: Moments) -> PackedVelocity:
    """Mean, shape (2,) or (3,), and covariance."""
    return PackedVelocity(mean=_row(velocity.mean), covariance=_upper(velocity.covariance))


def pack_track(name: str, place: Moments) -> PackedTrack:
    """Mean, shape (2,), and covariance, shape (2, 2), of something of a name."""
    return PackedTrack(name=name, **dict(pack_pose(place)))


# --- the wire to ours ------------------------------------------------------------------------------------------------------


def unpack_state(packed: PackedState) -> Moments:
    """Mean, shape (12,), and covariance, shape (12, 12). Refused: "mass", a covariance that is none."""
    return Moments(_whole(packed.mean), _symmetric(packed.covariance, "state.covariance"))


def unpack_track(packed: PackedTrack) -> Moments:
    """Mean, shape (2,), and covariance, shape (2, 2). Refused: "mass", a covariance that is none."""
    return _place(packed, packed.name)


def _place(packed: PackedPose | PackedTrack, name: str) -> Moments:
    xx, xy, yy = packed.covariance
    if xx * yy < xy * xy:
        raise Refused("mass", f"{name}: {packed.covariance} is the covariance of no place")
    return Moments(np.array(packed.mean), np.array([[xx, xy], [xy, yy]]))


def pose_of(packed: PackedState | PackedPose | None) -> Moments | None:
    """Mean (x, y, heading), shape (3,), of a robot's block, (x, y) of an object's place, and covariance; None without a sound one."""
    if packed is None:
        return None
    with suppress(Refused):
        if isinstance(packed, PackedPose):
            return _place(packed, "pose")
        state = unpack_state(packed)
        return Moments(state.mean[POSE], state.covariance[POSE, POSE])
    return None


def velocity_of(packed: PackedVelocity | None) -> Moments | None:
    """Mean, shape (2,), or (3,) of a robot (its rate of turn is last), and covariance; None without a sound one."""
    if packed is None:
        return None
    with suppress(Refused):
        return Moments(np.array(packed.mean), _matrix(packed.covariance, "velocity.covariance"))
    return None


def unpack_increment(packed: PackedIncrement) -> Increment:
    """Refused: "mass", an information matrix with a negative eigenvalue."""
    information = _symmetric(packed.information, "increment.information")
    return Increment(_whole(packed.reference), information, _whole(packed.vector))


def unpack_motion(packed: PackedMotion) -> Motion:
    return Motion(*(value for _, value in packed))


def parts_of(odometry: Odometry, track: float = TRACK) -> tuple[float, float]:
    """What of the distance was driven on a curve (unit), and what of the turn while driving (radians).

    Where the odometry does not tell it, it is judged by the whole step, and the distance between the wheels, `track` (unit).
    """
    told = (np.nan if part is None else part for part in (odometry.curved, odometry.driven))
    curved, driven = curved_and_driven(odometry.distance, odometry.turn, tuple(told), track)
    return float(curved), float(driven)


def one_way(first: Odometry, second: Odometry) -> Odometry:
    """Two pieces of odometry as one, which leads to where they lead: its way is seen at the heading halfway through its turn.

    A sigma that one of them does not have is left out.
    """
    whole = _motion_of(first).then(_motion_of(second))
    sigmas = {}
    for name in ("distance_sigma", "turn_sigma"):
        one, other = getattr(first, name), getattr(second, name)
        sigmas[name] = None if one is None or other is None else math.hypot(one, other)
    return Odometry(
        distance=whole.distance,
        turn=whole.turn,
        dt=whole.dt,
        aside=whole.aside,
        curved=whole.curved,
        driven=whole.driven,
        **sigmas,
    )


def _motion_of(piece: Odometry) -> Motion:
    curved, driven = parts_of(piece)
    return Motion(piece.distance, piece.turn, piece.dt, curved=curved, driven=driven, aside=piece.aside)


def unpack_nuisance(packed: PackedNuisance) -> Nuisance:
    memory = tuple(seconds or np.inf for seconds in packed.memory)
    return Nuisance(packed.forward, packed.turn, packed.sigmas, packed.walks, memory, packed.alike)


def unpack_camera(packed: PackedCamera) -> CameraFound:
    return CameraFound(packed.model, packed.range, packed.bearing)


def unpack_compass(packed: PackedCompass) -> CompassReading:
    most = math.inf if packed.most is None else packed.most
    return CompassReading(packed.heading, packed.sigma, packed.noise, most, packed.bias, packed.bias_sigma, packed.tie)


def unpack_relatives(packed: PackedEvidence, observer: str) -> tuple[Relative, ...]:
    """The relative beliefs of a robot, named by its subject, `robot/r1`; without those of kinds that are not known here."""
    profile = tuple(packed.profile)
    further = [unpack_seen(sighting, observer) for sighting in packed.seen if sighting.is_known and sighting.covariance]
    return tuple(further) + tuple(
        Relative(observer=observer, subject=sighting.subject, profile=profile, **_unpacked(sighting, *FULL))
        for sighting in packed.relatives
    )


def unpack_seen(sighting: Seen, observer: str) -> Relative:
    """A sighting of a further kind that is known here, with its covariance."""
    seen = measured(sighting.kind, observer, sighting.subject, sighting.values, sighting.covariance)  # type: ignore[arg-type]
    return replace(seen, **_unpacked(sighting))


def _unpacked(sighting: PackedRelative | Seen, *more: str) -> dict[str, Any]:
    """What sightings of all kinds have beside their numbers and names, and some `more`; what names its subject has no mark."""
    same = {name: getattr(sighting, name) for name in ("age", "group", "confidence", *more)}
    biases = tuple(Bias(sigma, seconds) for sigma, seconds in sighting.biases)
    return {**same, "biases": biases, "mark": sighting.mark if is_class(sighting.subject) else None}


def _row(values: Array) -> tuple[float, ...]:
    """The numbers, at most as large as a message can hold: a robot whose readings are absurd says so, and is refused."""
    return tuple(np.clip(values, -LARGEST, LARGEST).tolist())


def _upper(matrix: Array) -> tuple[float, ...]:
    return upper(np.clip(matrix, -LARGEST, LARGEST))


def _whole(row: Sequence[float]) -> Array:
    """The numbers of all states: those that were not sent are exactly 0."""
    whole = np.zeros(STATES)
    whole[: len(row)] = row
    return whole


def _symmetric(triangular: Sequence[float], field: str) -> Array:
    """The matrix of all states: those that were not sent are exactly 0."""
    matrix = _matrix(triangular, field)
    whole = np.zeros((STATES, STATES))
    whole[: len(matrix), : len(matrix)] = matrix
    return whole


def _matrix(triangular: Sequence[float], field: str) -> Array:
    matrix = triangle(triangular)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scaled = matrix / np.outer(scale + (scale == 0), scale + (scale == 0))
    values = np.linalg.eigvalsh(scaled)
    if values[0] < NEGATIVE * max(1.0, float(values[-1])):
        raise Refused("mass", f"{field} has a negative eigenvalue, {values[0]:.3g} of its scale")
    if values[0] < 0:  # rounding, or somebody who would have others fail on it
        values, axes = np.linalg.eigh(scaled)
        scaled = (axes * np.maximum(values, 0.0)) @ axes.T
        matrix = 0.5 * (scaled + scaled.T) * np.outer(scale, scale)
    return matrix
