"""What a robot on a poor link says in a tick: the reports whose change is worth most for their bytes. Pure.

A board keeps the last report about each subject and lets it spread with age. So a report is worth KL(now || what the board has)
- KL(now || what it would have), in expected nats of log score. The first term is what silence costs, the second what a coarser
report loses. What the team knows better than the robot is worth less, by the area that the team's belief covers over that of
the robot's own. A sighting of a mate is valued otherwise (`worth.Offers`, `sightings.py`): two that follow each other differ by
their noise, which is no news. A token bucket in team time bounds the bytes. A price in nats per byte decides whether to spend
now, or to wait for something better. It rises while the bucket is empty, and falls while it is full. Where messages are counted
(`slots.py`), one is said in each slot.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from blackboard.opinion.ageing import Ageing
from blackboard.opinion.belief import Belief, uniform
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy_of
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Report
from blackboard.wire.opinions import reported
from robot_agent.coarse import coarser
from robot_agent.config import SendSection
from robot_agent.short import shorter
from robot_agent.sightings import Sightings
from robot_agent.slots import DATAGRAM, Slots
from robot_agent.told_way import ToldWay
from robot_agent.worth import COARSER, COARSEST, Offers, Option, TeamKnowledge, divergence, gained

#: Factor on the worth of a belief about a subject that the boards' joint knows from evidence: such a belief enters the consensus only.
JOINT = 0.05
PRICE = 1e-4  # nats per byte at the beginning
#: Seconds of team time between two whole states in evidence where the boards have the robot in their joint: one that comes needs it.
STATE_EVERY = 10.0
CHEAPEST, DEAREST = 1e-7, 1e3  # nats per byte
#: Doublings of the price at once, and in each `burst` seconds, between a full bucket and an empty one.
STIFF, SLOW = 4.0, 2.0


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

    def spend(self, size: int) -> None:
        self.level -= size


@dataclass(frozen=True, eq=False)
class LastSent:
    """What the boards have of this robot about a subject."""

    time: float  # team time of the report, seconds
    belief: Belief


@dataclass(frozen=True, eq=False)
class Sending:
    """The choice of a tick: the reports that are sent, and on the other subjects what the boards still have."""

    reports: list[Report]
    kept: Mapping[str, Belief]


@dataclass
class Budget:
    """Mutable; `choose` once per tick. `size` counts the bytes of a report on the wire, key included, over all sub-teams."""

    settings: SendSection
    grid: Grid
    robot: str
    drift: float  # of the boards' [board] drift, unit per square root of a second
    size: Callable[[Report], int]
    slots: Slots | None = None  # where messages are counted
    copies: int = 1  # of a report: one in each of the robot's sub-teams
    bucket: Bucket = field(init=False)
    price: float = PRICE
    sent: dict[str, LastSent] = field(default_factory=dict)
    sightings: Sightings = field(default_factory=Sightings)  # what boards that keep a joint know from those in evidence
    way: ToldWay = field(default_factory=ToldWay)
    _offers: Offers = field(init=False)
    _priced_at: float = -math.inf  # team time, seconds
    _since: dict[str, float] = field(default_factory=dict)  # subject -> team time since which nothing was said about it
    _state_at: tuple[int, float] = (-1, -math.inf)  # epoch and team time of the last whole state in evidence

    def __post_init__(self) -> None:
        rate = self.settings.budget or math.inf
        self.bucket = Bucket(rate, rate * self.settings.burst)
        self._offers = Offers(self.grid, self.robot, self.size)

    def choose(
        self, reports: Sequence[Report], time: float, speed: float | None, team: Mapping[str, TeamKnowledge]
    ) -> Sending:
        """The reports of a tick at a team time (s) that are sent, in their order, some of them coarser.

        `speed` is what the boards have of the robot (unit/s), `team` what was agreed. With an infinite budget everything is
        sent.
        """
        if not self.saves:
            return Sending(list(reports), {})
        reports = [_short(report) for report in reports]
        self.bucket.refill(time)
        evidence = next((report.evidence for report in reports if report.evidence is not None), None)
        if evidence is not None:
            self.way.on_tick(evidence)
        if self.slots is not None:
            if not self.slots.due(time):
                self.slots.wait(time, evidence)
                silent = {report.subject for report in reports} & self.sent.keys()
                return Sending([], {subject: self.aged(subject, time, speed) for subject in sorted(silent)})
            if evidence is not None:
                evidence = self.slots.with_means(time, evidence, self.way)
        if evidence is not None:
            told = {"evidence": evidence.model_copy(update={"travelled": self.way.told(evidence)})}
            reports = [report if report.evidence is None else report.model_copy(update=told) for report in reports]
        most = math.log(self.grid.size)  # a board may tell an entropy that no belief on this grid has
        team = {subject: replace(about, entropy=min(most, max(0.0, about.entropy))) for subject, about in team.items()}
        subjects = {report.subject for report in reports}
        self.sent = {subject: last for subject, last in self.sent.items() if subject in subjects}
        self._since = {subject: self._since.get(subject, time) for subject in sorted(subjects)}
        stale = {subject: self.aged(subject, time, speed) for subject in sorted(subjects)}
        options = self.options(reports, stale, time, team)
        full = [options[report.subject][0] for report in reports]
        needed = sum(option.size for option in full)
        if self.slots is not None:
            chosen = self._datagram(options, time)
            self.slots.said(time)
        elif self.bucket.level - needed >= self.bucket.burst / 2:
            chosen = {option.report.subject: option for option in full}
            self.bucket.spend(needed)
        else:
            chosen = self._chosen(
                options, time, {s for s, about in team.items() if about.joint and s != f"robot/{self.robot}"}
            )
        self._reprice(time)
        self._note_sent(chosen, time)
        kept = {s: stale[s] for s in sorted(subjects) if s not in chosen and s in self.sent}
        return Sending([chosen[r.subject].report for r in reports if r.subject in chosen], kept)

    def aged(self, subject: str, time: float, speed: float | None) -> Belief:
        """What a board has of this robot about a subject, spread as it spreads it; uniform where it has nothing."""
        sent = self.sent.get(subject)
        if sent is None:
            return uniform(self.grid)
        ageing = Ageing(self.drift, self.grid)
        if speed is not None and subject.startswith("robot/"):
            # Boards let a belief about a mate spread by the mate's speed. It is not known here, so the own one is taken.
            ageing.learn_speed(subject.removeprefix("robot/"), speed)
        return ageing.spread(sent.belief, subject, time - sent.time)

    @property
    def saves(self) -> bool:
        """Whether anything is left out at all."""
        return self.slots is not None or math.isfinite(self.bucket.rate)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _note_sent(self, chosen: Mapping[str, Option], time: float) -> None:
        """Keep what the boards have from now on."""
        for subject, option in chosen.items():
            self.sent[subject] = LastSent(time, option.belief)
            if option.whole:
                self._since[subject] = time
            evidence = option.report.evidence
            if evidence is not None and evidence.state is not None:
                self._state_at = evidence.epoch, time
            if evidence is not None:
                self.sightings.said(evidence)
                self.way.said()

    def _chosen(self, options: Mapping[str, list[Option]], time: float, known: Collection[str]) -> dict[str, Option]:
        """Who has waited too long comes first; then the best for its bytes, as long as it is worth the price.

        What the boards' joint knows of other subjects (`known`) it knows from evidence, so beliefs about them wait twice as long.
        """
        chosen: dict[str, Option] = {}
        longest = self.settings.longest
        waiting = sorted((since + longest * (subject in known), subject) for subject, since in self._since.items())
        price = self.price * 2.0 ** (STIFF * (0.5 - self._fill))
        for since, subject in waiting:
            if time - since < longest:
                break
            cheapest = min(
                (option for option in options[subject] if option.whole), key=lambda option: (option.size, -option.worth)
            )
            if not self.bucket.has(cheapest.size):
                return chosen  # bytes are saved for the report that has waited longest, so nothing else is sent
            self._take(chosen, cheapest)
        while moves := [
            (gain / more, option)
            for subject, at in options.items()
            for option in at
            if (more := option.size - (chosen[subject].size if subject in chosen else 0)) > 0
            and (gain := option.worth - (chosen[subject].worth if subject in chosen else 0.0)) / more > price
            and self.bucket.has(more)
        ]:
            self._take(chosen, max(moves, key=lambda move: (move[0], move[1].report.subject))[1])
        return chosen

    def _datagram(self, options: Mapping[str, list[Option]], time: float) -> dict[str, Option]:
        """The one message of a slot: what the robot adds to a joint, else what has waited too long, else what is worth most."""
        own = [subject for subject, choices in options.items() if choices[0].report.evidence is not None]
        overdue = [subject for subject in options if time - self._since[subject] >= self.settings.longest]
        subjects = own or sorted(overdue, key=lambda subject: (self._since[subject], subject))[:1] or list(options)
        most = DATAGRAM * self.copies
        fitting = [
            option for s in subjects for option in options[s] if option.size <= most and self.bucket.has(option.size)
        ]
        chosen = dict[str, Option]()
        if fitting:
            self._take(
                chosen,
                max(fitting, key=lambda option: (option.whole, option.worth, -option.size, option.report.subject)),
            )
        return chosen

    def _take(self, chosen: dict[str, Option], option: Option) -> None:
        before = chosen.get(option.report.subject)
        self.bucket.spend(option.size - (0 if before is None else before.size))
        chosen[option.report.subject] = option

    @property
    def _fill(self) -> float:
        return min(1.0, max(0.0, self.bucket.level / self.bucket.burst))

    def _reprice(self, time: float) -> None:
        """The price that leaves the bucket half full is found slowly; until then a fuller bucket makes all cheaper (`STIFF`)."""
        spans = (time - self._priced_at) / self.settings.burst
        self._priced_at = time
        factor = 2.0 ** (SLOW * min(1.0, max(0.0, spans)) * (0.5 - self._fill))
        self.price = min(DEAREST, max(CHEAPEST, self.price * factor))

    def options(
        self, reports: Sequence[Report], stale: Mapping[str, Belief], time: float, team: Mapping[str, TeamKnowledge]
    ) -> dict[str, list[Option]]:
        """For each subject its report as it could be sent, as it is first."""
        options = dict[str, list[Option]]()
        best = {report.subject: reported(report, self.grid)[-1].belief for report in reports}
        for report in reports:
            known = team.get(report.subject)
            mate = self._offers.is_mate(report.subject)
            share = 1.0 if mate else _share(best[report.subject], known)
            if known is not None and known.joint and report.evidence is None:
                share *= JOINT
            if report.evidence is not None:
                options[report.subject] = self._with_evidence(
                    report, best[report.subject], stale[report.subject], share, time, team
                )
            else:
                options[report.subject] = self._offers.of_belief(
                    report, best[report.subject], stale[report.subject], known, share
                )
        return options

    def _with_evidence(
        self, report: Report, best: Belief, stale: Belief, share: float, time: float, team: Mapping[str, TeamKnowledge]
    ) -> list[Option]:
        """For boards that keep a joint: all of it; the evidence with a coarse belief, with fewer sightings; and the motion alone.

        Evidence is as sharp as ever. What was gained and is not sent is gathered by the filter for the next time; sightings are lost.
        """
        evidence = report.evidence
        assert evidence is not None
        mine = team.get(report.subject)
        entered = mine is not None and mine.joint
        worth = share * divergence(best.p, stale.p)
        areas = {subject: about.entropy for subject, about in team.items() if about.joint}
        news = self.sightings.news(evidence, time, None if mine is None else mine.state, areas, self.grid)
        first = coarser(unpack(report.belief, self.grid), report.belief, *(COARSEST if entered else COARSER))
        coarse = report.model_copy(update={"belief": first, "informed": None, "ancestors": {}})
        lean = self._lean(coarse, entered)
        options = [Option(one, self.size(one), worth + sum(news.values()), best) for one in (report, lean)]
        told = lean.evidence
        assert told is not None
        by_news = sorted(told.relatives, key=lambda relative: (-news.get(relative.subject, 0.0), relative.subject))
        for count in range(len(by_news) - 1, -1, -1):
            fewer = told.model_copy(update={"relatives": by_news[:count], "profile": told.profile if count else []})
            some = lean.model_copy(update={"evidence": fewer})
            seen = sum(news.get(relative.subject, 0.0) for relative in by_news[:count])
            options.append(Option(some, self.size(some), worth + seen, best))
        if evidence.increment is not None and entered:  # whom no joint has, it cannot move
            moved = told.model_copy(
                update={"increment": None, "state": None, "relatives": [], "profile": [], "seen": []}
            )
            less = lean.model_copy(update={"evidence": moved})
            lost = gained(evidence, None if mine is None else mine.state)
            options.append(Option(less, self.size(less), max(0.0, worth - share * lost), best, False))
        return options

    def _lean(self, report: Report, entered: bool) -> Report:
        """The evidence without its state, where the boards have it in their joint and heard one lately.

        A board needs a state to let a robot enter its joint, as after it was started again. One that publishes finds that out itself:
        what it then agrees on about the robot is of no joint (`entered`).
        """
        evidence = report.evidence
        assert evidence is not None
        epoch, at = self._state_at
        age = report.time - at
        late = age >= 2 * STATE_EVERY or (age >= STATE_EVERY and self.bucket.has(self.size(report)))
        if not entered or epoch != evidence.epoch or late:
            return report
        return report.model_copy(update={"evidence": evidence.model_copy(update={"state": None})})

    def repeat_state(self) -> None:
        """A board came: the next evidence has the whole state, from which the robot enters its joint."""
        self._state_at = (-1, -math.inf)


def _short(report: Report) -> Report:
    if report.evidence is None:
        return report
    return report.model_copy(update={"evidence": shorter(report.evidence)})


def _share(belief: Belief, known: TeamKnowledge | None) -> float:
    """How much of what the team knows about a subject a belief may be: the area of the one over that of the other."""
    return 1.0 if known is None else min(1.0, math.exp(known.entropy - entropy_of(belief.p)))
