"""What a team makes of sightings without a name: whom it took them for, and its tracks of things that have none. Pure."""

from collections.abc import Collection, Iterable
from typing import Any, TypeVar

from blackboard.errors import Refused
from blackboard.judge.forecasts import Forecasts
from blackboard.judge.instant import Instant
from blackboard.judge.tracks import TrackAt, TrackJudge
from blackboard.opinion.classes import kind_of
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus, UnnamedSighting

T = TypeVar("T")


class UnnamedJudge:
    """Takes each judged instant once; its `tracks` and `identities` are the blocks of the scorecard of these names."""

    def __init__(self, grid: Grid, cut: float, kinds: Iterable[str]) -> None:
        """`kinds` are those that sightings do not name; a track farther than `cut` (unit) from a thing is not of it."""
        self._grid = grid
        self._tracks = {kind: TrackJudge(cut) for kind in kinds}
        #: Sightings without a name; taken for a known subject; and for a wrong one.
        self._seen = self._taken = self._wrong = 0
        self._odds = Forecasts()

    def is_unnamed(self, subject: str) -> bool:
        """Whether a subject is of a kind that sightings do not name."""
        return kind_of(subject) in self._tracks

    def judge_instant(self, instant: Instant, team: Collection[str]) -> None:
        """Judge what the first sub-team agreed on; of robots without those of the `team`, whom everybody knows."""
        if not instant.teams:
            return
        mates = {f"robot/{robot}" for robot in team}
        things = {subject: place for subject, place in instant.truth.positions.items() if subject not in mates}
        told = [
            c for c in instant.agreed_by(min(instant.teams)) if c.subject not in mates and self.is_unnamed(c.subject)
        ]
        tracks = {c.subject: track for c in told if (track := self._track(c)) is not None}
        for kind, judge in self._tracks.items():
            judge.judge_instant(_of(kind, things), _of(kind, tracks))
        self._identify(instant)

    def _identify(self, instant: Instant) -> None:
        """Which subjects the boards took this tick's sightings for. Only sightings of things that the truth names are counted."""
        shown = instant.truth.unnamed
        self._seen += sum(len(who) for who in shown.values())
        if not shown:
            return
        told: dict[tuple[str, int, str], UnnamedSighting] = {}
        for consensus in (agreed for sub_team in sorted(instant.teams) for agreed in instant.agreed_by(sub_team)):
            if consensus.subject in instant.truth.positions:
                for one in consensus.unnamed:
                    if one.time == instant.truth.time and one.mark < len(shown.get(one.source, ())):
                        told.setdefault((one.source, one.mark, consensus.subject), one)
        for (source, mark, subject), one in told.items():
            right = shown[source][mark] == subject
            self._odds.add(one.probability, right)
            self._taken += one.taken
            self._wrong += one.taken and not right

    def _track(self, told: Consensus) -> TrackAt | None:
        try:
            x, y = unpack(told.belief, self._grid).mean()
        except Refused:
            return None
        return TrackAt((float(x), float(y)), told.existence)

    def identities(self) -> dict[str, Any]:
        """How many sightings had no name, were taken for a known subject, and for a wrong one; and the odds that were reported.

        Empty where all were named.
        """
        if not self._seen:
            return {}
        return {"n": self._seen, "taken": self._taken, "wrong": self._wrong, "odds": self._odds.summary()}

    def tracks(self) -> dict[str, dict[str, Any]]:
        """Kind -> what `TrackJudge.summary` says, as far as there was a thing or a track of it."""
        return {kind: summary for kind, judge in sorted(self._tracks.items()) if (summary := judge.summary())}


def _of(kind: str, by_subject: dict[str, T]) -> dict[str, T]:
    return {subject: value for subject, value in by_subject.items() if kind_of(subject) == kind}
