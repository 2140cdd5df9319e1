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
    POSE,
    RANGE,
    STATES,
    Motion,
    X,
    Y,
    moved_in,
    wrap,
)
from blackboard.opinion.grid import Array

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])  # a turn by 90 degrees: the derivative of a rotation
TURNED = np.array([-1.0, 1.0])  # of a vector (y, x): it is turned so, too
UNSTEADY = (
    0.5  # share of its speed by which a robot may go faster or slower, or aside, than in the tick before or after
)
NEAREST = 1e-6  # unit: nearer than this there is no line of sight
TINY = np.finfo(float).tiny
STRETCHED = 4.0  # times the measured range is the farthest that a subject is taken to be
EXACT = 1e-9  # radians ** 2: a heading with less variance is exact
BiasBlock = tuple[str, str, str, float]  # "bias", observer, group, time constant (s)
NOTHING = Moments(np.zeros(2), np.eye(2) * FLAT)  # of a subject's place
STANDARD = Moments(np.zeros(1), np.eye(1))  # of a lasting error
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # for the mean over a normal distribution
WEIGHT = WEIGHTS.sum()

Profile = tuple[tuple[float, float], ...]  # (distance, variance) pairs
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
    profile: Profile = ()
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
    """One sighting alone, as `linearise_all` does it.

    `place`, shape (2,), is the subject's where it is known. `at`, shape (12,), is where to linearise instead of the observer's mean:
    it is no evidence.
    """
    return linearise_all(joint, [sighting], motions, place=place, at=at)[0]


def linearise_all(
    joint: Joint,
    sightings: Sequence[Relative],
    motions: Mapping[str, Motion],
    *,
    alone: bool = False,
    place: Array | None = None,
    at: Array | None = None,
) -> list[Factor]:
    """Sightings against what a joint belief expects, each by itself; the joint is not changed.

    A residual has one number for a range or a bearing alone, three for a pose of a robot, else two. `motions` are those of the tick:
    they say where both stood when the sighting was taken. A subject that the joint does not have is a point of which nothing is
    known; with `alone` every subject is. KeyError: an observer is not in the joint.
    """
    alike: dict[tuple[str, Profile, int], list[int]] = {}
    for number, it in enumerate(sightings):
        block = None if alone or place is not None else joint.blocks.get(it.subject)
        alike.setdefault((it.kind, it.profile, block.stop - block.start if block else 0), []).append(number)
    found: dict[int, Factor] = {}
    for (_, _, states), numbers in alike.items():
        its = [sightings[number] for number in numbers]
        ends = _ends(joint, its, states, place, at)
        found.update(zip(numbers, _factors(joint, its, ends, _seen(its, ends, motions)), strict=True))
    return [found[number] for number in range(len(sightings))]


@dataclass(frozen=True, eq=False)
class _Ends:
    """Both ends of k sightings as a joint has them, or as they are known."""

    observer: Array  # (k, 12): where to linearise
    apart: Array | None  # (k, 12): from there to the joint's mean, where that is somewhere else
    heading: Array  # variance of the observer's, (k,)
    subject: Array  # (k, its states), or (k, 2) of a point
    states: int  # of the subject in the joint
    is_known: bool  # where the subject is
    spread: Array  # covariance of the subject's place relative to the observer's, world axes, (k, 2, 2)
    anchors: list[dict[Block, Array]]


def _ends(joint: Joint, its: Sequence[Relative], states: int, place: Array | None, at: Array | None) -> _Ends:
    """Of sightings whose subjects have so many states in the joint; 0: they are not there."""
    index = _indices(joint, [it.observer for it in its], STATES)
    if states:
        index = np.concatenate([index, _indices(joint, [it.subject for it in its], states)], axis=1)
    covariance, mean = joint.among_each(index), joint.mean[index]
    observer, subject = mean[:, :STATES], mean[:, STATES:]
    spread = covariance[:, AXES, AXES]
    if states:
        its_axes = slice(STATES, STATES + 2)
        cross = covariance[:, AXES, its_axes]
        spread = spread + covariance[:, its_axes, its_axes] - cross - cross.swapaxes(1, 2)
    elif place is None:
        subject, spread = np.zeros((len(its), 2)), spread + np.eye(2) * FLAT
    else:
        subject = np.array([place] * len(its))
    anchors: list[dict[Block, Array]] = [{} for _ in its]
    if its[0].places:
        for number in np.flatnonzero(spread[:, 0, 0] + spread[:, 1, 1] >= FLAT).tolist():
            anchors[number] = _anchors(joint, its[number], place, bool(states))
            observer[number] = anchors[number].get(its[number].observer, observer[number])
            subject[number] = anchors[number].get(its[number].subject, subject[number])
    apart = None
    if at is not None:
        observer, apart = np.array([at] * len(its)), observer - at
        apart[:, HEADING] = wrap(apart[:, HEADING])
    return _Ends(observer, apart, covariance[:, HEADING, HEADING], subject, states, place is not None, spread, anchors)


