"""Board: where a sub-team's reports meet. Pure: reports in, consensuses out; time is an argument, there is no I/O.

Two fusions (Table I): `settle` pools the sub-team's reports into the `consensus`, `exchange` pools the consensuses of all
sub-teams into the `agreed` belief. Both name everything by (subject, source), so the order of arrival never matters.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.fusion import Fusion, fuse_opinions, in_force
from blackboard.opinion.belief import Belief, blur
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.provenance import Opinion
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, LeftOut, Report, Used

MAX_SUBJECTS = 256  # a board's memory is bounded, whatever its members invent
MAX_SOURCES = 64


@dataclass(frozen=True)
class Word:
    """The newest that one source said about one subject: its opinions, and when."""

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
        self._words: dict[str, dict[str, Word]] = {}  # subject -> source -> what it said last
        self._consensuses: dict[str, dict[str, Word]] = {}  # subject -> sub-team -> its board's

    # --- the sub-team's reports ---------------------------------------------------------------------------------------

    def hear(self, report: Report, now: float) -> None:
        """Take a report; `now` is team time in seconds. Refused: "grid", "mass", "future", "past"."""
        self._check_time(report.time, now)
        own = report.ancestors or {report.source: report.time}
        opinions = [Opinion(report.source, unpack(report.belief, self.grid), own)]
        if report.informed is not None:
            informed = unpack(report.informed.belief, self.grid)
            opinions.append(Opinion(report.source, informed, report.informed.ancestors))
        self._keep(self._words, report.subject, report.source, Word(report.tick, report.time, tuple(opinions)))

    def heard(self, source: str, tick: int, subjects: Collection[str]) -> bool:
        """Whether everything that a source says it reported in a tick has arrived."""
        words = (self._words.get(subject, {}).get(source) for subject in subjects)
        return all(word is not None and word.tick >= tick for word in words)

    def withdraw(self, source: str, tick: int, subjects: Collection[str]) -> None:
        """Forget what a source said before `tick` about subjects that it no longer lists."""
        for subject, words in self._words.items():
            if subject not in subjects and source in words and words[source].tick < tick:
                del words[source]

    def settle(self, tick: int, now: float) -> list[Consensus]:
        """The consensus on every subject that somebody reported, sorted by subject."""
        found = []
        for subject in sorted(self._words):
            words, left_out = self._usable(self._words[subject], now)
            opinions = [o for source in sorted(words) for o in self._admitted(words[source], now)]
            if opinions:
                fusion = fuse_opinions(opinions, self.grid, self.settings, subject)
                found.append(self._consensus("consensus", subject, tick, now, fusion, left_out))
        self._words = {subject: words for subject, words in self._words.items() if words}
        return found

    # --- the exchange -------------------------------------------------------------------------------------------------

    def hear_consensus(self, consensus: Consensus, now: float) -> None:
        """Take a consensus of another sub-team's board, or this board's own, for the exchange. Refused as in `hear`."""
        self._check_time(consensus.time, now)
        belief = Opinion(consensus.sub_team, unpack(consensus.belief, self.grid), consensus.ancestors)
        opinions = [belief]
        if consensus.firsthand is not None:
            firsthand = unpack(consensus.firsthand.belief, self.grid)
            opinions.insert(0, Opinion(consensus.sub_team, firsthand, consensus.firsthand.ancestors))
        word = Word(consensus.tick, consensus.time, tuple(opinions))
        self._keep(self._consensuses, consensus.subject, consensus.sub_team, word)

    def heard_consensus(self, sub_team: str, tick: int, subjects: Collection[str]) -> bool:
        """Whether all consensuses that a sub-team's board says it published in a tick have arrived."""
        words = (self._consensuses.get(subject, {}).get(sub_team) for subject in subjects)
        return all(word is not None and word.tick >= tick for word in words)

    def exchange(self, tick: int, now: float) -> list[Consensus]:
        """The agreed belief on every subject that any sub-team has a consensus on, sorted by subject."""
        found = []
        for subject in sorted(self._consensuses):
            words, left_out = self._usable(self._consensuses[subject], now)
            opinions = [o for sub_team in sorted(words) for o in self._aged(words[sub_team], now)]
            if not opinions:
                continue
            if len(words) == 1:  # nobody to exchange with: what the sub-team believes stands
                opinions = opinions[-1:]
            fusion = fuse_opinions(opinions, self.grid, self.settings, subject)
            found.append(self._consensus("agreed", subject, tick, now, fusion, left_out))
        return found

    # --- shared ---------------------------------------------------------------------------------------------------------

    def _check_time(self, time: float, now: float) -> None:
        if time > now + self.settings.future:
            raise Refused("future", f"stamped {time - now:.1f} s ahead of team time {now:.1f} s")
        if time < now - self.settings.max_age:
            raise Refused("past", f"stamped {now - time:.1f} s ago, older than {self.settings.max_age:g} s")

    @staticmethod
    def _keep(words: dict[str, dict[str, Word]], subject: str, source: str, word: Word) -> None:
        if subject not in words and len(words) >= MAX_SUBJECTS:
            raise Refused("too-many", f"{subject} would be one more than {MAX_SUBJECTS} subjects")
        known = words.setdefault(subject, {}).get(source)
        if known is None and len(words[subject]) >= MAX_SOURCES:
            raise Refused("too-many", f"{source} would be one more than {MAX_SOURCES} sources on {subject}")
        if known is None or word.time >= known.time:
            words[subject][source] = word

    def _usable(self, words: dict[str, Word], now: float) -> tuple[dict[str, Word], list[LeftOut]]:
        """The words that are young enough; the others are forgotten and named once."""
        old = sorted(s for s, w in words.items() if w.time < now - self.settings.max_age)
        left_out = [LeftOut(source=s, reason=f"silent for {now - words[s].time:.1f} s") for s in old]
        for source in old:
            del words[source]
        return dict(words), left_out

    def _admitted(self, word: Word, now: float) -> list[Opinion]:
        """Which opinions of a report count, by `feedback`: both, the informed one alone, or the first-hand one alone."""
        opinions = self._aged(word, now)
        if self.settings.feedback == "paper":
            return opinions[-1:]
        return opinions[:1] if self.settings.feedback == "off" else opinions

    def _aged(self, word: Word, now: float) -> list[Opinion]:
        """The opinions as they stand now: an old one has spread by `drift` per square root of a second."""
        age = max(0.0, now - word.time)
        sigma = self.settings.drift * math.sqrt(age) / self.grid.cell
        if sigma == 0.0:
            return list(word.opinions)
        return [replace(o, belief=Belief(self.grid, blur(o.belief.p, sigma)), age=age) for o in word.opinions]

    def _consensus(
        self, level: str, subject: str, tick: int, now: float, fusion: Fusion, left_out: list[LeftOut]
    ) -> Consensus:
        first = fusion.firsthand
        rule = self.settings.of(subject)
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
            firsthand=None if whole else Informed(belief=pack(first.belief), ancestors=dict(first.ancestors)),
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
            rule=rule.rule,
            parameters=in_force(rule),
        )
