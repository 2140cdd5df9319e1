"""Tracks of unnamed things, compared with the true things. Pure; running sums.

Two pairings answer two questions. How far the tracks are from the things at this time is GOSPA's, the best of this tick. Which
track is which thing lasts: a pair stays until it is farther apart than the cut, and only what is left over is paired anew
(K. Bernardin, R. Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics", 2008).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from blackboard.judge.forecasts import Forecasts
from blackboard.judge.gospa import gospa
from blackboard.opinion.grid import Array

Place = tuple[float, float]


@dataclass(frozen=True)
class TrackAt:
    """One track at one time."""

    place: Place  # in the grid's unit
    existence: float | None = None  # the probability that the track is of a real thing; None where the board gives none


class TrackJudge:
    """Takes the tracks and the things of one kind tick by tick; `summary` is one entry of the scorecard's block "tracks"."""

    def __init__(self, cut: float) -> None:
        """A track farther than `cut` (in the grid's unit) from a thing is not of it."""
        self._cut = cut
        self._ticks = self._things = self._missed = self._switches = self._false_tracks = 0
        self._parts = np.zeros(3)  # localisation, missed, false: squared unit, over all ticks
        self._pairs: dict[str, str] = {}  # thing -> its track, in the tick before
        self._last: dict[str, str] = {}  # thing -> the track that it had last
        self._unmet: dict[str, bool] = {}  # of each track that lives: whether it was never near a thing
        self._existence = Forecasts()

    def judge_instant(self, things: Mapping[str, Place], tracks: Mapping[str, TrackAt]) -> None:
        """Take one tick: where each thing is, and what the team says."""
        named, known = sorted(things), sorted(tracks)
        matched = gospa(_rows([things[t] for t in named]), _rows([tracks[t].place for t in known]), self._cut)
        self._ticks += 1
        self._things += len(named)
        self._missed += len(named) - len(matched.pairs)
        self._parts += (matched.localisation, matched.missed, matched.false)
        met = {known[j] for _, j in matched.pairs}
        self._live(known, met)
        for name in known:
            told = tracks[name].existence
            if told is not None:
                self._existence.add(told, name in met)
        self._follow(things, tracks)

    def _live(self, known: list[str], met: set[str]) -> None:
        """A track that ends without ever having been near a thing was false, and its name may be used again."""
        ended = self._unmet.keys() - set(known)
        self._false_tracks += sum(self._unmet.pop(name) for name in ended)
        for name in known:
            self._unmet[name] = self._unmet.get(name, True) and name not in met

    def _follow(self, things: Mapping[str, Place], tracks: Mapping[str, TrackAt]) -> None:
        """Pair what lasts, then the rest; a thing that has another track than last time has switched."""
        kept = {
            thing: track
            for thing, track in self._pairs.items()
            if thing in things and track in tracks and math.dist(things[thing], tracks[track].place) < self._cut
        }
        rest, free = sorted(things.keys() - kept.keys()), sorted(tracks.keys() - set(kept.values()))
        again = gospa(_rows([things[t] for t in rest]), _rows([tracks[t].place for t in free]), self._cut)
        new = {rest[i]: free[j] for i, j in again.pairs}
        self._switches += sum(self._last.get(thing, track) != track for thing, track in new.items())
        self._pairs = kept | new
        self._last |= new

    def summary(self) -> dict[str, Any]:
        """GOSPA as a root mean square over ticks, and what of its square is which error; counts; the forecasts of existence.

        Empty where there was never a thing or a track.
        """
        if not self._things and not self._unmet and not self._parts.any():
            return {}
        localisation, missed, false = (self._parts / self._ticks).tolist()
        return {
            "ticks": self._ticks,
            "gospa": math.sqrt(localisation + missed + false),
            "localisation": localisation,
            "missed": missed,
            "false": false,
            "missed_share": self._missed / self._things if self._things else None,
            "switches": self._switches,
            "false_tracks": self._false_tracks + sum(self._unmet.values()),
            "existence": self._existence.summary(),
        }


def _rows(places: list[Place]) -> Array:
    return np.array(places, dtype=float).reshape(-1, 2)