def _indices(joint: Joint, blocks: Sequence[Block], states: int) -> npt.NDArray[np.intp]:
    """The indices of the states of some blocks of one size, shape (blocks, states)."""
    first = np.array([joint.blocks[block].start for block in blocks], dtype=np.intp)
    return np.asarray(first[:, np.newaxis] + np.arange(states))


def _factors(joint: Joint, its: Sequence[Relative], ends: _Ends, seen: _Form) -> list[Factor]:
    """The factors of k sightings of one kind."""
    stretched = seen.by_range * np.array([[it.stretched] for it in its]) * seen.larger[:, np.newaxis]
    residual = seen.residual - stretched * ends.observer[:, RANGE : RANGE + 1]
    by_observer = np.zeros((*residual.shape, STATES))
    by_observer[:, :, AXES], by_observer[:, :, RANGE] = -seen.by_place, stretched
    by_observer[:, :, HEADING], by_observer[:, :, BEARING] = -seen.by_camera, seen.by_camera
    by_subject = np.zeros((*residual.shape, ends.subject.shape[1]))
    by_subject[:, :, AXES] = seen.by_place
    if ends.states == STATES:
        by_subject[:, 2:, HEADING] = 1.0
    if ends.apart is not None:
        residual = residual - (by_observer @ ends.apart[:, :, np.newaxis])[:, :, 0]
    found = []
    for number, it in enumerate(its):
        jacobians: dict[Block, Array] = {it.observer: by_observer[number]}
        priors, anchors, rest = dict[Block, Moments](), ends.anchors[number], residual[number]
        if not ends.is_known:
            jacobians[it.subject] = by_subject[number]
        if not ends.is_known and not ends.states:
            priors[it.subject] = Moments(anchors.pop(it.subject, NOTHING.mean), NOTHING.covariance)
        for block, sigma in it.blocks().items() if it.biases else ():
            jacobians[block] = seen.by_range[number, :, np.newaxis] * (seen.larger[number] * sigma)
            if block in joint:
                rest = rest - jacobians[block] @ joint.mean[joint.blocks[block]]
            else:
                priors[block] = STANDARD
        found.append(Factor(rest, jacobians, seen.noise[number], priors, anchors))
    return found


def _seen(its: Sequence[Relative], ends: _Ends, motions: Mapping[str, Motion]) -> _Form:
    """K sightings of one kind, by where both ends were when they were taken."""
    stood = _stood(ends.observer, [motions.get(it.observer) for it in its], [it.age for it in its])
    there, moves = ends.subject, [motions.get(it.subject) for it in its]
    if ends.states == STATES:
        there = _stood(there, moves, [it.age + it.ahead for it in its])
    camera = stood[:, HEADING] - ends.observer[:, BEARING]
    seen = _form(its, there[:, AXES] - stood[:, AXES], camera, ends.spread, ends.heading)
    if ends.states == STATES:
        strayed = [_strayed(it, motion) for it, motion in zip(its, moves, strict=True)]
        seen.noise[:, X, X] += strayed
        seen.noise[:, Y, Y] += strayed
    if not its[0].places:
        return _alone(its[0].kind, seen, ends.spread)
    if its[0].kind == "pose" and ends.states == STATES:
        return _with_heading(seen, wrap(np.array([it.heading for it in its]) - there[:, HEADING] + camera))
    return replace(seen, noise=seen.noise[:, AXES, AXES])


def _with_heading(seen: _Form, off: Array) -> _Form:
    """Positions of mates with their headings in the observer's frame, which are so far off what is expected, shape (k,)."""
    one, none = np.ones((len(off), 1)), np.zeros((len(off), 1))
    return replace(
        seen,
        residual=np.hstack([seen.residual, off[:, np.newaxis]]),
        by_place=np.hstack([seen.by_place, np.zeros((len(off), 1, 2))]),
        by_camera=np.hstack([seen.by_camera, one]),
        by_range=np.hstack([seen.by_range, none]),
    )


def _stood(states: Array, motions: Sequence[Motion | None], ages: Sequence[float]) -> Array:
    """Where robots (their states, shape (k, 12)) were some seconds before the end of a motion: x, y and heading, shape (k, 3)."""
    found = states[:, POSE]
    if any(ages):
        found = found.copy()
        for place, state, motion, age in zip(found, states, motions, ages, strict=True):
            back, turned = moved_in(state, motion, age)
            place[AXES] -= back
            place[HEADING] -= turned
    return found


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


