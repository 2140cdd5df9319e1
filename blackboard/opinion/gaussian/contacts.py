"""Whether two robots' first-hand beliefs agree wherever they speak of one thing: the test that no joint can spoil.

What a robot believes first-hand of itself, and where that puts what it sees, rests on its own readings alone. So two robots that
speak of the same place in one tick are compared without the joint, in which they may have persuaded each other already, and a
liar whom a single mate sees is found out too.

The errors of both robots' places last until new evidence corrects them, those of single sightings do not. So what a pair says is
averaged until one of the two is corrected, which gives one squared Mahalanobis distance: chi-squared with two degrees of freedom
where both are honest. The distances that follow count as far as they are new.

A pair that contradicts each other is held to that by all its distances, until a new one is shorter than 99.9 % of those to be expected
if they went on as before. Then one of the two has changed what it says: the distances before are forgotten, and the pair may agree
once as many as `CERTAIN` say so. A robot that lies now and then is not believed in between, unless it is honest for that long.

A robot that has seen nothing to correct its place for long goes by its odometry alone. Where that is worse than the robot knows, it
contradicts its mates and is honest; they are what corrects it. So nothing is held against it or by it meanwhile.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.opinion.believed import REMEMBERED, UNMET, Pair, accusers
from blackboard.opinion.chi_squared import GATE, SIGMAS, quantile, wilson_hilferty
from blackboard.opinion.gaussian.copying import Copyable
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments, squared_distance
from blackboard.opinion.gaussian.vehicle import AXES
from blackboard.opinion.grid import Array

FAINT = 1e-6  # the least share of an error that one tick's evidence is taken to leave
MISREAD = 2  # claims in a row that are taken for misread if they are beyond the gate of those before
RECKONED = 0.75  # the share of a belief's variance from which on it is no evidence against another robot
RENEWED = 0.05  # the share of two robots' errors that is corrected before what they say is averaged anew
CERTAIN = 2.0  # independent distances after a change, before a pair that contradicted may agree: the one that showed it, and a new one


@dataclass(frozen=True, eq=False)
class Claim:
    """Where a robot says that something is: mean, shape (2,); the covariance of what lasts and of what is fresh, (2, 2) each."""

    mean: Array
    lasting: Array
    fresh: Array

    def place(self) -> Moments:
        """The place, with all of its error."""
        return Moments(self.mean, self.lasting + self.fresh)


@dataclass(frozen=True, eq=False)
class Contact:
    """What is known of a pair."""

    corrected: tuple[float, float]  # as `Contacts._corrected` had the two when the average was begun
    apart: Array  # the average difference between their claims, shape (2,), in the grid's unit
    fresh: Array  # the covariance of its fresh error, shape (2, 2)
    claims: int  # that were averaged
    weight: float  # how much of their distance is new, 0 to 1
    squared: float = 0.0  # the distance of the average
    mean: float = 0.0  # of the squared distances before
    number: float = 0.0  # how many independent ones these were
    misread: int = 0  # how many of the newest claims, in a row, were taken for misread
    on_trial: bool = False  # it contradicted, has changed, and its distances since are fewer than `CERTAIN`

    @property
    def contradicts(self) -> bool:
        """Whether it is on trial, or the distances are larger than 99.9 % of honest pairs'; a pair is judged many times."""
        limit = wilson_hilferty(GATE, 2 * (self.number + self.weight))
        return self.on_trial or self.mean * self.number + self.squared * self.weight > limit

    @property
    def has_changed(self) -> bool:
        """Whether it contradicts, and the newest distance is shorter than 99.9 % of what was to be expected if that went on.

        The root of a squared distance with an offset of many sigmas is nearly normal, with sigma 1 (the tail of Rice's distribution).
        """
        return self.contradicts and math.sqrt(self.squared) < math.sqrt(self.mean) - SIGMAS[GATE]


