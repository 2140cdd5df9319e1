"""The poses, lasting errors and noise that make a team's readings likeliest: Gauss-Newton steps inside, noise found outside.

A smoother over all robots at once, with landmarks, mates and the future; the truth is not asked for. A sighting is a misread by a
mixture: Gaussian, or anywhere in view. Noise is found by variance components: the squared residuals of each kind over what they
would be if they had been free (MacKay, Neural Computation 4(3), 1992; Harville, JASA 72, 1977).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from blackboard.calibrate.chain import Factors, NormalEquations, Solved
from blackboard.calibrate.drives import Drives
from blackboard.calibrate.model import EACH, EXPECTED, WIDE, Model, Noise
from blackboard.calibrate.start import first_poses
from blackboard.opinion.grid import Array

STEPS, HALVED = 10, 6  # Gauss-Newton steps at most, and how often one is halved
SETTLED = 0.1  # nats: a step that gains less is the last
ROUNDS, WORTH = 10, 2.0  # in which noise is found, at most; and the nats that one must gain for another to follow
ANNEALED = (4.0, 2.0)  # times the noise of the readings, of first rounds that look for the way
ANYWHERE = 1e-4  # one over the variance of a first pose: nothing is known of it
BLOCK = 20.0  # seconds: errors that are farther apart count as independent
FEWEST = 20.0  # free numbers below which noise stays as it was


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the shared numbers (N, 9) before: their mean, and the inverse of their covariance (9 N, 9 N)."""

    mean: Array
    information: Array

    @staticmethod
    def wide(robots: int) -> "Prior":
        return Prior(np.tile(EXPECTED, (robots, 1)), np.diag(np.tile(1 / WIDE**2, robots)))


@dataclass(frozen=True, eq=False)
class Guess:
    """All measurements at some poses and shared numbers."""

    model: Model
    poses: Array  # (K, N, 3)
    shared: Array  # (N, 9)
    noise: Noise
    prior: Prior
    odometry: Factors
    sighted: Factors  # each with the weight that it counts with
    believed: Array  # (M,): the probability that a sighting is no misread
    absolute: tuple[Factors, Factors]
    density: float  # its logarithm, of all that was measured and of the poses and shared numbers

    @staticmethod
    def at(model: Model, poses: Array, shared: Array, noise: Noise, prior: Prior) -> "Guess":
        odometry, sighted = model.odometry(poses, shared, noise), model.sightings(poses, shared, noise)
        believed, density = _believed(model, sighted, noise)
        absolute = model.fixes(poses), model.headings(poses)
        density += sum(_log_density(factors) for factors in (odometry, *absolute))
        off = (prior.mean - shared).ravel()
        density += 0.5 * (np.linalg.slogdet(prior.information / (2 * math.pi))[1] - off @ prior.information @ off)
        density += 1.5 * poses.shape[1] * math.log(ANYWHERE / (2 * math.pi))
        weighed = replace(sighted, weight=sighted.weight * believed[:, None])
        return Guess(model, poses, shared, noise, prior, odometry, weighed, believed, absolute, float(density))

    def chain(self) -> NormalEquations:
        chain = NormalEquations.of(self.poses.shape[0], self.poses.shape[1], EACH)
        for factors in (self.odometry, self.sighted, *self.absolute):
            chain.add(factors)
        each = range(3 * self.poses.shape[1])
        chain.diagonal[0, each, each] += ANYWHERE
        chain.corner[...] += self.prior.information
        chain.shared_right[...] += self.prior.information @ (self.prior.mean - self.shared).ravel()
        return chain

    def fit(self) -> "Fit":
        solved = self.chain().solved()
        unknown = self.poses.size + self.shared.size
        evidence = self.density + 0.5 * (unknown * math.log(2 * math.pi) - solved.log_determinant)
        return Fit(**vars(self), solved=solved, evidence=float(evidence))


@dataclass(frozen=True, eq=False)
class Fit(Guess):
    """What was found of some drives: the likeliest guess."""

    solved: Solved
    evidence: float  # nats: of all that was measured

    @property
    def drives(self) -> Drives:
        return self.model.drives

    @property
    def misread(self) -> float:
        """The share of the sightings that are misreads."""
        return 1.0 - float(self.believed.mean()) if len(self.believed) else 0.0


def smoothed(model: Model, poses: Array, shared: Array, noise: Noise, prior: Prior, anew: Callable[[], None]) -> Fit:
    """The likeliest poses and shared numbers from a first guess on; a step that makes them less likely is halved.

    `anew` is called before each step.
    """
    here = Guess.at(model, poses, shared, noise, prior)
    for _ in range(STEPS):
        anew()
        solved = here.chain().solved()
        step, other = solved.poses.reshape(poses.shape), solved.shared.reshape(shared.shape)
        size = min(1.0, 1.0 / max(1e-9, float(np.abs(step[:, :, 2]).max())))  # radians, at most
        for _ in range(HALVED):
            there = Guess.at(model, here.poses + size * step, here.shared + size * other, noise, prior)
            if there.density > here.density:
                break
            size /= 2
        else:
            break
        gained, here = there.density - here.density, there
        if gained < SETTLED:
            break
    return here.fit()


def _log_density(factors: Factors) -> float:
    return float(0.5 * (np.log(factors.weight / (2 * math.pi)) - factors.weight * factors.residual**2).sum())


def _believed(model: Model, sighted: Factors, noise: Noise) -> tuple[Array, float]:
    """The probability that each sighting is no misread, shape (M,), and the logarithm of the density of all."""
    seen = model.drives.sightings
    if not len(seen.tick):
        return np.zeros(0), 0.0
    share = noise.misread[seen.robot]
    inside = np.log1p(-share) + 0.5 * (
        np.log(sighted.weight / (2 * math.pi)) - sighted.weight * sighted.residual**2
    ).sum(axis=1)
    anywhere = np.log(share) - math.log(2 * math.pi * max(1e-3, float(seen.range.max())))
    both = np.logaddexp(inside, anywhere)
    return np.exp(inside - both), float(both.sum())