def _anchors(joint: Joint, sighting: Relative, place: Array | None, known: bool) -> dict[Block, Array]:
    """The mean of a flat position, at the place where a sighting that places its subject puts it.

    The mean of a flat position that nothing else depends on is arbitrary; a wrong one would give a wrong lever to the heading.
    """
    observer, subject = sighting.observer, sighting.subject
    is_flat, its_is_flat = _is_flat(joint, observer), place is None and not (known and not _is_flat(joint, subject))
    if is_flat == its_is_flat:
        return {}
    state = joint.mean[joint.blocks[observer]].copy()
    angle = float(state[HEADING] - state[BEARING]) + sighting.bearing
    seen = sighting.range * np.array([math.cos(angle), math.sin(angle)])
    if is_flat:
        state[AXES] = (joint.mean[joint.blocks[subject]][AXES] if place is None else place) - seen
        return {observer: state}
    mean = joint.mean[joint.blocks[subject]].copy() if known else np.zeros(2)
    mean[AXES] = state[AXES] + seen
    return {subject: mean}


def _is_flat(joint: Joint, name: str) -> bool:
    """Whether a position is not known, and tied to no other block."""
    block = joint.blocks[name]
    axes = slice(block.start, block.start + 2)
    if joint.variances[axes].sum() < FLAT:
        return False
    ties = joint.covariance[axes].copy()
    ties[:, block] = 0.0
    return not ties.any()


@dataclass(frozen=True, eq=False)
class _Form:
    """k sightings in coordinates in which they are nearly linear, m numbers each."""

    residual: Array  # (k, m)
    by_place: Array  # (k, m, 2): of what is expected by the subject's place
    by_camera: Array  # (k, m): by a turn of the camera to the right
    by_range: Array  # (k, m): of what was seen by an error of the range
    noise: Array  # (k, m, m); of a pose (k, 3, 3)
    distance: Array  # (k,): to the subject as expected
    larger: Array  # (k,): by how many times the errors of its range are larger than they were told (`_larger`)


def _form(its: Sequence[Relative], away: Array, camera: Array, spread: Array, heading: Array) -> _Form:
    """Polar, which is range and bearing times the distance, along and across the line of sight; or the place in the observer's frame.

    The polar form is exact in the heading, the Cartesian one in the positions. The error of the first grows with the positions'
    variance over the distance, of the second with the heading's variance times the distance; a tenth of the distance does no harm to
    the first. A heading without error leaves the second exact.
    """
    places, exact = its[0].places, bool(its[0].spread)
    ranges, bearings = np.array([(it.range, it.bearing) for it in its]).T
    distance = np.hypot(away[:, 0], away[:, 1])
    polar = (heading > EXACT) & (spread[:, 0, 0] + spread[:, 1, 1] < (heading + 0.01) * distance**2)
    polar = (polar & (distance >= NEAREST) & ((ranges >= distance / 2) | (not exact))) | (not places)
    far = np.maximum(distance, NEAREST)
    sight = away / far[:, np.newaxis]
    sight[distance < NEAREST] = 1.0, 0.0  # there is none: any will do
    row = polar[:, np.newaxis]
    by_place = _frames(np.where(row, sight, _unit(camera)))
    along = _unit(bearings)
    expected = (by_place @ away[:, :, np.newaxis])[:, :, 0]
    by_camera = np.where(row, 0.0, expected[:, ::-1] * TURNED)
    by_camera[polar, 1] = far[polar]
    residual = ranges[:, np.newaxis] * along - expected
    residual[polar, 0] = (ranges - far)[polar]
    residual[polar, 1] = (far * wrap(bearings - np.arctan2(sight[:, 1], sight[:, 0]) + camera))[polar]
    by_range = np.where(row, [1.0, 0.0], along)
    larger = _larger(its, sight, distance, spread)
    if exact:
        stretched = [max(it.range, NEAREST) for it in its]
        noise = np.array(
            [
                _turned(it, [1.0, d / r]) if p else triangle(it.spread)
                for it, d, r, p in zip(its, far.tolist(), stretched, polar.tolist(), strict=True)
            ]
        )
    else:
        radial, angular = _variances(its, sight, far, spread)
        radial = radial * larger**2
        axes = _frames(by_range)
        along_axes = np.array([radial, np.where(polar, far, ranges) ** 2 * angular]).T
        noise = axes.swapaxes(1, 2) @ (along_axes[:, :, np.newaxis] * axes)
    return _Form(residual, by_place, by_camera, by_range, noise, far, larger)


