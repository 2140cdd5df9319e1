"""Board: where a sub-team's reports meet. Pure: reports in, consensuses out; time is an argument, there is no I/O.

Two fusions (Table I): `settle` pools the sub-team's reports into the `consensus`, `exchange` pools the consensuses of all
sub-teams into the `agreed` belief. Both keep what arrives by subject and source, so the order of arrival does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TypeVar

from blackboard.board import learning
from blackboard.board.fusion import Fusion, fuse_opinions
from blackboard.board.learning import Learner
from blackboard.board.provenance import Opinion
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, Learned, LeftOut, Report, Used

MAX_SUBJECTS = 256  # a board's memory is bounded, whatever is sent to it
MAX_SOURCES = 64

Source = TypeVar("Source", str, tuple[str, str])  # a robot; or a sub-team and one of its boards


@dataclass(frozen=True)
class Entry:
    """The newest report of one source about one subject, or the newest consensus of one sub-team's board."""

    tick: int
    time: float
    opinions: tuple[Opinion, ...]


class Board:
    """The blackboard of one sub-team: `hear` reports, `settle` subjects, hear the other boards, `exchange`."""

    def __init__(self, sub_team: str, board: str, grid: Grid, settings: BoardSection) -> None:
        self.sub_team = sub_team
        self.name = board
        self.grid = grid
        self.settings = settings
        self._entries: dict[str, dict[str, Entry]] = {}  # subject -> source -> its newest report
        self._consensuses: dict[str, dict[tuple[str, str], Entry]] = {}  # subject -> sub-team and board -> its newest
        self._learners = {"consensus": Learner(), "agreed": Learner()}  # of robots, and of sub-teams

    # --- the sub-team's reports ---------------------------------------------------------------------------------------

    def hear(self, report: Report, now: float) -> None:
        """Take a report; `now` is team time in seconds. Refused: "grid", "mass", "future", "past"."""
        self.check_time(report.time, now)
        own = report.ancestors or {report.source: report.time}
        opinions = [Opinion(report.source, unpack(report.belief, self.grid), own)]
        if report.informed is not None:
            informed = unpack(report.informed.belief, self.grid)
            opinions.append(Opinion(report.source, informed, report.informed.ancestors))
        self._keep(self._entries, report.subject, report.source, Entry(report.tick, report.time, tuple(opinions)))

    def withdraw(self, source: str, tick: int, subjects: Collection[str]) -> None:
        """Drop a source's reports from before `tick` on subjects that it no longer lists."""
        _withdraw(self._entries, source, tick, subjects)

    def settle(self, tick: int, now: float) -> list[Consensus]:
        """The consensus on every subject that somebody reported, sorted by subject."""
        found = []
        for subject in sorted(self._entries):
            entries, silent = self._usable(self._entries[subject], now)
            opinions = [o for source in sorted(entries) for o in self._admitted(entries[source], now)]
            if opinions:
                fusion = self._fuse("consensus", opinions, subject, now)
                found.append(self._consensus("consensus", subject, tick, now, fusion, _left_out(silent)))
        self._entries = {subject: entries for subject, entries in self._entries.items() if entries}
        return found

    # --- the exchange -------------------------------------------------------------------------------------------------

    def hear_consensus(self, consensus: Consensus, now: float) -> None:
        """Take a consensus of another sub-team's board, or this board's own, for the exchange. Refused as in `hear`."""
        self.check_time(consensus.time, now)
        belief = Opinion(consensus.sub_team, unpack(consensus.belief, self.grid), consensus.ancestors)
        opinions = [belief]
        if consensus.firsthand is not None:
            firsthand = unpack(consensus.firsthand.belief, self.grid)
            opinions.insert(0, Opinion(consensus.sub_team, firsthand, consensus.firsthand.ancestors))
        entry = Entry(consensus.tick, consensus.time, tuple(opinions))
        self._keep(self._consensuses, consensus.subject, (consensus.sub_team, consensus.board), entry)

    def withdraw_consensuses(self, sub_team: str, board: str, tick: int, subjects: Collection[str]) -> None:
        """Drop a board's consensuses from before `tick` on subjects that it no longer lists: its sub-team lost sight of them."""
        _withdraw(self._consensuses, (sub_team, board), tick, subjects)

    def exchange(self, tick: int, now: float) -> list[Consensus]:
        """The agreed belief on every subject that any sub-team has a consensus on, sorted by subject.

        A sub-team counts once, however many boards it has: by the consensus of the newest tick, then of the board whose
        name sorts first.
        """
        found = []
        for subject in sorted(self._consensuses):
            usable, silent = self._usable(self._consensuses[subject], now)
            newest = sorted(usable, key=lambda source: (source[0], -usable[source].tick, source[1]), reverse=True)
            entries = {sub_team: usable[sub_team, board] for sub_team, board in newest}  # the first of each comes last
            left_out = _left_out({sub_team: age for (sub_team, _), age in silent.items() if sub_team not in entries})
            opinions = [o for sub_team in sorted(entries) for o in self._aged(entries[sub_team], now)]
            if not opinions:
                continue
            if len(entries) == 1:  # one sub-team: its consensus is the agreed belief
                opinions = opinions[-1:]
            fusion = self._fuse("agreed", opinions, subject, now)
            found.append(self._consensus("agreed", subject, tick, now, fusion, left_out))
        self._consensuses = {subject: entries for subject, entries in self._consensuses.items() if entries}
        return found

    def learned(self) -> list[Learned]:
        """What was learned of every source with independence "learn": of robots, then of sub-teams."""
        return [_told(level, it) for level, learner in self._learners.items() for it in learner.learned()]

    # --- shared ---------------------------------------------------------------------------------------------------------

    def check_time(self, time: float, now: float) -> None:
        """Check a stamp, both in seconds of team time. Refused: "future", "past"."""
        if time > now + self.settings.future:
            raise Refused("future", f"stamped {time - now:.1f} s ahead of team time {now:.1f} s")
        if time < now - self.settings.max_age:
            raise Refused("past", f"stamped {now - time:.1f} s ago, older than {self.settings.max_age:g} s")

    @staticmethod
    def _keep(entries: dict[str, dict[Source, Entry]], subject: str, source: Source, entry: Entry) -> None:
        if subject not in entries and len(entries) >= MAX_SUBJECTS:
            raise Refused("too-many", f"{subject} would be one more than {MAX_SUBJECTS} subjects")
        known = entries.setdefault(subject, {}).get(source)
        if known is None and len(entries[subject]) >= MAX_SOURCES:
            raise Refused("too-many", f"{source} would be one more than {MAX_SOURCES} sources on {subject}")
        if known is None or entry.time >= known.time:
            entries[subject][source] = entry

    def _usable(self, entries: dict[Source, Entry], now: float) -> tuple[dict[Source, Entry], dict[Source, float]]:
        """The entries that are young enough; the others are forgotten, and returned once as source -> age in seconds."""
        oldest = now - self.settings.max_age
        silent = {source: now - entries[source].time for source in sorted(entries) if entries[source].time < oldest}
        for source in silent:
            del entries[source]
        return dict(entries), silent

    def _admitted(self, entry: Entry, now: float) -> list[Opinion]:
        """Which opinions of a report count, by `feedback`: both, the informed one alone, or the first-hand one alone."""
        opinions = self._aged(entry, now)
        if self.settings.feedback == "paper":
            return opinions[-1:]
        return opinions[:1] if self.settings.feedback == "off" else opinions

    def _aged(self, entry: Entry, now: float) -> list[Opinion]:
        """The opinions as they stand now: an old one has spread by `drift` per square root of a second."""
        age = max(0.0, now - entry.time)
        sigma = self.settings.drift * math.sqrt(age) / self.grid.cell
        return [replace(o, belief=Belief(self.grid, blur(o.belief.p, sigma)), age=age) for o in entry.opinions]

    def _fuse(self, level: str, opinions: list[Opinion], subject: str, now: float) -> Fusion:
        return fuse_opinions(opinions, self.grid, self.settings, subject, self._learners[level], now)

    def _consensus(
        self, level: str, subject: str, tick: int, now: float, fusion: Fusion, left_out: list[LeftOut]
    ) -> Consensus:
        parameters = fusion.rule.in_force()
        whole = all(share.how == "independent" for share in fusion.shares)
        return Consensus(
            board=self.name,
            sub_team=self.sub_team,
            level=level,  # type: ignore[arg-type]
            subject=subject,
            tick=tick,
            time=now,
            belief=pack(fusion.belief),
            ancestors=fusion.ancestors,
            firsthand=None if whole else Informed(belief=pack(fusion.firsthand), ancestors=fusion.firsthand_ancestors),
            used=[
                Used(
                    source=s.opinion.source,
                    weight=s.weight,
                    age=s.opinion.age,
                    entropy=entropy(s.opinion.belief.p),
                    how=s.how,  # type: ignore[arg-type]
                )
                for s in fusion.shares
            ],
            left_out=left_out,
            components=fusion.components,
            entropy=entropy(fusion.belief.p),
            conflict=fusion.conflict,
            rule=str(parameters.pop("rule")),
            parameters=parameters,
            outcome=fusion.outcome,
            learned=[_told(level, it) for it in fusion.learned],
        )


def _withdraw(entries: dict[str, dict[Source, Entry]], source: Source, tick: int, subjects: Collection[str]) -> None:
    for subject, by_source in entries.items():
        if subject not in subjects and source in by_source and by_source[source].tick < tick:
            del by_source[source]


def _told(level: str, it: learning.Learned) -> Learned:
    return Learned(
        level=level,  # type: ignore[arg-type]
        source=it.source,
        samples=it.samples,
        variance=it.variance,
        correlation=it.correlation,
        echo=it.echo,
        since=it.since,
    )


def _left_out(silent: dict[str, float]) -> list[LeftOut]:
    return [LeftOut(source=source, reason=f"silent for {age:.1f} s") for source, age in silent.items()]
