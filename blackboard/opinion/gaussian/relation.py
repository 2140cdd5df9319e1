"""A sighting relative to the robot that took it, as evidence on a joint belief."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.vehicle import (
    AXES,
    BEARING,
    FLAT,
    HEADING,
    RANGE,
    STATES,
    Motion,
    moved_in,
    wrap,
)
from blackboard.opinion.grid import Array

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # a turn by 90 degrees: the derivative of a rotation
UNSTEADY = (
    0.5  # share of its speed by which a robot may go faster or slower, or aside, than in the tick before or after
)
NEAREST = 1e-6  # unit: nearer than this there is no line of sight
EXACT = 1e-9  # radians ** 2: a heading with less variance is exact
BiasBlock = tuple[str, str, str, float]  # "bias", observer, group, time constant (s)
NOTHING = Moments(np.zeros(2), np.eye(2) * FLAT)  # of a subject's place
STANDARD = Moments(np.zeros(1), np.eye(1))  # of a lasting error
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # for the mean over a normal distribution


@dataclass(frozen=True)
class Bias:
    """An error of a range that lasts: its sigma (unit) and time constant (s)."""

    sigma: float
    seconds: float


@dataclass(frozen=True)
class Relative:
    """A relative belief: where `observer` saw `subject`, as range (unit) and bearing (rad) with their fresh variances.

    `age` is seconds before the end of the observer's tick; `ahead` is by how many seconds the subject's tick ended later than
    that, where ticks are not the world's. `biases` are the lasting errors of the range, shared by all sightings of
    one observer in one `group` (by default those of the subject), each with a time constant of its own.
    `profile`, where given, replaces both variances: (distance, variance) pairs of an isotropic error of the seen position,
    interpolated, and to be averaged over the distances at which the subject may be.
    """

    observer: str
    subject: str
    range: float
    bearing: float
    range_variance: float
    bearing_variance: float
    age: float = 0.0
    biases: tuple[Bias, ...] = ()
    group: str = ""
    profile: tuple[tuple[float, float], ...] = ()
    ahead: float = 0.0

    def along(self) -> Array:
        """The line of sight in the observer's frame, shape (2,)."""
        return np.array([math.cos(self.bearing), math.sin(self.bearing)])

    def without_profile(self) -> Relative:
        """The sighting with the variances that its profile has at the measured range."""
        if not self.profile:
            return self
        variance = float(np.interp(self.range, *np.array(self.profile).T))
        across = variance / max(self.range, NEAREST) ** 2
        return replace(self, range_variance=variance, bearing_variance=across, profile=())

    def blocks(self) -> dict[BiasBlock, float]:
        """The blocks of the lasting errors, standard normal states, and how far each moves the range (unit)."""
        return {bias_block(self.observer, self.group or self.subject, b.seconds): b.sigma for b in self.biases}


def bias_block(observer: str, group: str, seconds: float) -> BiasBlock:
    """The name of a lasting error's block."""
    return ("bias", observer, group, seconds)


def forget_biases(joint: Joint, dt: float) -> None:
    """Let all lasting errors of ranges forget for `dt` seconds."""
    joint.decay({b: math.exp(-dt / b[3]) for b in joint.blocks if isinstance(b, tuple) and b[0] == "bias"})


