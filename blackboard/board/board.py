"""Board: where a sub-team's reports meet. Pure: reports in, consensuses out; time is an argument, there is no I/O.

Two fusions (Table I): `settle` pools the sub-team's reports into the `consensus`, `exchange` pools the consensuses of all
sub-teams into the `agreed` belief. Both keep what arrives by subject and source, so the result does not depend on the order of
arrival. With fusion = "joint" the robots' evidence is kept beside them, and what is agreed comes from the joint where it knows
a subject.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from blackboard.board.clusters import Clusters
from blackboard.board.dissent import DissentJudge
from blackboard.board.entries import Entries, Entry
from blackboard.board.fusion import Fusion, fuse_opinions
from blackboard.board.guests import WAITS, Guests
from blackboard.board.joint.desk import FINEST, JointDesk
from blackboard.board.learning import Learner
from blackboard.board.memory import packed_memory, remembered
from blackboard.board.unnamed import may_be
from blackboard.config import BoardSection
from blackboard.opinion.ageing import Ageing
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.bell import width
from blackboard.opinion.gaussian.once import Settle, settle_alone
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion
from blackboard.opinion.weights import entropy_of
from blackboard.wire import messages as wire
from blackboard.wire.arrays import pack
from blackboard.wire.evidence import Forwarded
from blackboard.wire.memory import Memory, PackedMemory
from blackboard.wire.messages import Consensus, Informed, Learned, LeftOut, Report, Used
from blackboard.wire.opinions import check_stamp, reported, settled
from blackboard.wire.types import MAX_OPINIONS, capped

#: What is done for one subject happens within one of these, which may survive an exception so that the other subjects go on.
Survive = Callable[[str], AbstractContextManager[object]]


class LevelRecord(NamedTuple):
    """How far the sources of one level are believed: what was learned of them, and who disagrees with the others."""

    learner: Learner
    dissent: DissentJudge


class Board:
    """The blackboard of one sub-team: hear reports, settle, hear the other boards, exchange. Times are team time in seconds."""

    def __init__(
        self,
        sub_team: str,
        board: str,
        grid: Grid,
        settings: BoardSection,
        survive: Survive = lambda subject: nullcontext(),
        counters: Counter[str] | None = None,
        guests: Guests | None = None,
        settle: Settle = settle_alone,
    ) -> None:
        """`survive` is entered for each subject that is fused; by default an exception is the caller's.

        `counters` and `settle` are of a joint. `guests`: by default there are none.
        """
        self.sub_team = sub_team
        self.name = board
        self.grid = grid
        self.settings = settings
        self.ageing = Ageing(settings.drift, grid)
        self._survive = survive
        self._guests = Guests() if guests is None else guests
        self._entries: Entries[str] = Entries(grid.size)  # of robots: their newest reports
        self._consensuses = Entries(grid.size, (sub_team, board))  # of boards, by sub-team and name
        #: how far each source is believed: of robots, and of sub-teams
        self._sources = {level: LevelRecord(Learner(level), DissentJudge(level)) for level in ("consensus", "agreed")}
        counters = Counter() if counters is None else counters
        is_apart = settings.fusion == "opinions"
        self.joint = None if is_apart else JointDesk(grid, settings, counters, self.ageing, settle)
        self.clusters = Clusters(grid, self.ageing, sub_team) if is_apart else None

    # --- the sub-team's reports ---------------------------------------------------------------------------------------

    def hear(self, report: Report, now: float) -> None:
        """Take the opinions of a report. Refused: "grid", "mass", "future", "past", "too-many"."""
        self.check_time(report.time, now)
        opinions = reported(report, self.grid, self.settings.feedback)
        self._entries.keep(report.subject, report.source, Entry(report.tick, report.time, opinions))
        is_own = report.subject == f"robot/{report.source}"
        if self.clusters is not None and is_own and not self._guests.waits(report.source):
            self.clusters.hear_report(report)

    def hear_evidence(self, report: Report, skew: float) -> None:
        """Take what a report holds for the joint, by a clock maybe `skew` seconds ahead. Refused: as in `JointDesk.take_evidence`."""
        evidence = report.evidence if report.subject == f"robot/{report.source}" else None
        if self.joint is not None and evidence is not None and not self._guests.waits(report.source):
            self.joint.take_evidence(report.source, report.tick, report.time, evidence, own=True, skew=skew)

    def remember_tracks(self, numbers: Mapping[str, int]) -> None:
        """Give no track a number that a robot has heard of before this board was there, by what is before it in the name."""
        if self.joint is not None:
            self.joint.team.tracks.remember(numbers)
        if self.clusters is not None:
            self.clusters.tracks.remember(numbers)

    def withdraw(self, source: str, tick: int, subjects: Collection[str]) -> None:
        """Drop a source's reports from before `tick` on subjects that it no longer lists."""
        self._entries.withdraw(source, tick, subjects)

    def settle(self, tick: int, now: float, counts: Callable[[str], bool] = lambda robot: True) -> list[Consensus]:
        """The consensus on every subject that was reported, sorted by subject; the board hears them itself, for the exchange.

        A robot in several sub-teams `counts` in the exchange through one of them: elsewhere it is left out of the first-hand part.
        """
        settled, tracks = [], self._cluster(now)
        for subject in sorted({*self._entries, *tracks}):
            with self._survive(subject):
                entries, silent = self._entries.usable(subject, now, self.settings.max_age)
                entries = {**tracks.get(subject, {}), **entries}
                if subject.startswith("robot/"):
                    self._guests.hear_place(subject.removeprefix("robot/"), entries)
                aside = self._guests.aside(entries, now)
                entries = {source: entry for source, entry in entries.items() if source not in aside}
                votes = {source: self._vote(source, subject, entries[source]) for source in sorted(entries)}
                opinions = [o for vote in votes.values() for o in self._aged(vote, subject, now)]
                if opinions:
                    fusion = self._fuse("consensus", opinions, subject, now, counts)
                    left_out = [*_left_out(silent), *(LeftOut(source=one, reason=WAITS) for one in sorted(aside))]
                    made = self._consensus("consensus", subject, tick, now, fusion, left_out)
                    existence = None if self.clusters is None else self.clusters.existence(subject)
                    settled.append(made.model_copy(update={"existence": existence}))
                    self.hear_consensus(settled[-1], now)
        self.withdraw_consensuses(self.sub_team, tick, [consensus.subject for consensus in settled])
        self._guests.forget(self._entries.sources())
        return settled

    def _cluster(self, now: float) -> Mapping[str, Mapping[str, Entry]]:
        """What robots say of subjects that they did not name, by subject and robot."""
        if self.clusters is None:
            return {}
        here, others = dict[str, Belief](), dict[str, Belief]()
        for subject in () if self.clusters.is_idle else self._consensuses:
            known = self._consensuses.young(subject, now, self.settings.max_age)
            mine = {source: entry for source, entry in known.items() if source == (self.sub_team, self.name)}
            for level, entries in ((here, mine), (others, {name: known[name] for name in known.keys() - mine.keys()})):
                if entries:
                    _, newest = max(entries.items(), key=lambda item: (item[1].time, item[0]))
                    whole = self._aged(replace(newest, opinions=newest.opinions[-1:]), subject, now)
                    level[subject] = whole[0].belief
        with self._survive("unnamed sightings"):
            return self.clusters.settle(now, self.settings.max_age, here, others)
        return {}

    def forward(self, time: float) -> list[Forwarded]:
        """The evidence of the own robots since the last call, at a team time (s), for the joints of the other boards."""
        return [] if self.joint is None else self.joint.forward(time)

    # --- the exchange -------------------------------------------------------------------------------------------------

    def hear_consensus(self, consensus: Consensus, now: float) -> None:
        """Take a consensus of another sub-team's board, or this board's own, for the exchange. Refused as in `hear`."""
        self.check_time(consensus.time, now)
        entry = Entry(consensus.tick, consensus.time, settled(consensus, self.grid), consensus.existence)
        self._consensuses.keep(consensus.subject, (consensus.sub_team, consensus.board), entry)

    def withdraw_consensuses(self, sub_team: str, tick: int, subjects: Collection[str]) -> None:
        """Drop a sub-team's consensuses from before `tick`, of all its boards, on subjects that it no longer lists."""
        for source in self._consensuses.sources():
            if source[0] == sub_team:
                self._consensuses.withdraw(source, tick, subjects)

    def exchange(self, tick: int, now: float, robots: Collection[str] = ()) -> list[Consensus]:
        """The agreed belief on every subject of which there is one, sorted by subject.

        As many as a status can list: first those of the joint and about `robots`. On all else opinions are pooled, one of each
        sub-team, however many boards it has: the consensus of the newest tick, then of the board whose name sorts first.
        """
        agreed = self._marginals(tick, now)
        first = agreed.keys() | {f"robot/{robot}" for robot in robots}
        for subject in self._consensuses:
            if subject in agreed:
                continue
            with self._survive(subject):
                usable, silent = self._consensuses.usable(subject, now, self.settings.max_age)
                newest = sorted(usable, key=lambda source: (source[0], -usable[source].tick, source[1]), reverse=True)
                # Of several boards of a sub-team the newest consensus, which comes last, is kept.
                entries = {sub_team: usable[sub_team, board] for sub_team, board in newest}
                left_out = _left_out({name: age for (name, _), age in silent.items() if name not in entries})
                opinions = [o for sub_team in sorted(entries) for o in self._aged(entries[sub_team], subject, now)]
                if len(entries) == 1:  # one sub-team: its consensus is the agreed belief
                    opinions = opinions[-1:]
                if opinions:
                    fusion = self._fuse("agreed", opinions, subject, now)
                    lost = None if self.joint is None else self.joint.lost(subject)
                    consensus = self._consensus("agreed", subject, tick, now, fusion, left_out)
                    exists = [entry.existence for entry in entries.values() if entry.existence is not None]
                    told = {"lost": lost, "existence": max(exists, default=None)}
                    agreed[subject] = consensus.model_copy(update=told)
        kept = sorted(agreed, key=lambda subject: (subject not in first, subject))[:MAX_OPINIONS]
        return [agreed[subject] for subject in sorted(kept)]

    def _marginals(self, tick: int, now: float) -> dict[str, Consensus]:
        """What the joint knows, by subject."""
        make = partial(Consensus, board=self.name, sub_team=self.sub_team, level="agreed", tick=tick, time=now)
        with self._survive("the joint"):
            return (
                {}
                if self.joint is None
                else {consensus.subject: consensus for consensus in self.joint.settle(now, make)}
            )
        return {}

    def check(self) -> None:
        """AssertionError: what holds of its entries between two calls does not."""
        self._entries.check()
        self._consensuses.check()

    def believed(self) -> dict[str, list[Learned] | list[wire.Dissent]]:
        """The fields of a status about who is believed: of robots, then of sub-teams.

        `learned`: what was learned of every source with independence "learn". `dissent`: who keeps disagreeing with the others, last
        the robots in the joint.
        """
        dissents = [of.dissent for of in self._sources.values()]
        dissents += [] if self.joint is None else [self.joint.dissent]
        learned = [one for of in self._sources.values() for one in of.learner.learned()]
        return {"learned": learned, "dissent": [one for dissent in dissents for one in dissent.named()]}

    def memory(self, level: str) -> PackedMemory:
        """What is remembered of robots ("consensus"), or of sub-teams ("agreed")."""
        return packed_memory(*self._sources[level])

    def remember(self, memory: Memory) -> None:
        """Go on from what another board remembered, or this one in an earlier life. Refused: "fields"."""
        axes = self.grid.ndim
        sources = {level: remembered(getattr(memory, level), level, memory.time, axes) for level in self._sources}
        self._sources = {level: LevelRecord(*of) for level, of in sources.items()}

    # --- shared ---------------------------------------------------------------------------------------------------------

    def check_time(self, time: float, now: float) -> None:
        """Check a stamp, both in seconds of team time. Refused: "future", "past"."""
        check_stamp(time, now, future=self.settings.future, max_age=self.settings.max_age)

    def _vote(self, source: str, subject: str, entry: Entry) -> Entry:
        """A report about a subject as far as the robot's sensors can know it, whatever it claims first-hand.

        No place is known better than to `sharpest`. A sighting of a mate is at most as good as the observer's own place.
        """
        first, *more = entry.opinions
        if self.settings.feedback == "paper":
            return entry
        least = (self.settings.sharpest or self.grid.cell / FINEST) ** 2
        own = self._entries.of(f"robot/{source}", source)
        if own is not None and subject.startswith("robot/") and subject != f"robot/{source}":
            least += width(own.opinions[0].belief) ** 2
        lacking = least - width(first.belief) ** 2
        if lacking <= 0:
            return entry
        belief = Belief(self.grid, blur(first.belief.p, math.sqrt(lacking) / self.grid.cell))
        return replace(entry, opinions=(replace(first, belief=belief), *more))

    def _aged(self, entry: Entry, subject: str, now: float) -> list[Opinion]:
        """The opinions as they stand now: an old one has spread as its subject moves."""
        return self.ageing.aged(entry.opinions, subject, max(0.0, now - entry.time))

    def _fuse(
        self,
        level: str,
        opinions: list[Opinion],
        subject: str,
        now: float,
        counts: Callable[[str], bool] = lambda robot: True,
    ) -> Fusion:
        learner, dissent = self._sources[level]
        return fuse_opinions(opinions, self.grid, self.settings, subject, learner, now, dissent, counts)

    def _capped(self, ancestors: dict[str, float]) -> dict[str, float]:
        """As many ancestors as a message holds: the robots that report to this board, then the others by name."""
        return capped(ancestors, self._entries.sources)

    def _consensus(
        self, level: str, subject: str, tick: int, now: float, fusion: Fusion, left_out: list[LeftOut]
    ) -> Consensus:
        first = None if fusion.is_firsthand else pack(fusion.firsthand, self.settings.coding)
        parameters = fusion.rule.in_force()
        dissent = self._sources[level].dissent
        weights = {share.opinion.source: share.weight for share in fusion.shares if share.how == "independent"}
        camps = dissent.told_camps(subject, weights)
        return Consensus(
            board=self.name,
            sub_team=self.sub_team,
            level=level,  # type: ignore[arg-type]
            subject=subject,
            tick=tick,
            time=now,
            belief=pack(fusion.belief, self.settings.coding),
            ancestors=self._capped(fusion.ancestors),
            firsthand=None
            if first is None
            else Informed(belief=first, ancestors=self._capped(fusion.firsthand_ancestors)),
            used=[
                Used(
                    source=s.opinion.source,
                    weight=s.weight,
                    age=s.opinion.age,
                    entropy=entropy_of(s.opinion.belief.p),
                    how=s.how,  # type: ignore[arg-type]
                    power=s.power,
                )
                for s in fusion.shares
            ],
            left_out=left_out,
            components=fusion.components,
            entropy=entropy_of(fusion.belief.p),
            conflict=fusion.conflict or bool(camps),
            rule=str(parameters.pop("rule")),
            parameters=parameters,
            outcome=fusion.outcome,
            learned=fusion.learned,
            dissent=dissent.named({share.opinion.source for share in fusion.shares}),
            camps=camps,
            unnamed=[] if self.clusters is None else may_be(subject, self.clusters.unnamed),
        )


def _left_out(silent: dict[str, float]) -> list[LeftOut]:
    return [LeftOut(source=source, reason=f"silent for {age:.1f} s") for source, age in silent.items()]
