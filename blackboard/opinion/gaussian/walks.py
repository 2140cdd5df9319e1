"""How each object moves: a bank of random walks, and one of constant velocities (`rolling`), judged by the object's own sightings.

A multiple-model estimator (Magill 1965): each member is a Kalman filter of the object's place with a drift of its own, and its weight
is the likelihood of the sightings under it. The joint uses the root mean square of the drifts. Before anything is seen that is the
drift that was told: half of all objects stand, and the drifts of the others are log-normal. What one robot alone sees is not taken to
stand so soon. A member that is far from the best begins again where that one is.
An object walks until its sightings say beyond doubt that it rolls (`ROLLS`), and again once they say no more than that it may.
A sighting far from where all members expect one counts as a misread and changes nothing. If the next sighting is near it, the object
was moved: its bank begins anew there.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.rolling import PLACE, VELOCITY, Habits, Rolling, moved
from blackboard.opinion.grid import Array

FACTORS = 2.0 ** np.arange(-5, 6)  # drifts of the members, as multiples of the configured drift
LEAST = float(FACTORS[0])
SPREAD = 1.0  # standard deviation of the logarithm of a drift, before anything is seen
#: Log weights of drifts that are log-normal, such that their root mean square is the configured drift.
WALKERS = -0.5 * (np.log(FACTORS) / SPREAD + SPREAD) ** 2


def _some_stand(faster: float) -> Array:
    """Log weights, shape (k,), where some objects stand, with the least drift, and the others walk `faster` than by `WALKERS`.

    The share that stands is such that the root mean square of all drifts is the configured one.
    """
    walking = np.exp(-0.5 * (np.log(FACTORS / faster) / SPREAD + SPREAD) ** 2)
    walking /= walking.sum()
    mean_square = float(walking @ FACTORS**2)
    share = (mean_square - 1.0) / (mean_square - LEAST**2)
    shares = (1.0 - share) * walking
    shares[0] += share
    logs: Array = np.log(shares)
    return logs


#: Log weights such that half of all objects stand. By `WALKERS` a post that stood for a minute still counted as drifting. Robots that
#: saw it gained little by that.
PRIOR = _some_stand(math.sqrt(2.0))
MEMORY = 20.0  # seconds after which the evidence of a sighting about the drift counts for 1/e
LOST = -20.0  # log likelihood by the best one's: a member that is less likely begins again where the best one is
#: Nats by which rolling explains the sightings better: from there on it rolls; below that it walks again.
ROLLS, WALKS = (3.0, 0.0)
#: Nats by which walking explains the sightings better: from there on they also move a robot that alone sees the object. These are the
#: odds of all gates, 999 to 1. With lower odds a slowly rolling object was taken for a turn of the observer.
SURELY_WALKS = math.log(999.0)
SUREST = 10.0  # nats: the most that is held for or against, so that an object that begins to roll is soon found to
#: nats: a sighting that is so much less likely than one at the expected place counts as a misread.
UNLIKELY = 0.5 * quantile(GATE, 2)
Model = Literal["learn", "walk", "roll"]  # of an object: which of the two its sightings show, or one of them for good


@dataclass(frozen=True, eq=False)
class _Bank:
    """The members of one object: log likelihoods by the largest, shape (k,), places (k, 2), covariances (k, 2, 2)."""

    likelihoods: Array
    places: Array
    covariances: Array

    @staticmethod
    def begun(seen: Moments) -> "_Bank":
        k = len(FACTORS)
        return _Bank(np.zeros(k), np.tile(seen.mean, (k, 1)), np.tile(seen.covariance, (k, 1, 1)))

    def place(self) -> Array:
        """Where the likeliest member has the object."""
        place: Array = self.places[int(self.likelihoods.argmax())]
        return place

    def passed(self, dt: float, prior: float) -> "_Bank":
        added = (prior * FACTORS) ** 2 * dt
        covariances = self.covariances + added[:, np.newaxis, np.newaxis] * np.eye(2)
        return _Bank(self.likelihoods * math.exp(-dt / MEMORY), self.places, covariances)

    def expected(self, seen: Moments) -> Array:
        """The log density of a sighting by each member, shape (k,)."""
        spread = self.covariances + seen.covariance
        apart = seen.mean - self.places
        squared = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(spread), apart)
        logs: Array = -0.5 * (squared + np.log(np.linalg.det(spread)))
        return logs

    def density(self, news: Array) -> float:
        """The log density by all members, of that by each."""
        return _mean_log(PRIOR + self.likelihoods, news)

    def factor(self, prior: Array) -> float:
        """The root mean square of the drifts over the configured one, by log weights before anything was seen, shape (k,)."""
        shares = np.exp(prior + self.likelihoods)
        return math.sqrt(float(shares @ FACTORS**2) / float(shares.sum()))

    def explains(self, seen: Moments) -> bool:
        most = -0.5 * np.log(np.linalg.det(self.covariances + seen.covariance))
        return self.density(self.expected(seen)) > self.density(most) - UNLIKELY

    def after(self, seen: Moments, news: Array) -> "_Bank":
        """After a sighting of which each member's log density is given, shape (k,)."""
        gains, apart = self.covariances @ np.linalg.inv(self.covariances + seen.covariance), seen.mean - self.places
        likelihoods = self.likelihoods + news
        likelihoods -= likelihoods.max()
        places = self.places + np.einsum("kij,kj->ki", gains, apart)
        covariances = self.covariances - gains @ self.covariances
        best, lost = int(likelihoods.argmax()), likelihoods < LOST
        places[lost], covariances[lost] = places[best], covariances[best]
        return _Bank(np.maximum(likelihoods, LOST), places, 0.5 * (covariances + covariances.swapaxes(1, 2)))


