"""Who disagrees with what the others believe: since when, how far, and how much it counts meanwhile. Pure.

Each source is judged by the consensus without it: once a second of team time (SPACING), on every subject on which at least
three independent opinions are bell-shaped. A distance beyond the 99 % quantile is a contradiction, and a second in which most
of a source's opinions contradict speaks against it. A source that disagreed in most of the last seconds is named. Its opinions
are taken to a power that falls to LEAST_WEIGHT, and that rises again as slowly as REDEEMED says. While none is named, no
opinion is changed.

Where half of the sources or more would be named at once, it cannot be decided which are wrong, and none is named. Then the
camps are reported: groups that agree among themselves and contradict each other, two of them equally large.
"""

import logging
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from blackboard.opinion.belief import Belief
from blackboard.opinion.believed import (
    ACCUSED,
    LEAST_WEIGHT,
    MAX_SUBJECTS,
    REDEEMED,
    SPACING,
    Verdicts,
    camps_of,
    is_due,
    silent_longest,
)
from blackboard.opinion.bell import bell
from blackboard.opinion.chi_squared import DOUBT, quantile
from blackboard.opinion.gaussian.evidence import Verdict
from blackboard.opinion.gaussian.joint import squared_distance
from blackboard.opinion.gaussian.trust import Trust
from blackboard.opinion.grid import Array
from blackboard.opinion.provenance import Opinion
from blackboard.wire import messages as wire

log = logging.getLogger(__name__)

Pool = Callable[[Sequence[Opinion]], Belief]
Moments = tuple[Array, Array]  # mean (ndim,) and covariance (ndim, ndim)


@dataclass
class Standing:
    """How far a source has disagreed with the others, judged once a second."""

    verdicts: Verdicts = field(default_factory=Verdicts)  # one of each second, with the distance from the others
    taken: float = 1.0  # share of its newest evidence that a joint took; 1 where there is none
    # How far, in sigmas, sightings that a joint did not take had this robot from where it is; weighted alike.
    seen: float = 0.0
    since: float | None = None
    logged: bool = False

    @property
    def weight(self) -> float:
        return 1.0 if self.since is None else max(LEAST_WEIGHT, min(1.0, 2.0 * (1.0 - self.verdicts.share)))


