"""What a bridge shows of a team: each settled tick once, in its order, and what happened. Pure."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
import numpy.typing as npt

from blackboard.state.moments import About, Moment
from blackboard.state.received import STEP, Drawn
from blackboard.state.team import Event, TeamFold
from blackboard.view.feed import Source

TRAIL = 60.0  # seconds of team time

Image = npt.NDArray[np.float32]


class Sink(Protocol):
    """A viewer: it gets moments and events in the order in which they came."""

    def show(self, team: TeamFold, moment: Moment) -> None: ...

    def note(self, event: Event) -> None: ...


class TeamStream:
    """Follows a team of a source; `new` is called after each look."""

    def __init__(self, source: Source, team: str) -> None:
        self._source, self._team = source, team
        self._shown: tuple[str, int] = ("", -1)  # run and tick
        self._noted: Event | None = None

    def new(self, sink: Sink) -> int:
        """Show what is new, and return how many moments that were. A new run begins anew."""
        team = self._source.fold.teams.get(self._team)
        newest = None if team is None else team.moments.newest
        if team is None:
            return 0
        for event in self._events(team):
            sink.note(event)
        if newest is None:
            return 0
        moments = team.moments.since(self._shown[1] if self._shown[0] == newest.run else -1)
        for moment in moments:
            sink.show(team, moment)
            self._shown = moment.run, moment.tick
        return len(moments)

    def _events(self, team: TeamFold) -> Iterator[Event]:
        """The events that came after the last one that was noted."""
        events = list(team.events)
        known = next((n for n in range(len(events) - 1, -1, -1) if events[n] is self._noted), -1)
        for event in events[known + 1 :]:
            self._noted = event
            yield event


def agreed(moment: Moment) -> Iterator[tuple[str, About, Drawn]]:
    """Each subject with the belief that stands for it, for those whose belief can be drawn."""
    for name, about in moment.subjects.items():
        drawn = None if about.best is None else about.best.drawn
        if drawn is not None:
            yield name, about, drawn


def masses(drawn: Drawn) -> Image:
    """The probabilities of the cells of a belief's box, shape `box`."""
    levels = np.frombuffer(drawn.levels, np.uint8).reshape(drawn.box).astype(np.float32)
    return np.where(levels > 0, drawn.peak * np.exp((levels - 255.0) * STEP), 0.0).astype(np.float32)


def corner(moment: Moment, name: str, drawn: Drawn) -> tuple[float, float, float]:
    """The lower corner of a belief's box and the size of a cell, in the grid's unit."""
    best = moment.subjects[name].best
    assert best is not None
    grid = best.message.belief.grid
    x, y = (low + at * grid.cell for low, at in zip(grid.origin, drawn.lo, strict=True))
    return x, y, grid.cell