def fitted(drives: Drives, track: float, anew: Callable[[], None] = lambda: None, begin: Fit | None = None) -> Fit:
    """Poses, lasting errors and noise of some drives; `track` is from wheel to wheel (unit). `anew` is called at each step.

    `begin` is a fit of the same drives, with other sightings, to go on from.
    """
    model, robots = Model(drives, track), len(drives.robots)
    prior, noise = Prior.wide(robots), Noise.usual(robots)
    shared, poses = prior.mean, np.zeros((0, 0, 0))
    for factor in ANNEALED if begin is None else ():  # each time from a way that is led by what was found
        fit = smoothed(model, first_poses(model, shared), shared, noise.times(factor), prior, anew)
        poses, shared = fit.poses, fit.shared
    if begin is not None:
        poses, shared, noise = begin.poses, begin.shared, begin.noise
    before = -math.inf
    for _ in range(ROUNDS):
        fit = smoothed(model, poses, shared, noise, prior, anew)
        poses, shared = fit.poses, fit.shared
        if fit.evidence - before < WORTH:
            break
        before, noise = fit.evidence, found_noise(fit)
    return fit


def found_noise(fit: Fit) -> Noise:
    """The noise that explains the residuals of a fit, robot by robot."""
    drives, noise, robots = fit.drives, fit.noise, len(fit.drives.robots)
    moving, standing = noise.moving.copy(), noise.standing.copy()
    variance = fit.solved.variances(fit.odometry)
    owner = fit.odometry.shared[0][0]
    tick = fit.odometry.poses[0][0]
    whole = fit.model.moving(fit.shared)[tick, owner] / drives.dt[tick]
    measured = drives.measured[tick, owner]
    for n in range(robots):
        for table, some in ((moving, whole > 0.9), (standing, whole < 0.1)):
            rows = (owner == n) & some & measured
            weight = fit.odometry.weight[rows]
            free = (1 - np.minimum(1.0, variance[rows] * weight)).sum(axis=0)
            energy = (fit.odometry.residual[rows] ** 2 * weight).sum(axis=0)
            enough = free > 0.02 * FEWEST
            table[n] = np.where(enough, table[n] * np.clip(energy / np.maximum(free, 1e-9), 0.1, 10.0), table[n])
    floor, share, bearing, misread = (
        numbers.copy() for numbers in (noise.floor, noise.share, noise.bearing, noise.misread)
    )
    seen, spread = drives.sightings, fit.solved.variances(fit.sighted)
    for n in range(robots):
        rows = seen.robot == n
        believed = fit.believed[rows]
        misread[n] = (1 - believed).sum() / max(1.0, len(believed)) * 0.999 + 0.0005
        if believed.sum() < FEWEST:
            continue
        squared = fit.sighted.residual[rows] ** 2 + spread[rows]
        distance = seen.range[rows]
        floor[n], share[n] = _range_noise(squared[:, 0], distance, believed)
        weight = believed / bearing[n] ** 2
        free = (believed - np.minimum(1.0, spread[rows, 1] * weight)).sum()
        bearing[n] = bearing[n] * math.sqrt(float((fit.sighted.residual[rows, 1] ** 2 * weight).sum()) / max(free, 1.0))
    return Noise(moving, standing, floor, share, bearing, misread)


def _range_noise(squared: Array, distance: Array, believed: Array) -> tuple[float, float]:
    """Floor and share of the sigma of ranges that make squared errors likeliest."""
    floors, shares = np.geomspace(0.003, 0.6, 60), np.append(0.0, np.geomspace(0.003, 0.6, 60))
    variance = floors[:, None, None] ** 2 + (shares[None, :, None] * distance) ** 2
    likelihood = -(believed * (np.log(variance) + squared / variance)).sum(axis=2)
    one, other = np.unravel_index(int(likelihood.argmax()), likelihood.shape)
    return float(floors[one]), float(shares[other])


def covariance(fit: Fit, prior: Prior) -> Array:
    """Of the shared numbers (9 N, 9 N), by how much the parts of the drive differ: errors that follow each other are alike.

    The sandwich of White (Econometrica 50(1), 1982) over blocks of time; never less than what the fit claims.
    """
    number = np.floor(fit.drives.times / BLOCK).astype(int)
    number -= number.min()
    scores = np.zeros((int(number.max()) + 1, fit.shared.size))
    for factors in (fit.odometry, fit.sighted):
        by = np.einsum("mis,mi->ms", fit.solved.profile(factors), factors.weight * factors.residual)
        np.add.at(scores, number[factors.poses[0][0]], by)
    used = len(np.unique(number))
    off = (prior.mean - fit.shared).ravel()
    scores += prior.information @ off / len(scores)
    claimed = fit.solved.covariance
    varied = claimed @ scores.T @ scores @ claimed * used / max(1, used - 1)
    more = np.maximum(1.0, np.diag(varied) / np.diag(claimed)) ** 0.5
    return np.asarray(claimed * np.outer(more, more))


def scored(drives: Drives, track: float, noise: Noise, prior: Prior, anew: Callable[[], None] = lambda: None) -> float:
    """The logarithm (nats) of the density of drives that were not fitted, by a noise and a prior."""
    model = Model(drives, track)
    poses, shared = first_poses(model, prior.mean), prior.mean
    for factor in (*ANNEALED, 1.0):
        fit = smoothed(model, poses, shared, noise.times(factor), prior, anew)
        poses, shared = fit.poses, fit.shared
    return fit.evidence
