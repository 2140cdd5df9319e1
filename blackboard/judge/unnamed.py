"""What a team makes of things that nobody names to it: its tracks against the truth, kind by kind. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, TypeVar

from blackboard.errors import Refused
from blackboard.judge.instant import Instant
from blackboard.judge.tracks import Track, Tracks
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import unpack
from blackboard.wire.messages import Consensus

T = TypeVar("T")


class Unnamed:
    """Takes each judged instant once; `summary` is the scorecard's block "tracks"."""

    def __init__(self, grid: Grid, cut: float, kinds: Iterable[str]) -> None:
        """`kinds` are those that sightings do not name; a track farther than `cut` (unit) from a thing is not of it."""
        self._grid = grid
        self._tracks = {kind: Tracks(cut) for kind in kinds}

    def is_unnamed(self, subject: str) -> bool:
        """Whether a subject is of a kind that nobody names."""
        return subject.partition("/")[0] in self._tracks

    def hear(self, instant: Instant, team: Collection[str]) -> None:
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
            judge.hear(_of(kind, things), _of(kind, tracks))

    def _track(self, told: Consensus) -> Track | None:
        try:
            x, y = unpack(told.belief, self._grid).mean()
        except Refused:
            return None
        return Track((float(x), float(y)))

    def summary(self) -> dict[str, dict[str, Any]]:
        """Kind -> what `Tracks.summary` says, as far as there was a thing or a track of it."""
        return {kind: found for kind, judge in sorted(self._tracks.items()) if (found := judge.summary())}


def _of(kind: str, by_subject: dict[str, T]) -> dict[str, T]:
    return {subject: it for subject, it in by_subject.items() if subject.startswith(f"{kind}/")}
