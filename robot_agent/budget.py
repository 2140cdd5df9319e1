"""What a robot on a poor link says in a tick: the reports whose change is worth most for their bytes. Pure.

Long, because how a report may be said, what that is worth and which are chosen is one computation.

A board keeps the last report about each subject and lets it spread with age. So a report is worth, in expected nats of log score,
KL(now || what the board has) - KL(now || what it would have): the first term is what silence costs, the second what a coarser
report loses. What the team knows better than the robot is worth less, by the area that the team's belief covers over that of the
robot's own. A token bucket in team time bounds the bytes, and a price in nats per byte, which rises while the bucket is empty and
falls while it is full, decides whether to spend now or to wait for something better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, blur, uniform
from blackboard.opinion.gaussian.vehicle import AXES, STATES
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import unpack
from blackboard.wire.evidence import PackedEvidence, unpack_increment, unpack_state
from blackboard.wire.messages import PackedBelief, Report
from robot_agent.coarse import coarser
from robot_agent.config import SendSection

#: Precisions beside the one that a report has: nats between two levels, and how far below the peak the box reaches.
FINER, COARSER = (0.2, 8.0), (0.5, 7.0)
STATE_EVERY = 1.0  # seconds of team time between two whole states in evidence; boards need one to let a robot enter
PROFILE = 4  # one in so many points of a camera's profile is sent, and the last one; boards interpolate
#: Factor on the worth of a belief about a subject that the boards' joint knows from evidence: such a belief enters the consensus only.
JOINT = 0.05
PRICE = 1e-4  # nats per byte at the beginning
MOST = 20.0  # nats that an increment counts at most
CHEAPEST, DEAREST = 1e-7, 1e3  # nats per byte
FLOOR = 1e-12  # of a probability in a logarithm


@dataclass
class Bucket:
    """Bytes that may be sent: `rate` a second of team time, and what is saved up, at most `burst`."""

    rate: float
    burst: float
    level: float = math.nan
    _time: float | None = None

    def refill(self, time: float) -> None:
        """Let a bucket that was begun full take what came in until a team time, in seconds; one that goes back adds nothing."""
        if math.isnan(self.level):
            self.level = self.burst
        elif self._time is not None:
            self.level = min(self.burst, self.level + self.rate * max(0.0, time - self._time))
        self._time = time

    def has(self, size: int) -> bool:
        """Whether so many bytes may be sent: as many as are there, or more where the bucket is full."""
        return size <= self.level or self.level >= self.burst

    def take(self, size: int) -> None:
        self.level -= size


@dataclass(frozen=True, eq=False)
class Sent:
    """What the boards have of this robot about a subject."""

    time: float  # team time of the report, seconds
    belief: Belief


@dataclass(frozen=True, eq=False)
class Option:
    """A report as it could be sent: its bytes on the wire, what it is worth, and the belief that a board then has."""

    report: Report
    size: int
    worth: float  # nats
    belief: Belief
    whole: bool = True  # False: the motion alone


@dataclass(frozen=True, eq=False)
class Said:
    """The choice of a tick: the reports that are sent, and on the other subjects what the boards still have."""

    reports: list[Report]
    kept: Mapping[str, Belief]


@dataclass(frozen=True)
class Known:
    """What the team agreed on about a subject: the entropy in nats, and whether it is a marginal of the boards' joint."""

    entropy: float
    joint: bool


