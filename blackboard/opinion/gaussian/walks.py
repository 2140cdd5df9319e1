"""How each object moves: a bank of random walks, and one of constant velocities (`rolling`), judged by the object's own sightings.

A multiple-model estimator (Magill 1965): each member is a Kalman filter of the object's place with a drift of its own, and its weight
is the likelihood of the sightings under it. The joint uses the root mean square of the drifts. Before anything is seen that is the
drift that was told: the prior of a drift is log-normal. A member that is far from the best begins again where that one is.
An object walks until its sightings say beyond doubt that it rolls (`ROLLS`), and again once they say no more than that it may.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.rolling import VELOCITY, Habits, Rolling, moved
from blackboard.opinion.grid import Array

FACTORS = 2.0 ** np.arange(-5, 6)  # drifts of the members, as multiples of the configured drift
LEAST = float(FACTORS[0])
SPREAD = 1.0  # standard deviation of the logarithm of a drift, before anything is seen
#: Log weights, such that the root mean square of the drifts is the configured drift.
PRIOR = -0.5 * (np.log(FACTORS) / SPREAD + SPREAD) ** 2
MEMORY = 20.0  # seconds after which the evidence of a sighting about the drift counts for 1/e
LOST = -20.0  # log likelihood by the best one's: a member that is less likely begins again where the best one is
#: Nats by which rolling explains the sightings better: from there on it rolls; below that it walks again.
ROLLS, WALKS = (3.0, 0.0)
SUREST = 10.0  # nats: the most that is held for or against, so that an object that begins to roll is soon found to
Model = Literal["learn", "walk", "roll"]  # of an object: which of the two its sightings show, or one of them for good


@dataclass
class _Bank:
    """The members of one object: log likelihoods by the largest, shape (k,), places (k, 2), covariances (k, 2, 2)."""

    likelihoods: Array
    places: Array
    covariances: Array


@dataclass(frozen=True)
class _Course:
    """Of an object that may roll: how, by how much that explains its sightings better (nats), and whether it is believed to."""

    rolling: Rolling
    evidence: float
    rolls: bool
    kind: str = ""  # the class of a track, whose things move alike


@dataclass
class Walks:
    """Mutable. `drift` of an object is in units / sqrt(s)."""

    _banks: dict[str, _Bank] = field(default_factory=dict)
    _courses: dict[str, _Course] = field(default_factory=dict)
    _habits: dict[str, Habits] = field(default_factory=dict)  # of things without a name, by class

    def copy(self) -> "Walks":
        """The same, which may be changed without changing this one."""
        return Walks(dict(self._banks), dict(self._courses), dict(self._habits))

    def drift(self, subject: str, prior: float) -> float:
        """The random walk of an object as found, by what it was before anything was seen."""
        if subject not in self._banks:
            return prior
        shares = np.exp(PRIOR + self._banks[subject].likelihoods)
        return prior * math.sqrt(float(shares @ FACTORS**2) / float(shares.sum()))

    def velocity(self, subject: str) -> Moments | None:
        """The velocity (unit / s) of an object that rolls: mean, shape (2,), and covariance, shape (2, 2); None of one that walks."""
        course = self._courses.get(subject)
        if course is None or not course.rolls:
            return None
        now = course.rolling.moments()
        return Moments(now.mean[VELOCITY], now.covariance[VELOCITY, VELOCITY])

    def rolling(self, subject: str, place: Moments, prior: float, kind: str) -> Rolling:
        """An object's motion by its own sightings; before its second sighting, the prior of its class."""
        course = self._courses.get(subject)
        return course.rolling if course else Rolling.begun(place, prior, self._habits_of(kind))

    def pass_time(self, subject: str, prior: float, dt: float, model: Model = "learn", kind: str = "") -> Moments:
        """Let an object move for `dt` seconds: the way that it goes, shape (2,), and the covariance of that, shape (2, 2).

        What is a track of some `kind` moves as things of that kind were seen to move.
        """
        walk = Moments(np.zeros(2), np.eye(2) * self.drift(subject, prior) ** 2 * dt)
        bank = self._banks.get(subject)
        if bank is None:
            return walk
        added = (prior * FACTORS) ** 2 * dt
        covariances = bank.covariances + added[:, np.newaxis, np.newaxis] * np.eye(2)
        self._banks[subject] = _Bank(bank.likelihoods * math.exp(-dt / MEMORY), bank.places, covariances)
        if model == "walk" or not prior:  # what has no drift stands for good
            return walk
        course = self._courses.get(subject)
        if course is None:
            seen = Moments(bank.places[0], bank.covariances[0])
            course = _Course(Rolling.begun(seen, prior, self._habits_of(kind)), 0.0, model == "roll", kind)
        habits = self._habits_of(kind)
        after = course.rolling.passed(dt, habits.often if habits else 1.0)
        evidence = course.evidence * math.exp(-dt / MEMORY) if model == "learn" else math.inf
        self._courses[subject] = replace(course, rolling=after, evidence=evidence)
        return moved(course.rolling.moments(), after.moments()) if course.rolls else walk

    def judge(self, subject: str, seen: Moments) -> Moments | None:
        """A sighting puts an object at a place: mean, shape (2,), and covariance, shape (2, 2).

        Returned is what has to be made up for, as by `pass_time`: an object that rolls was just pushed, or thrown back.
        """
        place, covariance = seen.mean, seen.covariance
        bank = self._banks.get(subject)
        if bank is None:
            k = len(FACTORS)
            self._banks[subject] = _Bank(np.zeros(k), np.tile(place, (k, 1)), np.tile(covariance, (k, 1, 1)))
            return None
        spread = bank.covariances + covariance
        inverse = np.linalg.inv(spread)
        gains, apart = bank.covariances @ inverse, place - bank.places
        squared = np.einsum("ki,kij,kj->k", apart, inverse, apart)
        news = -0.5 * (squared + np.log(np.linalg.det(spread)))
        hindsight = self._roll(subject, seen, _mean_log(PRIOR + bank.likelihoods, news) - math.log(2 * math.pi))
        likelihoods = bank.likelihoods + news
        likelihoods -= likelihoods.max()
        places = bank.places + np.einsum("kij,kj->ki", gains, apart)
        covariances = bank.covariances - gains @ bank.covariances
        best, lost = int(likelihoods.argmax()), likelihoods < LOST
        places[lost], covariances[lost] = places[best], covariances[best]
        covariances = 0.5 * (covariances + covariances.swapaxes(1, 2))
        self._banks[subject] = _Bank(np.maximum(likelihoods, LOST), places, covariances)
        return hindsight

    def _roll(self, subject: str, seen: Moments, walking: float) -> Moments | None:
        """The same for an object that may roll; `walking` is the log density of the sighting if it walks."""
        course = self._courses.get(subject)
        if course is None:
            return None
        rolling = course.rolling
        density, weights = rolling.expected(seen)
        evidence = float(np.clip(course.evidence + density - walking, -SUREST, SUREST))
        rolls = evidence > (WALKS if course.rolls else ROLLS)
        after = rolling.seen(seen)
        self._courses[subject] = replace(course, rolling=after, evidence=evidence, rolls=rolls)
        if course.kind:
            self._habits[course.kind] = (self._habits_of(course.kind) or Habits()).plus(after)
        return moved(rolling.moments(), replace(rolling, weights=weights).moments()) if rolls else None

    def _habits_of(self, kind: str) -> Habits | None:
        return self._habits.get(kind, Habits()) if kind else None

    def rename(self, subject: str, name: str) -> None:
        """An object has another name from now on."""
        if subject in self._banks:
            self._banks[name] = self._banks.pop(subject)
        if subject in self._courses:
            self._courses[name] = self._courses.pop(subject)

    def forget(self, subject: str) -> None:
        """An object is gone, or begins anew."""
        self._banks.pop(subject, None)
        self._courses.pop(subject, None)


def _mean_log(weights: Array, logs: Array) -> float:
    """The logarithm of a mean of exp(logs), by weights that are given as logarithms, too."""
    shares = np.exp(weights - weights.max())
    most = float(logs.max())
    return most + math.log(float(shares @ np.exp(logs - most)) / float(shares.sum()))
