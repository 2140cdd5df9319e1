"""An object that rolls, and is stopped, pushed or thrown back: a bank of constant velocities, judged by its sightings.

An interacting multiple-model estimator (Blom and Bar-Shalom, IEEE TAC 33(8), 1988). Each member is a Kalman filter of place and
velocity, whose velocity does a random walk of its own. What rolls freely is the calmest member's, what bounces the wildest one's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Array

WILDNESS = np.array([0.15, 1.0, 10.0])  # 1 / s: random walks of the velocity, over the configured drift
FASTEST = 8.0  # 1 / sqrt(s): sigma of an unknown velocity, over the configured drift
FAST = 4.0  # the same of a thing without a name: if nothing is near, the next sighting is of another one
STAY = 5.0  # seconds, in the mean, until an object goes over to another member
# Sightings: what is assumed of a kind counts for so many, and after so many a sighting for 1/e.
FEW, MANY = (10.0, 1000.0)
PLACE, VELOCITY = slice(0, 2), slice(2, 4)


@dataclass(frozen=True, eq=False)
class Habits:
    """How things of a kind roll: `often`, shape (k,), how often as each member says, over how often by chance; and how fast.

    `squared` is the mean square of a velocity along one axis, over the configured drift squared (1 / s); `n` counts sightings.
    """

    often: Array = field(default_factory=lambda: np.ones(len(WILDNESS)))
    squared: float = FAST**2
    n: float = FEW

    def plus(self, one: Rolling) -> Habits:
        """After one more sighting of such a thing."""
        n = min(self.n + 1.0, MANY)
        now, k = one.moments(), len(WILDNESS)
        speed = float(np.square(now.mean[VELOCITY]).sum() + np.trace(now.covariance[VELOCITY, VELOCITY])) / 2
        squared = self.squared + (speed / one.told**2 - self.squared) / n
        return Habits(self.often + (k * one.weights - self.often) / n, squared, n)


@dataclass(frozen=True, eq=False)
class Rolling:
    """Weights of the members, shape (k,), their means (k, 4) and covariances (k, 4, 4); `told` is the drift of the settings.

    `fastest` is sigma of an unknown velocity (unit / s).
    """

    told: float
    weights: Array
    means: Array
    covariances: Array
    fastest: float

    @staticmethod
    def begun(seen: Moments, told: float, habits: Habits | None = None) -> Rolling:
        """After the first sighting: of place alone. `habits` are those of its kind."""
        fastest = (math.sqrt(habits.squared) if habits else FASTEST) * told
        k, covariance = len(WILDNESS), np.diag([0.0, 0.0, 1.0, 1.0]) * fastest**2
        covariance[PLACE, PLACE] = seen.covariance
        mean = np.concatenate([seen.mean, np.zeros(2)])
        return Rolling(told, np.full(k, 1 / k), np.tile(mean, (k, 1)), np.tile(covariance, (k, 1, 1)), fastest)

    def moments(self) -> Moments:
        """Place and velocity: mean, shape (4,), and covariance, shape (4, 4)."""
        mean = self.weights @ self.means
        apart = self.means - mean
        among = np.einsum("k,ki,kj->ij", self.weights, apart, apart)
        return Moments(mean, np.einsum("k,kij->ij", self.weights, self.covariances) + among)

    def passed(self, dt: float, often: Array | float = 1.0) -> Rolling:
        """`dt` seconds later; `often` is that of its kind's `Habits`."""
        k = len(self.weights)
        stays = max(math.exp(-dt / STAY), 1 / k)
        goes = (1 - stays) / (k - 1)
        over = np.full((k, k), goes) * often + np.eye(k) * (stays - goes)
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
        known = np.minimum(1.0, self.fastest**2 / covariances[:, VELOCITY, VELOCITY].max(axis=(1, 2)))
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
