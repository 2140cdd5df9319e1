"""Sightings in coordinates in which they are nearly linear in what they depend on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from blackboard.opinion.gaussian.relation import NEAREST, Kind, Profile, Relative, triangle
from blackboard.opinion.gaussian.vehicle import AXES, wrap
from blackboard.opinion.grid import Array

TURNED = np.array([-1.0, 1.0])  # of a vector (y, x): it is turned by 90 degrees so
TINY = np.finfo(float).tiny
STRETCHED = 4.0  # times the measured range is the farthest that a subject is taken to be
EXACT = 1e-9  # radians ** 2: a heading with less variance is exact
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # for the mean over a normal distribution
WEIGHT = WEIGHTS.sum()


@dataclass(frozen=True, eq=False)
class Form:
    """k sightings in coordinates in which they are nearly linear, m numbers each."""

    residual: Array  # (k, m)
    by_place: Array  # (k, m, 2): of what is expected by the subject's place
    by_camera: Array  # (k, m): by a turn of the camera to the right
    by_range: Array  # (k, m): of what was seen by an error of the range
    noise: Array  # (k, m, m); of a pose (k, 3, 3)
    distance: Array  # (k,): to the subject as expected
    larger: Array  # (k,): the factor from the claimed errors of a range to those at the expected distance (`_larger`)


def form(its: Sequence[Relative], away: Array, camera: Array, spread: Array, heading: Array) -> Form:
    """Polar, which is range and bearing times the distance, along and across the line of sight; or the place in the observer's frame.

    The polar form is exact in the heading, the Cartesian one in the positions. The error of the first grows with the positions'
    variance over the distance, and its second-order terms are taken in (`_second_order`). It is used while the sigma of a place along
    each axis is below a seventh of the distance, or more where the heading is unsure. The error of the second grows with the
    heading's variance times the distance. A heading without error leaves it exact. An error that is Gaussian in x and y makes every
    range of the first too long, so it is borne up to the heading's alone.
    """
    places, exact = its[0].places, bool(its[0].spread)
    ranges, bearings = np.array([(sighting.range, sighting.bearing) for sighting in its]).T
    distance = np.hypot(away[:, 0], away[:, 1])
    polar = (heading > EXACT) & (spread[:, 0, 0] + spread[:, 1, 1] < 4 * (heading + 0.01) * distance**2)
    if exact:
        polar &= np.array([sighting.flat_across for sighting in its]) <= heading * distance**2
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
        stretched = [max(sighting.range, NEAREST) for sighting in its]
        noise = np.array(
            [
                sighting.spread_along(1.0, d / r) if p else triangle(sighting.spread)
                for sighting, d, r, p in zip(its, far.tolist(), stretched, polar.tolist(), strict=True)
            ]
        )
    else:
        radial, angular = _variances(its, sight, far, spread)
        radial = radial * larger**2
        axes = _frames(by_range)
        along_axes = np.array([radial, np.where(polar, far, ranges) ** 2 * angular]).T
        noise = axes.swapaxes(1, 2) @ (along_axes[:, :, np.newaxis] * axes)
    if polar.any():
        more, unsure = _second_order(by_place[polar], spread[polar], far[polar])
        residual[polar] -= more
        noise[polar, AXES, AXES] += unsure
    return Form(residual, by_place, by_camera, by_range, noise, far, larger)


def _second_order(by_place: Array, spread: Array, distance: Array) -> tuple[Array, Array]:
    """The second-order terms of a range, and of a bearing times the distance, in the error of a place.

    Their mean, shape (k, 2), and covariance, shape (k, 2, 2) (Athans, Wishner, Bertolini, IEEE TAC 13(5), 1968). Without them ranges
    are longer in the mean than expected. Where their scale is estimated, the whole map then becomes too small.
    """
    local = by_place @ spread @ by_place.swapaxes(1, 2)
    along, tie, across = local[:, 0, 0], local[:, 0, 1], local[:, 1, 1]
    mean = np.array([across / 2, -tie]).T / distance[:, np.newaxis]
    covariance = np.array([[across**2 / 2, -tie * across], [-tie * across, along * across + tie**2]])
    return mean, np.moveaxis(covariance, 2, 0) / distance[:, np.newaxis, np.newaxis] ** 2


def _larger(its: Sequence[Relative], sight: Array, distance: Array, spread: Array) -> Array:
    """How far subjects are likely to be over what was measured, where errors grow with the range; 1 of other sightings, shape (k,).

    By the errors of the measured range, one that is too short would weigh more than one that is too long, and all of them pull.
    """
    larger = np.ones(len(its))
    grow = [
        n
        for n, sighting in enumerate(its)
        if sighting.kind == "range-bearing" and sighting.biases and sighting.range >= NEAREST
    ]
    if grow:
        ranges = np.array([its[n].range for n in grow])
        own = np.array([its[n].range_variance + sum(bias.sigma**2 for bias in its[n].biases) for n in grow])
        along = sight[grow, np.newaxis, :]
        prior = np.maximum(0.0, (along @ spread[grow] @ along.swapaxes(1, 2))[:, 0, 0])
        likely = distance[grow] + prior / np.maximum(prior + own, TINY) * (ranges - distance[grow])
        larger[grow] = np.clip(likely / ranges, 1 / STRETCHED, STRETCHED)
    return larger


def _variances(its: Sequence[Relative], sight: Array, distance: Array, spread: Array) -> tuple[Array, Array]:
    """Variances of ranges and bearings; by their profile where there is one, at the distances that joint and range leave open.

    `sight` are unit vectors along the lines of sight, shape (k, 2).
    """
    if not its[0].profile:
        radial, angular = np.array([(sighting.range_variance, sighting.bearing_variance) for sighting in its]).T
        return radial, angular
    distances, variances = _columns(its[0].profile)
    ranges = np.array([sighting.range for sighting in its])
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


def of_one_number(kind: Kind, seen: Form) -> Form:
    """The range alone, or the bearing times the distance, of a polar form."""
    row = slice(0, 1) if kind == "range" else slice(1, 2)
    rows = seen.residual[:, row], seen.by_place[:, row], seen.by_camera[:, row], seen.by_range[:, row]
    return Form(*rows, seen.noise[:, row, row], seen.distance, seen.larger)


def with_heading(seen: Form, off: Array) -> Form:
    """Positions of mates with their headings in the observer's frame, which are so far off what is expected, shape (k,)."""
    one, none = np.ones((len(off), 1)), np.zeros((len(off), 1))
    return replace(
        seen,
        residual=np.hstack([seen.residual, off[:, np.newaxis]]),
        by_place=np.hstack([seen.by_place, np.zeros((len(off), 1, 2))]),
        by_camera=np.hstack([seen.by_camera, one]),
        by_range=np.hstack([seen.by_range, none]),
    )


def _unit(angles: Array) -> Array:
    """Vectors of length 1, shape (k, 2)."""
    vectors = np.empty((len(angles), 2))
    np.cos(angles, out=vectors[:, 0])
    np.sin(angles, out=vectors[:, 1])
    return vectors


def _frames(axes: Array) -> Array:
    """Of unit vectors, shape (k, 2): frames whose first axes they are, shape (k, 2, 2), axes as rows."""
    frames = np.empty((len(axes), 2, 2))
    frames[:, 0], frames[:, 1] = axes, axes[:, ::-1] * TURNED
    return frames