def _larger(its: Sequence[Relative], sight: Array, distance: Array, spread: Array) -> Array:
    """How far subjects are likely to be over what was measured, where errors grow with the range; 1 of other sightings, shape (k,).

    By the errors of the measured range, one that is too short would weigh more than one that is too long, and all of them pull.
    """
    larger = np.ones(len(its))
    grow = [n for n, it in enumerate(its) if it.kind == "range-bearing" and it.biases and it.range >= NEAREST]
    if grow:
        ranges = np.array([its[n].range for n in grow])
        own = np.array([its[n].range_variance + sum(bias.sigma**2 for bias in its[n].biases) for n in grow])
        along = sight[grow, np.newaxis, :]
        prior = np.maximum(0.0, (along @ spread[grow] @ along.swapaxes(1, 2))[:, 0, 0])
        likely = distance[grow] + prior / np.maximum(prior + own, TINY) * (ranges - distance[grow])
        larger[grow] = np.clip(likely / ranges, 1 / STRETCHED, STRETCHED)
    return larger


def _unit(angles: Array) -> Array:
    """Vectors of length 1, shape (k, 2)."""
    found = np.empty((len(angles), 2))
    np.cos(angles, out=found[:, 0])
    np.sin(angles, out=found[:, 1])
    return found


def _frames(axes: Array) -> Array:
    """Of unit vectors, shape (k, 2): frames whose first axes they are, shape (k, 2, 2), axes as rows."""
    found = np.empty((len(axes), 2, 2))
    found[:, 0], found[:, 1] = axes, axes[:, ::-1] * TURNED
    return found


def _turned(sighting: Relative, stretched: Sequence[float]) -> Array:
    """`spread` as a matrix along and across the line of sight, both axes stretched."""
    turn = np.eye(math.isqrt(2 * len(sighting.spread)))
    along = sighting.along()
    turn[AXES, AXES] = np.stack([along, QUARTER @ along]) * np.array(stretched)[:, None]
    return np.asarray(turn @ triangle(sighting.spread) @ turn.T)


def _alone(kind: Kind, form: _Form, spread: Array) -> _Form:
    """The range alone, or the bearing times the distance, of a polar form, with the second-order terms of the place's error.

    What a straight line misses of a ring is added to what is expected, and its variance to the noise (Athans, Wishner,
    Bertolini, IEEE TAC 13(5), 1968).
    """
    local = form.by_place @ spread @ form.by_place.swapaxes(1, 2)
    along, tie, across = local[:, 0, 0], local[:, 0, 1], local[:, 1, 1]
    if kind == "range":
        row, shift, curved = slice(0, 1), across / (2 * form.distance), across**2 / 2
    else:
        row, shift, curved = slice(1, 2), -tie / form.distance, along * across + tie**2
    noise = form.noise[:, row, row] + (curved / form.distance**2)[:, np.newaxis, np.newaxis]
    residual = form.residual[:, row] - shift[:, np.newaxis]
    rows = form.by_place[:, row], form.by_camera[:, row], form.by_range[:, row]
    return _Form(residual, *rows, noise, form.distance, form.larger)


def _variances(its: Sequence[Relative], sight: Array, distance: Array, spread: Array) -> tuple[Array, Array]:
    """Variances of ranges and bearings; by their profile where there is one, at the distances that joint and range leave open.

    `sight` are unit vectors along the lines of sight, shape (k, 2).
    """
    if not its[0].profile:
        radial, angular = np.array([(it.range_variance, it.bearing_variance) for it in its]).T
        return radial, angular
    distances, variances = _columns(its[0].profile)
    ranges = np.array([it.range for it in its])
    prior = np.maximum(0.0, (sight[:, np.newaxis, :] @ spread @ sight[:, :, np.newaxis])[:, 0, 0])
    own = np.interp(ranges, distances, variances)
    gain = prior / (prior + own)
    middle, sigma = distance + gain * (ranges - distance), np.sqrt(prior * (1 - gain))
    nodes = middle[:, np.newaxis] + sigma[:, np.newaxis] * NODES
    variance = np.interp(nodes, distances, variances) @ WEIGHTS / WEIGHT
    return variance, variance / np.maximum(ranges, max(float(distances[0]), NEAREST)) ** 2


@lru_cache(maxsize=64)
def _columns(profile: Profile) -> tuple[Array, Array]:
    """The distances and the variances of a profile, shape (pairs,) each; made once, because all sightings of a camera have one."""
    distances, variances = np.array(profile).T
    return distances, variances