def linearise(
    joint: Joint,
    sighting: Relative,
    motions: Mapping[str, Motion],
    place: Array | None = None,
    at: Array | None = None,
) -> Factor:
    """A sighting against what a joint belief expects; the joint is not changed.

    `motions` are those of the tick: they say where both stood when the sighting was taken. `place`, shape (2,), is the
    subject's where it is known; else a subject that the joint does not have is a point of which nothing is known. `at`, shape (9,),
    is where to linearise instead of the observer's mean: it is no evidence. KeyError: the observer is not in the joint.
    """
    named: dict[Block, Moments] = {} if place is not None else {sighting.subject: NOTHING}
    named |= dict.fromkeys(sighting.blocks(), STANDARD)
    anchors = _anchors(joint, sighting, place)
    priors = {b: replace(it, mean=anchors.pop(b, it.mean)) for b, it in named.items() if b not in joint}
    local = joint.among(block for block in (sighting.observer, *named) if block in joint)
    local.begin(priors, anchors)
    mean = local.mean[local.blocks[sighting.observer]]
    observer = mean if at is None else at
    back, turned = moved_in(observer, motions.get(sighting.observer), sighting.age)
    subject = None if place is not None else local.blocks[sighting.subject]
    strayed = 0.0
    if subject is not None:
        place = local.mean[subject][AXES]
        if subject.stop - subject.start == STATES:
            motion = motions.get(sighting.subject)
            place = place - moved_in(local.mean[subject], motion, sighting.age + sighting.ahead)[0]
            strayed = _strayed(sighting, motion)
    away = place - (observer[AXES] - back)
    camera = float(observer[HEADING] - turned - observer[BEARING])
    form = _polar if _prefers_polar(local, sighting, away, subject) else _cartesian
    residual, by_place, by_observer, by_range, noise = form(local, sighting, away, camera, subject)
    if strayed:
        noise = noise + np.eye(2) * strayed
    residual = residual - by_range * (observer[RANGE] * sighting.range)
    by_observer[:, AXES] = -by_place
    by_observer[:, RANGE] = by_range * sighting.range
    jacobians: dict[Block, Array] = {sighting.observer: by_observer}
    if subject is not None:
        jacobians[sighting.subject] = np.zeros((2, subject.stop - subject.start))
        jacobians[sighting.subject][:, AXES] = by_place
    if at is not None:
        apart = mean - at
        apart[HEADING] = wrap(float(apart[HEADING]))
        residual = residual - by_observer @ apart
    for block, sigma in sighting.blocks().items():
        jacobians[block] = by_range[:, None] * sigma
        residual = residual - jacobians[block] @ local.mean[local.blocks[block]]
    return Factor(residual, jacobians, noise, priors, anchors)


def _strayed(sighting: Relative, motion: Motion | None) -> float:
    """Variance, unit ** 2 in each direction, of where a robot was when it was seen outside of the tick of its motion.

    It is taken to have moved then as in the tick, up to `UNSTEADY`. A sighting that is older than its observer's tick, too, is
    only stamped late.
    """
    if motion is None or motion.dt <= 0:
        return 0.0
    age = sighting.age + sighting.ahead
    outside = max(0.0, -age, age - max(motion.dt, sighting.age)) / motion.dt
    return outside * (motion.along + motion.across) + (outside * UNSTEADY * motion.distance) ** 2


def _anchors(joint: Joint, sighting: Relative, place: Array | None) -> dict[Block, Array]:
    """The mean of a flat position, at the place where the sighting puts it.

    The mean of a flat position that nothing else depends on is arbitrary; a wrong one would give a wrong lever to the heading.
    """
    observer, subject = sighting.observer, sighting.subject
    state = joint.mean[joint.blocks[observer]].copy()
    angle = float(state[HEADING] - state[BEARING]) + sighting.bearing
    seen = sighting.range * np.array([math.cos(angle), math.sin(angle)])
    is_flat, its_is_flat = _is_flat(joint, observer), place is None and _is_flat(joint, subject)
    if is_flat and not its_is_flat:
        state[AXES] = (joint.mean[joint.blocks[subject]][AXES] if place is None else place) - seen
        return {observer: state}
    if its_is_flat and not is_flat:
        mean = joint.mean[joint.blocks[subject]].copy() if subject in joint else np.zeros(2)
        mean[AXES] = state[AXES] + seen
        return {subject: mean}
    return {}


