"""Evidence for a joint in fewer bytes, which every reader reads. Pure.

Numbers are rounded to float32, and to whole ones where nothing is lost by it, because `codec.encode(shortest=True)` writes such
in five bytes or in one. Some numbers cannot be rounded each for itself: a message would be refused, or would claim more than is
known. So sums never shrink, a covariance only grows, and an increment gains nothing in directions in which it gained nothing.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from blackboard.opinion.gaussian.relation import triangle, upper
from blackboard.opinion.gaussian.vehicle import HEADING
from blackboard.opinion.grid import Array
from blackboard.wire.evidence import (
    PackedCamera,
    PackedCompass,
    PackedEvidence,
    PackedIncrement,
    PackedRelative,
    PackedState,
    Seen,
)
from blackboard.wire.types import LEAST

#: A larger sum stays as it is: so the sums of an epoch never shrink, and a distance is right to 1/256 of a unit.
ROUNDED = 2.0**16
WIDER = 2e-6  # share by which variances grow, so that a rounded covariance stays one: 12 float32 are off by 6e-8 each
RELATIVE = ("range", "bearing", "range_variance", "bearing_variance", "age")
BITS = 24  # of a float32
FAINT = 1e-12  # of the largest eigenvalue of a scaled matrix: a smaller one is rounding
CHANGED = 0.05  # share of what is known in any direction by which a rounded increment may change it
NOTHING = 1e-4  # share of a state's variance: of a state that gained less in an increment nothing is said
OFF = 0.1  # share of a variance by which a profile with fewer points may be off at the points that were left out


def shorter(evidence: PackedEvidence) -> PackedEvidence:
    """The evidence with its numbers rounded: errors of 6e-8, of the increment's rows 1e-3, of the camera's profile `OFF`.

    Sums shrink between a message that was rounded and one that was not: a robot rounds in all messages or in none.
    """
    sums = {name: _sum(value) for name, value in evidence.travelled.model_dump().items()}
    nuisance = {name: _singles(value) for name, value in evidence.nuisance.model_dump().items()}
    changes: dict[str, Any] = {
        "travelled": evidence.travelled.model_copy(update=sums),
        "nuisance": evidence.nuisance.model_copy(update=nuisance),
        "relatives": [_relative(relative) for relative in evidence.relatives],
        "seen": [_seen(sighting) for sighting in evidence.seen],
        "profile": [(single(a), single(b)) for a, b in _thinned(tuple(evidence.profile))],
    }
    if evidence.camera is not None:
        changes["camera"] = PackedCamera(**{name: _singles(value) for name, value in evidence.camera})
    if evidence.compass is not None:
        changes["compass"] = _compass(evidence.compass)
    if evidence.state is not None:
        changes["state"] = _state(evidence.state)
    if evidence.increment is not None:
        covariance = None if evidence.state is None else triangle(evidence.state.covariance)
        changes["increment"] = _increment(evidence.increment, covariance)
    return evidence.model_copy(update=changes)


def single(value: float) -> float:
    return float(np.float32(value))


def _sum(value: float) -> float:
    return single(value) if abs(value) < ROUNDED else value


def _singles(value: Any) -> Any:
    """A number, or any sequence of sequences of numbers, as float32."""
    return single(value) if isinstance(value, float) else tuple(map(_singles, value))


def _compass(packed: PackedCompass) -> PackedCompass:
    numbers = {name: single(value) for name, value in packed if value is not None}
    return packed.model_copy(update={**numbers, "sigma": max(LEAST, numbers["sigma"])})


def _relative(packed: PackedRelative) -> PackedRelative:
    numbers = {name: single(getattr(packed, name)) for name in RELATIVE}
    biases = [(single(sigma), single(seconds)) for sigma, seconds in packed.biases]
    return packed.model_copy(update={**numbers, "biases": biases})


def _seen(packed: Seen) -> Seen:
    size = len(packed.values)
    wider = triangle(packed.covariance) * (1 + WIDER * np.eye(size)) if packed.covariance else np.zeros((0, 0))
    covariance = _singles(upper(wider))
    return packed.model_copy(
        update={"values": _singles(packed.values), "covariance": covariance, "age": single(packed.age)}
    )


def _state(packed: PackedState) -> PackedState:
    covariance = triangle(packed.covariance)
    covariance[np.diag_indices(len(covariance))] *= 1 + WIDER
    return PackedState(mean=_singles(packed.mean), covariance=_singles(upper(covariance)))


def _increment(packed: PackedIncrement, covariance: Array | None) -> PackedIncrement:
    """The likelihood as rows, each a measurement with noise 1, whose products are float32 to the bit once they are rounded.

    The reference may be anywhere, so it is where its numbers are short. `covariance`, shape (12, 12), is what is left of the
    states' errors. A state whose variance fell by a share of less than `NOTHING` is left out. Where rounding changes more than
    `CHANGED` of what is known in any direction, the increment stays as it is.
    """
    whole, vector = triangle(packed.information), np.array(packed.vector)
    information = whole.copy()
    if covariance is not None:
        nothing = np.diag(information) * np.diag(covariance) < NOTHING
        information[nothing, :] = information[:, nothing] = vector[nothing] = 0.0
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(information / np.outer(scale, scale))
    told = values > FAINT * max(float(values[-1]), 1.0)
    if not told.any():
        return packed
    rows = np.sqrt(values[told])[:, None] * axes[:, told].T * scale
    measured = (axes[:, told].T @ (vector / scale)) / np.sqrt(values[told])
    bits = (BITS - math.ceil(math.log2(len(rows)))) // 2
    largest = np.abs(rows).max(axis=0)
    quantum = 2.0 ** (np.ceil(np.log2(np.where(largest > 0, largest, 1.0))) - bits)
    rows = np.rint(rows / quantum) * quantum
    if covariance is not None and _changed(rows.T @ rows - whole, covariance) > CHANGED:
        return packed
    reference = np.rint(packed.reference)
    reference[HEADING] = single(packed.reference[HEADING])
    measured = measured + rows @ (np.array(packed.reference) - reference)
    return PackedIncrement(
        reference=tuple(map(float, reference)),
        information=upper(rows.T @ rows),
        vector=_singles(tuple(map(float, rows.T @ measured))),
    )


def _changed(difference: Array, covariance: Array) -> float:
    """The largest share, over all directions, by which a difference of information changes what is known with a covariance."""
    values, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(values, 0.0))
    return float(np.abs(np.linalg.eigvalsh(root.T @ difference @ root)).max())


@lru_cache(maxsize=8)
def _thinned(profile: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """The fewest points between which readers may interpolate and be right to a share of `OFF`."""
    if len(profile) < 3:
        return profile
    distances, variances = np.array(profile).T
    kept = [0, len(profile) - 1]
    while len(kept) < len(profile):
        off = np.abs(np.interp(distances, distances[kept], variances[kept]) / np.maximum(variances, 1e-12) - 1)
        worst = int(off.argmax())
        if off[worst] <= OFF:
            break
        kept = sorted([*kept, worst])
    return tuple(profile[i] for i in kept)
