"""An object that rolls, and is stopped, pushed or thrown back: a bank of constant velocities, judged by its sightings.

An interacting multiple-model estimator (Blom and Bar-Shalom, IEEE TAC 33(8), 1988). Each member is a Kalman filter of place and
velocity, whose velocity does a random walk of its own and reverts to zero. What rolls freely is the calmest member's,
what bounces the wildest one's. How often things of a kind go over from one member to another is learned by online EM, with counts
that later sightings correct (Mongillo and Deneve, Neural Computation 20(7), 2008).
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
#: Prior of `Habits.transitions`: half a transition from each member to each other one (Jeffreys), at the rate that `STAY` says.
ASSUMED = 0.5 * (1.0 + (STAY * (len(WILDNESS) - 1) - 1.0) * np.eye(len(WILDNESS)))
#: No velocity walks faster (1 / s), over the square of an unknown one: the wildest of a thing without a name, as first assumed.
ABRUPT = (WILDNESS[-1] / FAST) ** 2
PLACE, VELOCITY = slice(0, 2), slice(2, 4)


@dataclass(frozen=True, eq=False)
class Habits:
    """How things of a kind roll: `transitions` (k, k) are the expected counts of all of them, as in `Rolling.transitions`.

    `squared` is the mean square of a velocity along one axis, over the configured drift squared (1 / s); `n` counts sightings.
    """

    transitions: Array = field(default_factory=lambda: np.zeros_like(ASSUMED))
    squared: float = FAST**2
    n: float = FEW

    def plus(self, one: Rolling) -> Habits:
        """After one more sighting of such a thing. Its transitions are added, so `Rolling.told_all` must follow."""
        n = min(self.n + 1.0, MANY)
        now = one.moments()
        speed = float(np.square(now.mean[VELOCITY]).sum() + np.trace(now.covariance[VELOCITY, VELOCITY])) / 2
        squared = self.squared + (speed / one.told**2 - self.squared) / n
        return Habits(self.transitions * (1.0 - 1.0 / MANY) + one.transitions(), squared, n)

    def rates(self) -> Array:
        """How often such a thing goes over from the member of a row to that of a column (1 / s), shape (k, k); 0 on the diagonal."""
        transitions = np.maximum(self.transitions, 0.0) + ASSUMED
        seconds = transitions.diagonal()
        return (transitions - np.diag(seconds)) / seconds[:, np.newaxis]


@dataclass(frozen=True, eq=False)
class Rolling:
    """Weights of the members, shape (k,), their means (k, 4) and covariances (k, 4, 4); `told` is the drift of the settings.

    `fastest` is sigma of an unknown velocity (unit / s). `histories` (k, k, k) are for each member the transitions that led to it.
    """

    told: float
    weights: Array
    means: Array
    covariances: Array
    fastest: float
    histories: Array = field(default_factory=lambda: np.zeros((len(WILDNESS),) * 3))

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

    def transitions(self) -> Array:
        """How often it went over from the member of a row to that of a column, and on the diagonal how long it stayed (s), (k, k).

        Expected after all sightings so far, since they were told last (`told_all`).
        """
        transitions: Array = np.einsum("k,kij->ij", self.weights, self.histories)
        return transitions

    def told_all(self) -> Rolling:
        """Start counting anew, after `transitions` was used: only differences between the members' histories are kept."""
        return replace(self, histories=self.histories - self.transitions())

    def passed(self, dt: float, rates: Array | None = None) -> Rolling:
        """`dt` seconds later; `rates` (1 / s), shape (k, k), are those of its kind's `Habits`."""
        k, here = len(self.weights), np.eye(len(self.weights))
        rates = (1.0 - here) / ((k - 1) * STAY) if rates is None else rates
        leaves = rates.sum(axis=1)
        stays = np.maximum(np.exp(-dt * leaves), 1 / k)
        over = ((1 - stays) / leaves)[:, np.newaxis] * rates + np.diag(stays)
        weights = self.weights @ over
        # the probability that it came from the member of the row, if it is at that of the column
        shares = self.weights[:, np.newaxis] * over / weights
        histories = np.einsum("ij,ikl->jkl", shares, self.histories)
        before, after = np.indices((k, k))
        histories[after, before, before] += dt * shares
        histories[after, before, after] += (1 - here) * shares
        means = shares.T @ self.means
        apart = self.means[:, np.newaxis] - means
        covariances = np.einsum("ij,ikl->jkl", shares, self.covariances)
        covariances += np.einsum("ij,ijk,ijl->jkl", shares, apart, apart)
        walks = np.minimum(np.square(WILDNESS * self.told), ABRUPT * self.fastest**2)
        step, noise = _ornstein_uhlenbeck(walks, self.fastest, dt)
        means = np.einsum("kij,kj->ki", step, means)
        covariances = step @ covariances @ step.swapaxes(1, 2) + noise
        return replace(self, weights=weights, means=means, covariances=covariances, histories=histories)

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


def _ornstein_uhlenbeck(walks: Array, fastest: float, dt: float) -> tuple[Array, Array]:
    """The transition of place and velocity over `dt` seconds, and the covariance of its noise; both of shape (k, 4, 4).

    The velocity is an Ornstein-Uhlenbeck process (Millefiori, Braca, Bryan and Willett, IEEE TAES 52(5), 2016). It walks by `walks`
    (unit^2 / s^3), shape (k,), along each axis, and reverts to 0 such that in the long run its sigma is `fastest` (unit / s).
    """
    decay = 0.5 * walks / fastest**2 * dt
    once, twice = _mean_of_fading(decay), _mean_of_fading(2.0 * decay)
    small = decay < 1e-3  # where the differences below cancel: their series
    spread = np.where(small, 1 / 3 - decay / 4, (1.0 - 2.0 * once + twice) / np.where(small, 1.0, decay) ** 2)
    step = np.array([[np.ones_like(decay), dt * once], [np.zeros_like(decay), np.exp(-decay)]])
    noise = walks * np.array([[dt**3 * spread, 0.5 * (dt * once) ** 2], [0.5 * (dt * once) ** 2, dt * twice]])
    return _of_both_axes(step), _of_both_axes(noise)


def _mean_of_fading(decay: Array) -> Array:
    """The mean of e^-x for x from 0 to `decay`, of each element."""
    return np.divide(-np.expm1(-decay), decay, out=np.ones_like(decay), where=decay > 0.0)


def _of_both_axes(blocks: Array) -> Array:
    """(2, 2, k) for place and velocity along one axis, as (k, 4, 4) for x and y."""
    return np.kron(blocks.transpose(2, 0, 1), np.eye(2))


def moved(before: Moments, after: Moments) -> Moments:
    """What moves a place from one belief to another: the way, shape (2,), and the covariance that it adds, shape (2, 2)."""
    values, axes = np.linalg.eigh(after.covariance[PLACE, PLACE] - before.covariance[PLACE, PLACE])
    return Moments((after.mean - before.mean)[PLACE], (axes * np.maximum(values, 0.0)) @ axes.T)
