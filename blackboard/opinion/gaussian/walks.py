"""How fast each object moves: a bank of random walks, judged by the object's own sightings.

A multiple-model estimator (Magill 1965): each member is a Kalman filter of the object's place with a drift of its own, and its weight
is the likelihood of the sightings under it. The joint uses the root mean square of the drifts. Before anything is seen that is the
drift that was told: the prior of a drift is log-normal. A member that is far from the best begins again where that one is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Array

FACTORS = 2.0 ** np.arange(-5, 6)  # drifts of the members, of the one that was told
LEAST = float(FACTORS[0])
SPREAD = 1.0  # standard deviation of the logarithm of a drift, before anything is seen
PRIOR = (
    -0.5 * (np.log(FACTORS) / SPREAD + SPREAD) ** 2
)  # log weights; the root mean square of the drifts is then the one that was told
MEMORY = 20.0  # seconds after which what a sighting told of the drift counts for 1/e
LOST = -20.0  # log likelihood by the best one's: a member that is less likely begins again where the best one is


@dataclass
class _Bank:
    """The members of one object: log likelihoods by the largest, shape (k,), places (k, 2), covariances (k, 2, 2)."""

    likelihoods: Array
    places: Array
    covariances: Array


@dataclass
class Walks:
    """Mutable. `drift` of an object is in units / sqrt(s)."""

    _banks: dict[str, _Bank] = field(default_factory=dict)

    def copy(self) -> Walks:
        """The same, which may be changed without changing this one."""
        return Walks(dict(self._banks))

    def drift(self, subject: str, prior: float) -> float:
        """The random walk of an object as found, by what it was before anything was seen."""
        if subject not in self._banks:
            return prior
        shares = np.exp(PRIOR + self._banks[subject].likelihoods)
        return prior * math.sqrt(float(shares @ FACTORS**2) / float(shares.sum()))

    def pass_time(self, subject: str, prior: float, dt: float) -> None:
        """Let an object move for `dt` seconds."""
        bank = self._banks.get(subject)
        if bank is None:
            return
        added = (prior * FACTORS) ** 2 * dt
        covariances = bank.covariances + added[:, np.newaxis, np.newaxis] * np.eye(2)
        self._banks[subject] = _Bank(bank.likelihoods * math.exp(-dt / MEMORY), bank.places, covariances)

    def judge(self, subject: str, seen: Moments) -> None:
        """A sighting puts an object at a place: mean, shape (2,), and covariance, shape (2, 2)."""
        place, covariance = seen.mean, seen.covariance
        bank = self._banks.get(subject)
        if bank is None:
            k = len(FACTORS)
            self._banks[subject] = _Bank(np.zeros(k), np.tile(place, (k, 1)), np.tile(covariance, (k, 1, 1)))
            return
        spread = bank.covariances + covariance
        inverse = np.linalg.inv(spread)
        gains, apart = bank.covariances @ inverse, place - bank.places
        squared = np.einsum("ki,kij,kj->k", apart, inverse, apart)
        likelihoods = bank.likelihoods - 0.5 * (squared + np.log(np.linalg.det(spread)))
        likelihoods -= likelihoods.max()
        places = bank.places + np.einsum("kij,kj->ki", gains, apart)
        covariances = bank.covariances - gains @ bank.covariances
        best, lost = int(likelihoods.argmax()), likelihoods < LOST
        places[lost], covariances[lost] = places[best], covariances[best]
        covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        self._banks[subject] = _Bank(np.maximum(likelihoods, LOST), places, covariances)

    def forget(self, subject: str) -> None:
        """An object is gone, or begins anew."""
        self._banks.pop(subject, None)