@dataclass
class Contacts(Copyable):
    """Mutable; `pass_time` once per tick, `correct` once per robot, then `judge` all things of which robots spoke."""

    _pairs: dict[Pair, Contact] = field(default_factory=dict)
    _ages: dict[Pair, float] = field(default_factory=dict)  # seconds since both spoke of one thing
    #: Pairs that agreed and contradict each other now -> for how many seconds.
    _parted: dict[Pair, float] = field(default_factory=dict)
    # robot -> - ln(the share of its first error that is left)
    _corrected: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    _reckoned: dict[str, tuple[float, float]] = field(default_factory=dict)  # robot -> variances: reckoned, and in all

    def pass_time(self, dt: float) -> None:
        """Let `dt` seconds pass. Contradictions of pairs that have not met for `UNMET` are forgotten: one of the two may be gone."""
        self._ages = {pair: age + dt for pair, age in self._ages.items()}
        for pair in [pair for pair, age in self._ages.items() if age > UNMET and self._pairs[pair].contradicts]:
            del self._pairs[pair], self._ages[pair]
        self._parted = {pair: since + dt for pair, since in self._parted.items() if self.contradict(*pair)}

    def correct(self, robot: str, belief: Moments, increment: Increment | None) -> None:
        """Note how far a tick's evidence, which led to `belief`, corrected the error of a robot's place.

        What is left of its variance is divided into what came from motion since and what did not.
        """
        gain = 0.0
        if increment is not None:  # I - K = 1 - P I, where P is the posterior and I the information gained
            gain = float(np.trace((belief.covariance @ increment.information)[AXES, AXES])) / 2
        left = min(1.0, max(FAINT, 1.0 - gain))
        self._corrected[robot] -= math.log(left)
        variance = float(np.trace(belief.covariance[AXES, AXES]))
        reckoned, before = self._reckoned.get(robot, (0.0, variance / left))
        reckoned += max(0.0, variance / left - before)
        self._reckoned[robot] = left**2 * reckoned, variance

    def is_reckoned(self, robot: str) -> bool:
        """Whether a robot's belief of its place is mostly dead reckoning: what its odometry is worth, and no evidence.

        With evidence that keeps coming the reckoned share of the variance stays below a half.
        """
        reckoned, variance = self._reckoned.get(robot, (0.0, 0.0))
        return reckoned > RECKONED * variance

    def judge(self, *things: Mapping[str, Claim]) -> set[str]:
        """Compare what robots say in one tick, in the order of the things that they speak of: of each what each robot says.

        Returned are the robots that contradict another one after the tick with which they agreed before it.
        """
        before = dict(self._pairs)
        for said in things:
            names = sorted(said)
            for i, one in enumerate(names):
                for other in names[i + 1 :]:
                    self._pairs[one, other] = self._met(one, other, said)
                    self._ages[one, other] = 0.0
        agreed = [pair for pair, contact in before.items() if not contact.contradicts]
        parted = [pair for pair in agreed if self._pairs[pair].contradicts]
        self._parted |= dict.fromkeys(parted, 0.0)
        return {robot for pair in parted for robot in pair}

    def contradict(self, one: str, other: str) -> bool:
        """Whether two robots can hardly both be honest, by all that both spoke of lately."""
        first, second = sorted((one, other))
        contact = self._pairs.get((first, second))
        return contact is not None and contact.contradicts and not any(map(self.is_reckoned, (one, other)))

    def left_out(self, doubted: Collection[str] = ()) -> frozenset[str]:
        """The robots that more others contradict than confirm, and by more than is so of each of those who contradict them.

        Of robots that are `doubted` for what they see it is held against nobody whom they contradict. The most contradicted one goes
        first, and its contacts no longer count. Of two robots that contradict each other, and of equal camps, nobody can tell which
        is right: there nobody is left out. Of two that agreed before, one has changed: earlier confirmations of both do not count.
        """
        out, parted = set[str](), self._since_parted()
        pairs = {
            pair: contact.contradicts
            for pair, contact in self._pairs.items()
            if not any(map(self.is_reckoned, pair))
            if contact.contradicts or all(self._ages[pair] <= parted.get(robot, math.inf) for robot in pair)
        }
        while True:
            excess, by = accusers(pairs, out)
            for robot, accuser in [(robot, mate) for mate in doubted for robot in by.get(mate, ())]:
                excess[robot] -= 1
                by[robot].discard(accuser)
            by = {robot: accusing for robot, accusing in by.items() if accusing}
            worst = max(sorted(by), key=lambda robot: excess[robot], default=None)
            if worst is None or excess[worst] <= max(0, *(excess[partner] for partner in by[worst])):
                return frozenset(out)
            out.add(worst)

    def _since_parted(self) -> dict[str, float]:
        """Of robots that contradict one with which they agreed before: for how many seconds, by the newest such pair."""
        newest: dict[str, float] = {}
        for pair, since in self._parted.items():
            newest |= {robot: min(since, newest.get(robot, math.inf)) for robot in pair}
        return newest

    def begin(self, robot: str) -> None:
        """A robot begins anew: the error of its place is another one from now on. What it said before is held against it as before."""
        self._corrected[robot] -= math.log(FAINT)
        self._reckoned.pop(robot, None)

    def _met(self, one: str, other: str, said: Mapping[str, Claim]) -> Contact:
        """The contact of a pair with one more difference between their claims."""
        claims = said[one], said[other]
        apart, fresh = claims[0].mean - claims[1].mean, claims[0].fresh + claims[1].fresh
        lasting = claims[0].lasting + claims[1].lasting
        corrected = (self._corrected[one], self._corrected[other])
        last = self._pairs.get((one, other))
        if last is None:
            return Contact(corrected, apart, fresh, 1, 1.0, squared_distance(apart, lasting + fresh))
        if (
            beyond := squared_distance(apart - last.apart, lasting + fresh + last.fresh) > quantile(GATE, 2)
        ) and last.misread < MISREAD:
            return replace(last, misread=last.misread + 1)
        variances = [float(claim.lasting[0, 0] + claim.lasting[1, 1]) for claim in claims]
        left = [math.exp(then - time) for then, time in zip(last.corrected, corrected, strict=True)]
        kept = sum(share * variance for share, variance in zip(left, variances, strict=True))
        new = 1.0 - kept / sum(variances) if sum(variances) > 0 and not beyond else float(beyond)
        if new < RENEWED:
            n = last.claims + 1
            average, noise = last.apart + (apart - last.apart) / n, (last.fresh * (n - 1) ** 2 + fresh) / n**2
            squared = squared_distance(average, lasting + noise)
            return replace(last, apart=average, fresh=noise, claims=n, misread=0, squared=squared)
        number, on_trial = last.number + last.weight, last.on_trial
        mean = (last.mean * last.number + last.squared * last.weight) / number
        if last.has_changed:
            number, mean, on_trial = last.weight, last.squared, True
        on_trial = on_trial and number + new < CERTAIN
        number, squared = min(REMEMBERED, number), squared_distance(apart, lasting + fresh)
        return Contact(corrected, apart, fresh, 1, new, squared, mean, number, on_trial=on_trial)