@dataclass(frozen=True, eq=False)
class _Course:
    """Of an object that may roll: how, by how much that explains its sightings better (nats), and whether it is believed to."""

    rolling: Rolling
    evidence: float
    rolls: bool
    kind: str = ""  # the class of a track, whose things move alike

    def explains(self, seen: Moments) -> bool:
        expected = self.rolling.moments().mean[PLACE]
        most, density = (self.rolling.expected(Moments(place, seen.covariance))[0] for place in (expected, seen.mean))
        return density > most - UNLIKELY

    def after(self, seen: Moments, walking: float) -> "tuple[_Course, Moments | None]":
        """After a sighting whose log density is `walking` if the object walks; and what has to be made up for if it was pushed."""
        density, weights = self.rolling.expected(seen)
        evidence = float(np.clip(self.evidence + density - walking, -SUREST, SUREST))
        rolls = evidence > (WALKS if self.rolls else ROLLS)
        pushed = moved(self.rolling.moments(), replace(self.rolling, weights=weights).moments()) if rolls else None
        return replace(self, rolling=self.rolling.seen(seen), evidence=evidence, rolls=rolls), pushed


@dataclass(frozen=True, eq=False)
class _Motion:
    """How one object moves. It has no course before time has passed, nor where it stands for good."""

    bank: _Bank
    course: _Course | None = None

    def explains(self, seen: Moments) -> bool:
        """Whether a sighting is not far less likely than one where the object should be."""
        course = self.course
        return (course is not None and course.rolls and course.explains(seen)) or self.bank.explains(seen)

    def after(self, seen: Moments) -> "tuple[_Motion, Moments | None]":
        """After a sighting; and what has to be made up for if the object rolls and was pushed."""
        news, course, pushed = self.bank.expected(seen), self.course, None
        if course is not None:
            course, pushed = course.after(seen, self.bank.density(news) - math.log(2 * math.pi))
        return _Motion(self.bank.after(seen, news), course), pushed

    def kicked(self, seen: Moments) -> "_Motion":
        """After a sighting of an object that was moved there: its drift is unknown again, and it may roll."""
        course = self.course
        return _Motion(
            _Bank.begun(seen), course and replace(course, rolling=course.rolling.seen(seen), evidence=0.0, rolls=True)
        )


@dataclass(frozen=True, eq=False)
class _Since:
    """How an object was moved on since its last sighting, and its motion then (`kicked`: if that sighting was right)."""

    motion: _Motion | None = None
    kicked: _Motion | None = None
    seconds: float = 0.0
    way: Array = field(default_factory=lambda: np.zeros(2))
    covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))

    def plus(self, way: Moments, dt: float) -> "_Since":
        covariance = self.covariance + way.covariance
        return replace(self, seconds=self.seconds + dt, way=self.way + way.mean, covariance=covariance)


