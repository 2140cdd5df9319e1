"""Sightings as evidence on a joint belief: factors, linear in the blocks of both ends and of the lasting errors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.forms import Form, form, of_one_number, with_heading
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.relation import Profile, Relative
from blackboard.opinion.gaussian.vehicle import (
    AXES,
    BEARING,
    FLAT,
    HEADING,
    POSE,
    RANGE,
    STATES,
    UNSTEADY,
    Motion,
    X,
    Y,
    moved_in,
    wrap,
)
from blackboard.opinion.grid import Array

NOTHING = Moments(np.zeros(2), np.eye(2) * FLAT)  # of a subject's place
STANDARD = Moments(np.zeros(1), np.eye(1))  # of a lasting error


def linearise(
    joint: Joint, sighting: Relative, motions: Mapping[str, Motion], place: Array | None = None, at: Array | None = None
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
    for number, sighting in enumerate(sightings):
        block = None if alone or place is not None else joint.blocks.get(sighting.subject)
        alike.setdefault((sighting.kind, sighting.profile, block.stop - block.start if block else 0), []).append(number)
    by_number: dict[int, Factor] = {}
    for (_, _, states), numbers in alike.items():
        its = [sightings[number] for number in numbers]
        ends = _ends(joint, its, states, place, at)
        by_number.update(zip(numbers, _factors(joint, its, ends, _seen(its, ends, motions)), strict=True))
    return [by_number[number] for number in range(len(sightings))]


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
    index = joint.indices([sighting.observer for sighting in its], STATES)
    if states:
        index = np.concatenate([index, joint.indices([sighting.subject for sighting in its], states)], axis=1)
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


def _seen(its: Sequence[Relative], ends: _Ends, motions: Mapping[str, Motion]) -> Form:
    """K sightings of one kind, by where both ends were when they were taken."""
    stood = _stood(
        ends.observer, [motions.get(sighting.observer) for sighting in its], [sighting.age for sighting in its]
    )
    there, moves = ends.subject, [motions.get(sighting.subject) for sighting in its]
    if ends.states == STATES:
        there = _stood(there, moves, [sighting.late for sighting in its])
    else:
        there = there - np.array([sighting.gone for sighting in its])
    camera = stood[:, HEADING] - ends.observer[:, BEARING]
    seen = form(its, there[:, AXES] - stood[:, AXES], camera, ends.spread, ends.heading)
    strayed = [sighting.strayed for sighting in its]
    if ends.states == STATES:
        strayed = [_strayed(sighting, motion) for sighting, motion in zip(its, moves, strict=True)]
    seen.noise[:, X, X] += strayed
    seen.noise[:, Y, Y] += strayed
    if not its[0].places:
        return of_one_number(its[0].kind, seen)
    if its[0].kind == "pose" and ends.states == STATES:
        return with_heading(seen, wrap(np.array([sighting.heading for sighting in its]) - there[:, HEADING] + camera))
    return replace(seen, noise=seen.noise[:, AXES, AXES])


def _stood(states: Array, motions: Sequence[Motion | None], ages: Sequence[float]) -> Array:
    """Where robots (their states, shape (k, 12)) were some seconds before the end of a motion: x, y and heading, shape (k, 3)."""
    poses = states[:, POSE]
    if any(ages):
        poses = poses.copy()
        for place, state, motion, age in zip(poses, states, motions, ages, strict=True):
            back, turned = moved_in(state, motion, age)
            place[AXES] -= back
            place[HEADING] -= turned
    return poses


def _strayed(sighting: Relative, motion: Motion | None) -> float:
    """Variance, unit ** 2 in each direction, of where a robot was when it was seen outside of the tick of its motion.

    It is taken to have moved then as in the earliest motion that is kept, up to `UNSTEADY`. A sighting that is older than its
    observer's tick, too, is only stamped late.
    """
    if motion is None or motion.dt <= 0:
        return 0.0
    age = sighting.late
    outside = max(0.0, -age, age - max(motion.covered, sighting.age)) / motion.dt
    return outside * (motion.along + motion.across) + (outside * UNSTEADY * motion.way) ** 2


def _factors(joint: Joint, its: Sequence[Relative], ends: _Ends, seen: Form) -> list[Factor]:
    """The factors of k sightings of one kind."""
    is_scaled = np.array([sighting.is_scaled for sighting in its])
    stretched = seen.by_range * np.where(is_scaled, seen.distance, 0.0)[:, np.newaxis]
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
    factors = []
    for number, sighting in enumerate(its):
        jacobians: dict[Block, Array] = {sighting.observer: by_observer[number]}
        priors, anchors, rest = dict[Block, Moments](), ends.anchors[number], residual[number]
        if not ends.is_known:
            jacobians[sighting.subject] = by_subject[number]
        if not ends.is_known and not ends.states:
            priors[sighting.subject] = Moments(anchors.pop(sighting.subject, NOTHING.mean), NOTHING.covariance)
        for block, sigma in sighting.blocks().items() if sighting.biases else ():
            jacobians[block] = seen.by_range[number, :, np.newaxis] * (seen.larger[number] * sigma)
            if block in joint:
                rest = rest - jacobians[block] @ joint.mean[joint.blocks[block]]
            else:
                priors[block] = STANDARD
        factors.append(Factor(rest, jacobians, seen.noise[number], priors, anchors))
    return factors