@dataclass
class Budget:
    """Mutable; `choose` once per tick. `size` counts the bytes of a report on the wire, key included, over all sub-teams."""

    settings: SendSection
    grid: Grid
    robot: str
    drift: float  # of the boards' [board] drift, unit per square root of a second
    size: Callable[[Report], int]
    bucket: Bucket = field(init=False)
    price: float = PRICE
    sent: dict[str, Sent] = field(default_factory=dict)
    seen: dict[str, Sent] = field(default_factory=dict)  # what boards that keep a joint made of sightings in evidence
    _since: dict[str, float] = field(default_factory=dict)  # subject -> team time since which nothing was said about it
    _state_at: tuple[int, float] = (-1, -math.inf)  # epoch and team time of the last whole state in evidence

    def __post_init__(self) -> None:
        rate = self.settings.budget or math.inf
        self.bucket = Bucket(rate, rate * self.settings.burst)

    def choose(self, reports: Sequence[Report], time: float, speed: float | None, team: Mapping[str, Known]) -> Said:
        """The reports of a tick at a team time (s) that are sent, in their order, some of them coarser.

        `speed` is what the robot told the boards (unit/s), `team` what was agreed. With an infinite budget everything is sent.
        """
        if not self.saves:
            return Said(list(reports), {})
        self.bucket.refill(time)
        subjects = {report.subject for report in reports}
        self.sent = {subject: it for subject, it in self.sent.items() if subject in subjects}
        self._since = {subject: self._since.get(subject, time) for subject in sorted(subjects)}
        stale = {subject: self.aged(subject, time, speed) for subject in sorted(subjects)}
        options = self._all_options(reports, stale, time, team)
        full = [options[report.subject][0] for report in reports]
        needed = sum(option.size for option in full)
        if self.bucket.level - needed >= self.bucket.burst / 2:
            chosen = {option.report.subject: option for option in full}
            self.bucket.take(needed)
        else:
            chosen = self._chosen(options, time)
        self._reprice()
        for subject, option in chosen.items():
            self.sent[subject] = Sent(time, option.belief)
            if option.whole:
                self._since[subject] = time
            evidence = option.report.evidence
            if evidence is not None and evidence.state is not None:
                self._state_at = evidence.epoch, time
            if evidence is not None:
                seen = {it.subject for it in evidence.relatives} & options.keys()
                self.seen.update({it: Sent(time, options[it][0].belief) for it in sorted(seen)})
        kept = {s: stale[s] for s in sorted(subjects) if s not in chosen and s in self.sent}
        return Said([chosen[r.subject].report for r in reports if r.subject in chosen], kept)

    def aged(self, subject: str, time: float, speed: float | None) -> Belief:
        """What a board has of this robot about a subject, spread as it spreads it; uniform where it has nothing."""
        sent = self.sent.get(subject)
        if sent is None:
            return uniform(self.grid)
        if speed is not None and subject == f"robot/{self.robot}":
            sigma = speed * max(0.0, time - sent.time) / math.sqrt(2)
            return self._blurred(sent.belief, sigma)
        return self._spread(sent, time, self.drift)

    def _spread(self, sent: Sent, time: float, drift: float) -> Belief:
        return self._blurred(sent.belief, drift * math.sqrt(max(0.0, time - sent.time)))

    def _blurred(self, belief: Belief, sigma: float) -> Belief:
        """Sigma in the grid's unit, at most the width of the grid."""
        farthest = self.grid.cell * max(self.grid.shape)
        return Belief(self.grid, blur(belief.p, min(sigma, farthest) / self.grid.cell))

    @property
    def saves(self) -> bool:
        """Whether anything is left out at all."""
        return math.isfinite(self.bucket.rate)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _chosen(self, options: Mapping[str, list[Option]], time: float) -> dict[str, Option]:
        """Who has waited too long comes first; then the best for its bytes, as long as it is worth the price."""
        chosen: dict[str, Option] = {}
        waiting = sorted((since, subject) for subject, since in self._since.items())
        for since, subject in waiting:
            if time - since < self.settings.longest:
                break
            cheapest = min((it for it in options[subject] if it.whole), key=lambda option: (option.size, -option.worth))
            if not self.bucket.has(cheapest.size):
                return chosen  # bytes are saved for the report that has waited longest, so nothing else is sent
            self._take(chosen, cheapest)
        while moves := [
            (gain / more, option)
            for subject, at in options.items()
            for option in at
            if (more := option.size - (chosen[subject].size if subject in chosen else 0)) > 0
            and (gain := option.worth - (chosen[subject].worth if subject in chosen else 0.0)) / more > self.price
            and self.bucket.has(more)
        ]:
            self._take(chosen, max(moves, key=lambda move: (move[0], move[1].report.subject))[1])
        return chosen

    def _take(self, chosen: dict[str, Option], option: Option) -> None:
        before = chosen.get(option.report.subject)
        self.bucket.take(option.size - (0 if before is None else before.size))
        chosen[option.report.subject] = option

    def _reprice(self) -> None:
        """Twice as dear after two ticks with an empty bucket, half as dear after two with a full one."""
        fill = min(1.0, max(0.0, self.bucket.level / self.bucket.burst))
        self.price = min(DEAREST, max(CHEAPEST, self.price * 2.0 ** (0.5 - fill)))

    def _all_options(
        self, reports: Sequence[Report], stale: Mapping[str, Belief], time: float, team: Mapping[str, Known]
    ) -> dict[str, list[Option]]:
        """For each subject its report as it could be sent, as it is first.

        Sightings in evidence are worth what the beliefs say that are made of them; a joint takes those beliefs from nowhere else.
        """
        self.seen = {subject: it for subject, it in self.seen.items() if subject in stale}
        best, news, found = dict[str, Belief](), dict[str, float](), dict[str, list[Option]]()
        for report in reports:
            told = report.belief if report.informed is None else report.informed.belief
            best[report.subject] = unpack(told, self.grid)
        for subject, belief in best.items():
            seen = self.seen.get(subject)
            there = stale[subject] if seen is None else self._spread(seen, time, self.drift)
            news[subject] = self._share(subject, belief, team) * max(0.0, _divergence(belief.p, there.p))
        for report in reports:
            known = team.get(report.subject)
            share = self._share(report.subject, best[report.subject], team)
            if known is not None and known.joint and report.evidence is None:
                share *= JOINT
            found[report.subject] = self._options(report, best[report.subject], stale[report.subject], share, news)
        return found

    def _share(self, subject: str, belief: Belief, team: Mapping[str, Known]) -> float:
        """How much of what the team knows about a subject a belief may be: the area of the one over that of the other."""
        known = team.get(subject)
        return 1.0 if known is None else min(1.0, math.exp(known.entropy - entropy(belief.p)))

    def _options(
        self, report: Report, best: Belief, stale: Belief, share: float, news: Mapping[str, float]
    ) -> list[Option]:
        """The report as it is, then coarser."""
        informed, first = report.informed, unpack(report.belief, self.grid)
        lost = _divergence(best.p, stale.p)
        if report.evidence is not None:
            return self._with_evidence(report, first, best, share * lost, share, news)
        found = [self._option(report, best, best, lost, share)]
        plain = report.model_copy(update={"ancestors": {}})  # which says the same: the source alone
        for precisions in ((FINER, FINER), (COARSER, FINER), (COARSER, COARSER)):
            changes: dict[str, object] = {"belief": coarser(first, report.belief, *precisions[0])}
            told = changes["belief"]
            if informed is not None:
                told = coarser(best, informed.belief, *precisions[1])
                changes["informed"] = informed.model_copy(update={"belief": told})
            assert isinstance(told, PackedBelief)
            found.append(self._option(plain.model_copy(update=changes), unpack(told, self.grid), best, lost, share))
        return found

    def _with_evidence(
        self, report: Report, first: Belief, best: Belief, worth: float, share: float, news: Mapping[str, float]
    ) -> list[Option]:
        """For boards that keep a joint: all of it; the evidence with a coarse belief; and the motion alone.

        Evidence is as sharp as ever. What was gained and is not sent is gathered by the filter for the next time; sightings are lost.
        """
        assert report.evidence is not None
        coarse = coarser(first, report.belief, *COARSER)
        lean = self._lean(report).model_copy(update={"belief": coarse, "informed": None, "ancestors": {}})
        seen = sum(news.get(it.subject, 0.0) for it in report.evidence.relatives)
        found = [Option(it, self.size(it), worth + seen, best) for it in (report, lean)]
        evidence = lean.evidence
        if evidence is not None and evidence.increment is not None:
            told: dict[str, object] = {"increment": None, "state": None, "relatives": [], "profile": []}
            moved = lean.model_copy(update={"evidence": evidence.model_copy(update=told)})
            found.append(
                Option(moved, self.size(moved), max(0.0, worth - share * _gained(report.evidence)), best, False)
            )
        return found

    def _option(self, report: Report, told: Belief, best: Belief, lost: float, share: float) -> Option:
        worth = share * (lost - _divergence(best.p, told.p))
        return Option(report, self.size(report), worth, told)

    def _lean(self, report: Report) -> Report:
        """The evidence with a shorter profile of the camera, and without its state, where boards have heard one lately.

        A board needs a state to let a robot enter its joint, as after the board was started again.
        """
        evidence = report.evidence
        if evidence is None:
            return report
        epoch, at = self._state_at
        changes: dict[str, object] = {}
        if evidence.increment is not None and epoch == evidence.epoch and report.time - at < STATE_EVERY:
            changes["state"] = None
        if len(evidence.profile) > 2 * PROFILE:
            changes["profile"] = [*evidence.profile[:-1:PROFILE], evidence.profile[-1]]
        return report.model_copy(update={"evidence": evidence.model_copy(update=changes)})


def _gained(evidence: PackedEvidence) -> float:
    """KL in nats between the place of a robot with and without the increment of its evidence; 0 where there is none."""
    if evidence.increment is None or evidence.state is None:
        return 0.0
    try:
        state, increment = unpack_state(evidence.state), unpack_increment(evidence.increment)
        without = np.linalg.solve(np.eye(STATES) - state.covariance @ increment.information, state.covariance)
        before, after = without[AXES, AXES], state.covariance[AXES, AXES]
        apart = state.mean[AXES] - increment.reference[AXES]
        ratio = np.linalg.solve(before, after)
        nats = 0.5 * (np.trace(ratio) - 2 - math.log(np.linalg.det(ratio)) + apart @ np.linalg.solve(before, apart))
    except (Refused, ValueError, np.linalg.LinAlgError):  # the numbers of a robot that knows nothing yet
        return MOST
    return float(min(MOST, max(0.0, nats))) if math.isfinite(nats) else MOST


def _divergence(p: Array, q: Array) -> float:
    """KL(p || q) in nats."""
    return float((p * (np.log(np.maximum(p, FLOOR)) - np.log(np.maximum(q, FLOOR)))).sum())