@dataclass
class Walks(Copyable):
    """Mutable. `drift` of an object is in units / sqrt(s)."""

    _motions: dict[str, _Motion] = field(default_factory=dict)
    #: Object -> its motion if its last sighting, which counts as a misread, was right.
    _kicked: dict[str, _Motion] = field(default_factory=dict)
    _since: dict[str, _Since] = field(default_factory=dict)
    _habits: dict[str, Habits] = field(default_factory=dict)  # of things without a name, by class
    #: Object that one robot alone sees -> its drift over the configured one when several saw it last.
    _agreed: dict[str, float] = field(default_factory=dict)

    def begin(self, subject: str, place: Moments) -> None:
        """Begin to estimate the motion of an object from its place in the joint, mean (2,) and covariance (2, 2)."""
        if subject not in self._motions:
            self._motions[subject] = _Motion(_Bank.begun(place))

    def drift(self, subject: str, prior: float) -> float:
        """The random walk of an object as found, by what it was before anything was seen; one robot alone shows no faster one."""
        return prior * min(self._factor(subject), max(1.0, self._agreed.get(subject, math.inf)))

    def _factor(self, subject: str) -> float:
        """The random walk of an object as found, over the configured one."""
        if subject not in self._motions:
            return 1.0
        return self._motions[subject].bank.factor(WALKERS if subject in self._agreed else PRIOR)

    def rolls(self, subject: str) -> bool:
        """Whether an object is taken to roll, with a velocity, and not to walk at random."""
        course = self._course(subject)
        return course is not None and course.rolls

    def may_roll(self, subject: str) -> bool:
        """Whether an object rolls, or its sightings do not say yet beyond doubt that it does not."""
        course = self._course(subject)
        return course is not None and course.evidence > -SURELY_WALKS

    def velocity(self, subject: str) -> Moments | None:
        """The velocity (unit / s) of an object that rolls: mean, shape (2,), and covariance, shape (2, 2); None of one that walks."""
        course = self._course(subject)
        if course is None or not course.rolls:
            return None
        now = course.rolling.moments()
        return Moments(now.mean[VELOCITY], now.covariance[VELOCITY, VELOCITY])

    def rolling(self, subject: str, place: Moments, prior: float, kind: str) -> Rolling:
        """An object's motion by its own sightings; before its second sighting, the prior of its class."""
        course = self._course(subject)
        return course.rolling if course else Rolling.begun(place, prior, self._habits_of(kind))

    def pass_time(self, subject: str, prior: float, dt: float, model: Model = "learn", kind: str = "") -> Moments:
        """Let an object move for `dt` seconds: the way that it goes, shape (2,), and the covariance of that, shape (2, 2).

        What is a track of some `kind` moves as things of that kind were seen to move.
        """
        way = self._pass_time(subject, prior, dt, model, kind)
        self._since[subject] = self._since.get(subject, _Since()).plus(way, dt)
        return way

    def sighted(self, subject: str) -> None:
        """A sighting of an object was taken: `rewind` goes back to here."""
        self._since[subject] = _Since(self._motions.get(subject), self._kicked.get(subject))

    def rewind(self, subject: str) -> tuple[float, Moments]:
        """Take back all that `pass_time` has moved an object since its last sighting: for how many seconds, and the way."""
        since = self._since.pop(subject, _Since())
        for motions, motion in ((self._motions, since.motion), (self._kicked, since.kicked)):
            motions.pop(subject, None)
            if motion is not None:
                motions[subject] = motion
        self.sighted(subject)
        return since.seconds, Moments(since.way, since.covariance)

    def went(self, subject: str, prior: float, seconds: float) -> tuple[Array, float]:
        """How far an object has gone in its last seconds, shape (2,), and the variance of that along each axis."""
        strayed, velocity = self.drift(subject, prior) ** 2 * seconds, self.velocity(subject)
        if velocity is None:
            return np.zeros(2), strayed
        return seconds * velocity.mean, strayed + 0.5 * float(np.trace(velocity.covariance)) * seconds**2

    def _pass_time(self, subject: str, prior: float, dt: float, model: Model, kind: str) -> Moments:
        walk = Moments(np.zeros(2), np.eye(2) * self.drift(subject, prior) ** 2 * dt)
        known, kicked = self._motions.get(subject), self._kicked.get(subject)
        if known is None:
            return walk
        may_roll = model != "walk" and prior > 0.0  # what has no drift stands for good
        if may_roll and known.course is None:
            seen = Moments(known.bank.places[0], known.bank.covariances[0])
            rolling = Rolling.begun(seen, prior, self._habits_of(kind))
            known = replace(known, course=_Course(rolling, 0.0, model == "roll", kind))
        after = self._motions[subject] = self._passed(known, prior, dt, model)
        if kicked is not None:
            self._kicked[subject] = self._passed(kicked, prior, dt, model)
        if not may_roll or known.course is None or after.course is None or not known.course.rolls:
            return walk
        return moved(known.course.rolling.moments(), after.course.rolling.moments())

    def _passed(self, motion: _Motion, prior: float, dt: float, model: Model) -> _Motion:
        bank, course = motion.bank.passed(dt, prior), motion.course
        if course is None or model == "walk" or not prior:
            return replace(motion, bank=bank)
        habits = self._habits_of(course.kind)
        rolling = course.rolling.passed(dt, habits.rates() if habits else None)
        evidence = course.evidence * math.exp(-dt / MEMORY) if model == "learn" else math.inf
        return _Motion(bank, replace(course, rolling=rolling, evidence=evidence))

    def judge(self, subject: str, seen: Moments, named: bool = True, *, alone: bool = False) -> Moments | None:
        """A sighting puts an object at a place: mean, shape (2,), and covariance, shape (2, 2).

        A sighting that is not `named` was assigned to the object by its place, so it is never a misread. Returned is a way with its
        covariance, as by `pass_time`, where the object was just moved, or rolls and changed its velocity. `alone`: one robot alone
        sees the object, and does not show that it was moved, or walks faster than it was told or several have seen.
        """
        if alone:
            self._agreed.setdefault(subject, self._factor(subject))
        else:
            self._agreed.pop(subject, None)
        pushed = self._judge(subject, seen, named, alone)
        self.sighted(subject)
        return pushed

    def _judge(self, subject: str, seen: Moments, named: bool, alone: bool) -> Moments | None:
        known, kicked = self._motions.get(subject), self._kicked.pop(subject, None)
        if known is None:
            self._motions[subject] = _Motion(_Bank.begun(seen))
            return None
        if not named or known.explains(seen):
            return self._take(subject, known, seen)
        if alone:
            return None
        if kicked is None or not kicked.explains(seen):
            self._kicked[subject] = known.kicked(seen)
            return None
        self._take(subject, kicked, seen)
        far = math.dist(seen.mean, known.bank.place())
        return Moments(np.zeros(2), far**2 * np.eye(2))

    def _take(self, subject: str, motion: _Motion, seen: Moments) -> Moments | None:
        after, pushed = motion.after(seen)
        if after.course is not None and (kind := after.course.kind):
            self._habits[kind] = (self._habits_of(kind) or Habits()).plus(after.course.rolling)
            after = replace(after, course=replace(after.course, rolling=after.course.rolling.told_all()))
        self._motions[subject] = after
        return pushed

    def _course(self, subject: str) -> _Course | None:
        return self._motions[subject].course if subject in self._motions else None

    def _habits_of(self, kind: str) -> Habits | None:
        return self._habits.get(kind, Habits()) if kind else None

    def rename(self, subject: str, name: str) -> None:
        """An object has another name from now on."""
        for known in self._of_subjects():
            if subject in known:
                known[name] = known.pop(subject)

    def forget(self, subject: str) -> None:
        """An object is gone, or begins anew."""
        for known in self._of_subjects():
            known.pop(subject, None)

    def _of_subjects(self) -> tuple[dict[str, Any], ...]:
        return self._motions, self._kicked, self._agreed, self._since


def _mean_log(weights: Array, logs: Array) -> float:
    """The logarithm of a mean of exp(logs), by weights that are given as logarithms, too."""
    shares = np.exp(weights - weights.max())
    most = float(logs.max())
    return most + math.log(float(shares @ np.exp(logs - most)) / float(shares.sum()))
