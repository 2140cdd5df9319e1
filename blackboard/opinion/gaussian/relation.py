"""A sighting relative to the robot that took it, as evidence on a joint belief."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

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
WEIGHT = WEIGHTS.sum()

Kind = Literal["range-bearing", "range", "bearing", "position", "pose"]
#: How many numbers a sighting of each further kind has: x and y are in the observer's frame, and so is the heading of a pose.
NUMBERS: dict[str, int] = {"range": 1, "bearing": 1, "position": 2, "pose": 3}


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
    Other kinds than "range-bearing" are made by `measured`: of a range alone the bearing means nothing, and of a bearing alone
    the range. `spread` is the upper triangle of the covariance of a position (x, y), or of a pose (x, y, heading), in the
    observer's frame.
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
    kind: Kind = "range-bearing"
    spread: tuple[float, ...] = ()
    heading: float = 0.0  # rad: of a pose, the subject's heading in the observer's frame
    confidence: float = 1.0  # the detector's, that something is there
    mark: int | None = None  # of an unnamed one: its number among those of the tick

    @property
    def places(self) -> bool:
        """Whether it says alone where its subject is."""
        return self.kind not in ("range", "bearing")

    @property
    def stretched(self) -> float:
        """The range (unit) that the observer's range scale stretches: none of a sighting that says itself how exact it is."""
        return self.range if self.kind == "range" or self.biases else 0.0

    def numbers(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """What a sighting of a further kind measured, and the upper triangle of its covariance: as `measured` takes them."""
        if self.kind == "range":
            return (self.range,), (self.range_variance,)
        if self.kind == "bearing":
            return (self.bearing,), (self.bearing_variance,)
        x, y = (self.range * self.along()).tolist()
        return ((x, y, self.heading) if self.kind == "pose" else (x, y)), self.spread

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


def measured(
    kind: Kind,
    observer: str,
    subject: str,
    values: Sequence[float],
    covariance: Sequence[float],
    age: float = 0.0,
    biases: tuple[Bias, ...] = (),
    group: str = "",
) -> Relative:
    """A sighting of one of the further kinds (`NUMBERS`); `covariance` is an upper triangle, row by row."""
    bearing, heading = 0.0, 0.0
    spread: tuple[float, ...] = ()
    if kind == "range":
        (distance,), (radial,), angular = values, covariance, 0.0
    elif kind == "bearing":
        (bearing,), (angular,), distance, radial = values, covariance, 0.0, 0.0
    else:
        distance, bearing = math.hypot(values[0], values[1]), math.atan2(values[1], values[0])
        spread, heading = tuple(covariance), values[2] if kind == "pose" else 0.0
        radial, angular = 0.0, 0.0
    it = Relative(
        observer, subject, distance, bearing, radial, angular, age, biases, group, (), 0.0, kind, spread, heading
    )
    if not spread:
        return it
    radial, across = np.diag(_turned(it, [1.0, 1.0]))[:2]
    return replace(it, range_variance=float(radial), bearing_variance=float(across) / max(distance, NEAREST) ** 2)


def triangle(upper: Sequence[float]) -> Array:
    """The symmetric matrix of an upper triangle, row by row."""
    size = math.isqrt(2 * len(upper))
    rows, columns = upper_indices(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = matrix[columns, rows] = upper
    return matrix + 0.0  # no negative zeros


@lru_cache(maxsize=STATES)
def upper_indices(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """The rows and columns of an upper triangle, row by row; made once for each size."""
    rows, columns = np.triu_indices(size)
    return rows, columns


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

    The residual has one number for a range or a bearing alone, three for a pose of a robot, else two.
    `motions` are those of the tick: they say where both stood when the sighting was taken. `place`, shape (2,), is the
    subject's where it is known; else a subject that the joint does not have is a point of which nothing is known. `at`, shape (12,),
    is where to linearise instead of the observer's mean: it is no evidence. KeyError: the observer is not in the joint.
    """
    named: dict[Block, Moments] = {} if place is not None else {sighting.subject: NOTHING}
    named |= dict.fromkeys(sighting.blocks(), STANDARD)
    anchors = _anchors(joint, sighting, place)
    priors = {b: Moments(anchors.pop(b, it.mean), it.covariance) for b, it in named.items() if b not in joint}
    local = joint.among(block for block in (sighting.observer, *named) if block in joint)
    local.begin(priors, anchors)
    mean = local.mean[local.blocks[sighting.observer]]
    observer = mean if at is None else at
    back, turned = moved_in(observer, motions.get(sighting.observer), sighting.age)
    subject = None if place is not None else local.blocks[sighting.subject]
    strayed, its_heading = 0.0, None
    if subject is not None:
        place, its_heading, strayed = _seen_at(local.mean[subject], sighting, motions.get(sighting.subject))
    away = place - (observer[AXES] - back)
    camera = float(observer[HEADING] - turned - observer[BEARING])
    distance = float(np.hypot(*away))
    mine = local.blocks[sighting.observer]
    spread, heading = _spread(local, mine, subject), float(local.covariance[mine, mine][HEADING, HEADING])
    form = _polar if _prefers_polar(sighting, distance, spread, heading) else _cartesian
    seen = form(sighting, away, distance, camera, spread)
    if strayed:
        seen[4][AXES, AXES] += np.eye(2) * strayed
    if not sighting.places:
        seen = _alone(sighting, seen, spread, max(distance, NEAREST))
    residual, by_place, by_observer, by_range, noise = seen
    if its_heading is not None and sighting.kind == "pose":
        residual = np.append(residual, wrap(sighting.heading - its_heading + camera))
        by_place, by_observer = np.vstack([by_place, np.zeros(2)]), np.vstack([by_observer, np.zeros(STATES)])
        by_observer[2, [HEADING, BEARING]], by_range = (-1.0, 1.0), np.append(by_range, 0.0)
    else:
        noise = noise[AXES, AXES]
    residual = residual - by_range * (observer[RANGE] * sighting.stretched)
    by_observer[:, AXES] = -by_place
    by_observer[:, RANGE] = by_range * sighting.stretched
    jacobians: dict[Block, Array] = {sighting.observer: by_observer}
    if subject is not None:
        jacobians[sighting.subject] = np.zeros((len(residual), subject.stop - subject.start))
        jacobians[sighting.subject][:, AXES] = by_place
        if its_heading is not None:
            jacobians[sighting.subject][2:, HEADING] = 1.0
    if at is not None:
        apart = mean - at
        apart[HEADING] = wrap(float(apart[HEADING]))
        residual = residual - by_observer @ apart
    for block, sigma in sighting.blocks().items():
        jacobians[block] = by_range[:, None] * sigma
        residual = residual - jacobians[block] @ local.mean[local.blocks[block]]
    return Factor(residual, jacobians, noise, priors, anchors)


def _seen_at(state: Array, sighting: Relative, motion: Motion | None) -> tuple[Array, float | None, float]:
    """Where a subject was when it was seen, shape (2,), a robot's heading then, and what `_strayed` says of it."""
    if len(state) != STATES:
        return state[AXES], None, 0.0
    gone, turn = moved_in(state, motion, sighting.age + sighting.ahead)
    return state[AXES] - gone, float(state[HEADING]) - turn, _strayed(sighting, motion)


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
    A range or a bearing alone puts it nowhere.
    """
    if not sighting.places:
        return {}
    observer, subject = sighting.observer, sighting.subject
    is_flat, its_is_flat = _is_flat(joint, observer), place is None and _is_flat(joint, subject)
    if is_flat == its_is_flat:
        return {}
    state = joint.mean[joint.blocks[observer]].copy()
    angle = float(state[HEADING] - state[BEARING]) + sighting.bearing
    seen = sighting.range * np.array([math.cos(angle), math.sin(angle)])
    if is_flat:
        state[AXES] = (joint.mean[joint.blocks[subject]][AXES] if place is None else place) - seen
        return {observer: state}
    mean = joint.mean[joint.blocks[subject]].copy() if subject in joint else np.zeros(2)
    mean[AXES] = state[AXES] + seen
    return {subject: mean}


def _is_flat(joint: Joint, name: str) -> bool:
    """Whether a position is not known, and tied to no other block."""
    if name not in joint:
        return True
    block = joint.blocks[name]
    axes = slice(block.start, block.start + 2)
    if joint.variances[axes].sum() < FLAT:
        return False
    ties = joint.covariance[axes].copy()
    ties[:, block] = 0.0
    return not ties.any()


Form = tuple[Array, Array, Array, Array, Array]  # residual, by place, by observer's angles, by range, noise


def _polar(sighting: Relative, away: Array, distance: float, camera: float, spread: Array) -> Form:
    """Range and bearing times the distance, along and across the expected line of sight."""
    if distance < NEAREST:  # there is none: any will do
        away, distance = np.array([NEAREST, 0.0]), NEAREST
    frame = np.array([away, [-away[1], away[0]]]) / distance
    off = wrap(sighting.bearing - math.atan2(away[1], away[0]) + camera)
    residual = np.array([sighting.range - distance, distance * off])
    angles = np.zeros((2, STATES))
    angles[1, [HEADING, BEARING]] = -distance, distance
    if sighting.spread:
        noise = _turned(sighting, [1.0, distance / max(sighting.range, NEAREST)])
    else:
        radial, angular = _variances(sighting, away, distance, spread)
        noise = np.diag([radial, distance**2 * angular])
    return residual, frame, angles, np.array([1.0, 0.0]), noise


def _cartesian(sighting: Relative, away: Array, distance: float, camera: float, spread: Array) -> Form:
    """The seen position in the observer's frame."""
    c, s = math.cos(camera), math.sin(camera)
    rotation = np.array([[c, s], [-s, c]])
    expected, along = rotation @ away, sighting.along()
    angles = np.zeros((2, STATES))
    angles[:, BEARING] = QUARTER @ expected
    angles[:, HEADING] = -angles[:, BEARING]
    frame = np.stack([along, QUARTER @ along], axis=1)
    if sighting.spread:
        noise = triangle(sighting.spread)
    else:
        radial, angular = _variances(sighting, away, distance, spread)
        noise = (frame * [radial, sighting.range**2 * angular]) @ frame.T
    return sighting.range * along - expected, rotation, angles, along, noise


def _prefers_polar(sighting: Relative, distance: float, spread: Array, heading: float) -> bool:
    """Which form is the more linear one: the polar form is exact in the heading, the Cartesian one in the positions.

    The error of the first grows with the positions' variance over the distance, of the second with the heading's variance
    times the distance; a tenth of the distance does no harm to the first. A heading without error leaves the second exact.
    """
    if not sighting.places:
        return True
    if distance < NEAREST or (sighting.spread and sighting.range < distance / 2):
        return False
    (x, _), (_, y) = spread.tolist()
    return heading > EXACT and x + y < (heading + 0.01) * distance**2


def _turned(sighting: Relative, stretched: Sequence[float]) -> Array:
    """`spread` as a matrix along and across the line of sight, both axes stretched."""
    turn = np.eye(math.isqrt(2 * len(sighting.spread)))
    along = sighting.along()
    turn[AXES, AXES] = np.stack([along, QUARTER @ along]) * np.array(stretched)[:, None]
    return np.asarray(turn @ triangle(sighting.spread) @ turn.T)


def _alone(sighting: Relative, form: Form, spread: Array, distance: float) -> Form:
    """The range alone, or the bearing times the distance, of a polar form, with the second-order terms of the place's error.

    What a straight line misses of a ring is added to what is expected, and its variance to the noise (Athans, Wishner,
    Bertolini, IEEE TAC 13(5), 1968). `spread` is the covariance of the subject's place relative to the observer's, shape (2, 2).
    """
    residual, frame, angles, by_range, noise = form
    (along, tie), (_, across) = frame @ spread @ frame.T
    row = [0] if sighting.kind == "range" else [1]
    shift = np.array([across / (2 * distance), -tie / distance])
    curved = np.array([across**2 / 2, along * across + tie**2]) / distance**2
    return residual[row] - shift[row], frame[row], angles[row], by_range[row], noise[row][:, row] + curved[row]


def _spread(joint: Joint, observer: slice, subject: slice | None) -> Array:
    """Covariance of the subject's place relative to the observer's, world axes, shape (2, 2)."""
    mine = slice(observer.start, observer.start + 2)
    covariance = joint.covariance[mine, mine]
    if subject is None:
        return covariance
    its = slice(subject.start, subject.start + 2)
    cross = joint.covariance[mine, its]
    return np.asarray(covariance + joint.covariance[its, its] - cross - cross.T)


def _variances(sighting: Relative, away: Array, distance: float, spread: Array) -> tuple[float, float]:
    """Variances of range and bearing; by the profile where there is one, at the distances that joint and range leave open."""
    if not sighting.profile:
        return sighting.range_variance, sighting.bearing_variance
    distances, variances = _columns(sighting.profile)
    expected = max(distance, NEAREST)
    along = away / expected
    prior = float(along @ spread @ along)
    own = float(np.interp(sighting.range, distances, variances))
    gain = prior / (prior + own)
    middle, sigma = expected + gain * (sighting.range - expected), math.sqrt(prior * (1 - gain))
    variance = float(WEIGHTS @ np.interp(middle + sigma * NODES, distances, variances) / WEIGHT)
    return variance, variance / max(sighting.range, float(distances[0]), NEAREST) ** 2


@lru_cache(maxsize=64)
def _columns(profile: tuple[tuple[float, float], ...]) -> tuple[Array, Array]:
    """The distances and the variances of a profile, shape (pairs,) each; made once, because all sightings of a camera have one."""
    distances, variances = np.array(profile).T
    return distances, variances