@dataclass
class DissentJudge:
    """Mutable; the standing of the sources of one level of a board."""

    level: str  # "consensus" or "agreed"
    joint: bool = False  # how much a source counts is decided by a joint, and only reported here
    camps: dict[str, list[frozenset[str]]] = field(default_factory=dict)  # subject -> its opposed camps
    standings: dict[str, Standing] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)  # source -> team time of its newest verdict
    judged_at: dict[str, float] = field(default_factory=dict)  # subject -> team time
    pending: dict[str, list[tuple[bool, float]]] = field(default_factory=dict)  # source -> contradicts, sigmas
    second: float = -math.inf  # team time at which the pending verdicts began
    _left_out: frozenset[str] = frozenset()  # robots that a joint leaves out

    # --- opinions -------------------------------------------------------------------------------------------------------

    def judge_opinions(self, subject: str, time: float, opinions: Sequence[Opinion], pool: Pool) -> None:
        """Judge independent opinions on a subject at a team time (s); `pool` is the board's rule, for the others of each source."""
        self._close_second(time)
        if not is_due(time, self.judged_at.get(subject, -math.inf)):
            return
        fresh = [opinion for opinion in opinions if opinion.age < SPACING]
        if len(fresh) < 3:
            self.camps.pop(subject, None)
            return
        bells = {o.source: o.bell for o in fresh if o.bell is not None}
        if len(self.judged_at) > MAX_SUBJECTS:
            self.judged_at = {name: at for name, at in self.judged_at.items() if time - at < SPACING}
        self.judged_at[subject] = time
        pairs = {(one, other): distance(bells[one], bells[other]) for one in bells for other in bells if one < other}
        gate = quantile(DOUBT, fresh[0].belief.grid.ndim)
        verdicts = {source: _median(pairs, source) for source in bells} if len(bells) > 2 else {}
        self.camps.pop(subject, None)
        if any(squared > gate for squared in pairs.values()):
            verdicts = self._by_the_others(fresh, bells, pool)
            if 2 * sum(squared > gate for squared in verdicts.values()) >= len(bells):
                camps = camps_of(bells, [pair for pair, squared in pairs.items() if squared <= gate])
                if len(camps) > 1:
                    self.camps[subject] = camps
                return
        for source, squared in verdicts.items():
            self.heard[source] = time
            self.pending.setdefault(source, []).append((squared > gate, math.sqrt(squared)))

    @staticmethod
    def _by_the_others(fresh: Sequence[Opinion], bells: Mapping[str, Moments], pool: Pool) -> dict[str, float]:
        """The squared distance of each source from the others' consensus; without those whose others have no single answer."""
        distances = {}
        for source in bells:
            others = pool([opinion for opinion in fresh if opinion.source != source])
            if (told := bell(others)) is not None:
                partners = [
                    distance(bells[other], told) <= quantile(DOUBT, len(told[0])) for other in bells if other != source
                ]
                if 2 * sum(partners) > len(partners):  # else it is one of them against the rest, and no consensus
                    distances[source] = distance(bells[source], told)
        return distances

    def _close_second(self, time: float) -> None:
        """Count the verdicts of a second once it is over."""
        if time >= self.second and not is_due(time, self.second):
            return
        for source, verdicts in sorted(self.pending.items()):
            against = 2 * sum(contradicts for contradicts, _ in verdicts) > len(verdicts)
            sigmas = float(np.mean([sigma for contradicts, sigma in verdicts if contradicts == against]))
            self._count(source, time, against, sigmas)
        self.pending, self.second = {}, time
        for gone in silent_longest(self.heard):
            del self.heard[gone]
            self.standings.pop(gone, None)

    # --- a joint --------------------------------------------------------------------------------------------------------

    def judge_robots(
        self,
        time: float,
        told: Mapping[str, Moments],
        believed: Mapping[str, Moments],
        verdicts: Sequence[Verdict],
        trust: Trust,
    ) -> None:
        """Judge robots at a team time (s) by where they report that they are, `told`, and where a joint has them, `believed`.

        How much each counts, the joint decides by itself: by the gate, whose `verdicts` on evidence about places are given, and by
        `trust`, which judges sightings by both ends.
        """
        self._left_out = frozenset(robot.removeprefix("robot/") for robot in trust.left_out())
        self.camps = {"": camps} if (camps := trust.camps()) else {}
        for verdict in verdicts:
            if verdict.freedom > 1:
                standing = self.standings.setdefault(verdict.source.removeprefix("robot/"), Standing())
                standing.taken = ACCUSED * standing.taken + (1 - ACCUSED) * verdict.taken
            for end in {verdict.source, verdict.subject} if verdict.kind == "relative" and not verdict.taken else ():
                if (name := end.removeprefix("robot/")) in self._left_out:
                    standing, sigmas = self.standings.setdefault(name, Standing()), math.sqrt(verdict.squared)
                    standing.seen = sigmas if not standing.seen else ACCUSED * standing.seen + (1 - ACCUSED) * sigmas
        self._close_second(time)
        if not self.pending:  # the first step of a second
            gate = quantile(DOUBT, 2)
            squared = {name: distance(told[name], believed[name]) for name in sorted(told.keys() & believed.keys())}
            if 2 * sum(far > gate for far in squared.values()) < len(squared):
                self.pending = {name: [(far > gate, math.sqrt(far))] for name, far in squared.items()}
                self.heard |= dict.fromkeys(squared, time)
        for name in sorted(self._left_out):
            self._name(name, time)

    def camps_about(
        self, subject: str, taken: Collection[str], disputing: Sequence[Collection[str]] = ()
    ) -> list[wire.Camp]:
        """The opposed camps of a joint, where the subject is in one, or those that are `disputing` it.

        Their weights are the shares of the evidence that was taken.
        """
        camps = self.camps.get("", [])
        opposed = camps if any(subject in camp for camp in camps) else disputing
        whole = [frozenset(robot.removeprefix("robot/") for robot in camp) for camp in opposed]
        return _camps(whole, {source.removeprefix("robot/"): 1.0 for source in taken})

    # --- what came of it ------------------------------------------------------------------------------------------------

    def weight(self, source: str) -> float:
        """The power to which a source's opinions are taken, 1 unless it is named.

        In a joint: the share of its evidence that was taken.
        """
        standing = self.standings.get(source)
        if self.joint:
            return 0.0 if source in self._left_out else 1.0 if standing is None else standing.taken
        return 1.0 if standing is None else standing.weight

    def named(self, sources: Collection[str] | None = None) -> list[wire.Dissent]:
        """Who is named, of these sources or of all, sorted."""
        return [
            wire.Dissent(
                level=self.level,  # type: ignore[arg-type]
                source=source,
                since=standing.since,
                sigmas=max(standing.verdicts.sigmas, standing.seen if source in self._left_out else 0.0),
                weight=self.weight(source),
            )
            for source, standing in sorted(self.standings.items())
            if standing.since is not None and (sources is None or source in sources)
        ]

    def told_camps(self, subject: str, weights: Mapping[str, float]) -> list[wire.Camp]:
        """The opposed camps about a subject, the heaviest first, with the share that each has of these weights of sources."""
        return _camps(self.camps.get(subject, []), weights)

    def _count(self, source: str, time: float, against: bool, sigmas: float) -> None:
        standing = self.standings.setdefault(source, Standing())
        standing.verdicts = standing.verdicts.plus(against, ACCUSED if against else REDEEMED, sigmas)
        if standing.verdicts.firm and standing.verdicts.against:
            self._name(source, time)
        elif not standing.verdicts.against and source not in self._left_out:
            standing.since = None

    def _name(self, source: str, time: float) -> None:
        standing = self.standings.setdefault(source, Standing())
        standing.since = time if standing.since is None else standing.since
        self.heard.setdefault(source, time)
        if not standing.logged:
            standing.logged = True
            sigmas = max(standing.verdicts.sigmas, standing.seen)
            far = f", by {sigmas:.1f} sigmas" if sigmas > 0 else ""
            what = "%s disagrees with what the others believe (%s)%s: it counts less from now on"
            log.warning(what, source, self.level, far)


def _camps(camps: Iterable[frozenset[str]], weights: Mapping[str, float]) -> list[wire.Camp]:
    heavy = [(sum(weights.get(source, 0.0) for source in camp), sorted(camp)) for camp in camps]
    whole = sum(weight for weight, _ in heavy) or 1.0
    return [
        wire.Camp(sources=names, weight=w / whole) for w, names in sorted(heavy, key=lambda camp: (-camp[0], camp[1]))
    ]


def distance(one: Moments, other: Moments) -> float:
    """The squared distance of two Gaussians' means, in the sigmas that both claim."""
    return squared_distance(one[0] - other[0], one[1] + other[1])


def _median(pairs: Mapping[tuple[str, str], float], source: str) -> float:
    return float(np.median([squared for pair, squared in pairs.items() if source in pair]))