def _is_flat(joint: Joint, name: str) -> bool:
    """Whether a position is not known, and tied to no other block."""
    if name not in joint:
        return True
    block = joint.blocks[name]
    axes = slice(block.start, block.start + 2)
    if np.trace(joint.covariance[axes, axes]) < FLAT:
        return False
    ties = joint.covariance[axes].copy()
    ties[:, block] = 0.0
    return not ties.any()


Form = tuple[Array, Array, Array, Array, Array]  # residual, by place, by observer's angles, by range, noise


def _polar(joint: Joint, sighting: Relative, away: Array, camera: float, subject: slice | None) -> Form:
    """Range and bearing times the distance, along and across the expected line of sight."""
    distance = float(np.hypot(*away))
    frame = np.array([away, [-away[1], away[0]]]) / distance
    off = wrap(sighting.bearing - math.atan2(away[1], away[0]) + camera)
    residual = np.array([sighting.range - distance, distance * off])
    angles = np.zeros((2, STATES))
    angles[1, [HEADING, BEARING]] = -distance, distance
    radial, angular = _variances(joint, sighting, away, subject)
    return residual, frame, angles, np.array([1.0, 0.0]), np.diag([radial, distance**2 * angular])


def _cartesian(joint: Joint, sighting: Relative, away: Array, camera: float, subject: slice | None) -> Form:
    """The seen position in the observer's frame."""
    c, s = math.cos(camera), math.sin(camera)
    rotation = np.array([[c, s], [-s, c]])
    expected, along = rotation @ away, sighting.along()
    angles = np.zeros((2, STATES))
    angles[:, BEARING] = QUARTER @ expected
    angles[:, HEADING] = -angles[:, BEARING]
    frame = np.stack([along, QUARTER @ along], axis=1)
    radial, angular = _variances(joint, sighting, away, subject)
    noise = (frame * [radial, sighting.range**2 * angular]) @ frame.T
    return sighting.range * along - expected, rotation, angles, along, noise


def _prefers_polar(joint: Joint, sighting: Relative, away: Array, subject: slice | None) -> bool:
    """Which form is the more linear one: the polar form is exact in the heading, the Cartesian one in the positions.

    The error of the first grows with the positions' variance over the distance, of the second with the heading's variance
    times the distance; a tenth of the distance does no harm to the first. A heading without error leaves the second exact.
    """
    distance = float(np.hypot(*away))
    if distance < NEAREST:
        return False
    at = joint.blocks[sighting.observer]
    heading = float(joint.covariance[at, at][HEADING, HEADING])
    spread = float(np.trace(_spread(joint, at, subject)))
    return heading > EXACT and spread < (heading + 0.01) * distance**2


def _spread(joint: Joint, observer: slice, subject: slice | None) -> Array:
    """Covariance of the subject's place relative to the observer's, world axes, shape (2, 2)."""
    mine = slice(observer.start, observer.start + 2)
    covariance = joint.covariance[mine, mine]
    if subject is None:
        return covariance
    its = slice(subject.start, subject.start + 2)
    cross = joint.covariance[mine, its]
    return np.asarray(covariance + joint.covariance[its, its] - cross - cross.T)


def _variances(joint: Joint, sighting: Relative, away: Array, subject: slice | None) -> tuple[float, float]:
    """Variances of range and bearing; by the profile where there is one, at the distances that joint and range leave open."""
    if not sighting.profile:
        return sighting.range_variance, sighting.bearing_variance
    distances, variances = np.array(sighting.profile).T
    expected = max(float(np.hypot(*away)), NEAREST)
    along = away / expected
    prior = float(along @ _spread(joint, joint.blocks[sighting.observer], subject) @ along)
    own = float(np.interp(sighting.range, distances, variances))
    gain = prior / (prior + own)
    middle, sigma = expected + gain * (sighting.range - expected), math.sqrt(prior * (1 - gain))
    variance = float(WEIGHTS @ np.interp(middle + sigma * NODES, distances, variances) / WEIGHTS.sum())
    return variance, variance / max(sighting.range, float(distances[0]), NEAREST) ** 2
