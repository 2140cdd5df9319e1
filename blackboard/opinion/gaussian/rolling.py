"""An object that rolls, and is stopped, pushed or thrown back: a bank of constant velocities, judged by its sightings.

An interacting multiple-model estimator (Blom and Bar-Shalom, IEEE TAC 33(8), 1988). Each member is a Kalman filter of place and
velocity, whose velocity does a random walk of its own. What rolls freely is the calmest member's, what bounces the wildest one's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Array

WILDNESS = np.array([0.15, 1.0, 10.0])  # 1 / s: random walks of the velocity, over the configured drift
FASTEST = 8.0  # 1 / sqrt(s): sigma of an unknown velocity, over the configured drift
STAY = 5.0  # seconds, in the mean, until an object goes over to another member
PLACE, VELOCITY = slice(0, 2), slice(2, 4)


@dataclass(frozen=True, eq=False)
class Rolling:
    """Weights of the members, shape (k,), their means (k, 4) and covariances (k, 4, 4); `told` is the drift of the settings."""

    told: float
    weights: Array
    means: Array
    covariances: Array

    @staticmethod
    def begun(seen: Moments, told: float) -> Rolling:
        """After the first sighting: of place alone."""
        k, covariance = len(WILDNESS), np.diag([0.0, 0.0, 1.0, 1.0]) * (FASTEST * told) ** 2
        covariance[PLACE, PLACE] = seen.covariance
        mean = np.concatenate([seen.mean, np.zeros(2)])
        return Rolling(told, np.full(k, 1 / k), np.tile(mean, (k, 1)), np.tile(covariance, (k, 1, 1)))

    def moments(self) -> Moments:
        """Place and velocity: mean, shape (4,), and covariance, shape (4, 4)."""
        mean = self.weights @ self.means
        apart = self.means - mean
        among = np.einsum("k,ki,kj->ij", self.weights, apart, apart)
        return Moments(mean, np.einsum("k,kij->ij", self.weights, self.covariances) + among)

    def passed(self, dt: float) -> Rolling:
        """`dt` seconds later."""
        k, stays = len(self.weights), math.exp(-dt / STAY)
        over = np.full((k, k), (1 - stays) / (k - 1)) + np.eye(k) * (stays - (1 - stays) / (k - 1))
        weights = self.weights @ over
        shares = self.weights[:, np.newaxis] * over / weights
        means = shares.T @ self.means
        apart = self.means[:, np.newaxis] - means
        covariances = np.einsum("ij,ikl->jkl", shares, self.covariances)
        covariances += np.einsum("ij,ijk,ijl->jkl", shares, apart, apart)
        step = np.eye(4) + dt * np.eye(4, k=2)
        walk = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
        noise = np.square(WILDNESS * self.told)[:, np.newaxis, np.newaxis] * walk
        covariances = step @ covariances @ step.T + noise
        known = np.minimum(1.0, (FASTEST * self.told) ** 2 / covariances[:, VELOCITY, VELOCITY].max(axis=(1, 2)))
        shrunk = np.repeat([np.ones_like(known), known], 2, axis=0).T  # of a velocity that is as good as forgotten
        means = means @ step.T * shrunk
        covariances = covariances * shrunk[:, :, np.newaxis] * shrunk[:, np.newaxis, :]
        return replace(self, weights=weights, means=means, covariances=covariances)

    def expected(self, seen: Moments) -> tuple[float, Array]:
        """The log density of a sighting, mean (2,) and covariance (2, 2), and how the members' weights are after it."""
        spread = self.covariances[:, PLACE, PLACE] + seen.covariance
        apart = seen.mean - self.means[:, PLACE]
        squared = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(spread), apart)
        logs = np.log(self.weights) - 0.5 * (squared + np.log(np.linalg.det(spread))) - math.log(2 * math.pi)
        most = float(logs.max())
        shares = np.exp(logs - most)
        return most + math.log(float(shares.sum())), shares / shares.sum()

    def seen(self, at: Moments) -> Rolling:
        """After a sighting."""
        gains = self.covariances[:, :, PLACE] @ np.linalg.inv(self.covariances[:, PLACE, PLACE] + at.covariance)
        means = self.means + np.einsum("kij,kj->ki", gains, at.mean - self.means[:, PLACE])
        covariances = self.covariances - gains @ self.covariances[:, PLACE, :]
        covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        weights = np.maximum(self.expected(at)[1], 1e-9)
        return replace(self, weights=weights / weights.sum(), means=means, covariances=covariances)


def moved(before: Moments, after: Moments) -> Moments:
    """What moves a place from one belief to another: the way, shape (2,), and the covariance that it adds, shape (2, 2)."""
    values, axes = np.linalg.eigh(after.covariance[PLACE, PLACE] - before.covariance[PLACE, PLACE])
    return Moments((after.mean - before.mean)[PLACE], (axes * np.maximum(values, 0.0)) @ axes.T)
