"""A tape to look at: read through the fold, as far as a question needs it."""

import json
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from types import TracebackType

from blackboard.config import Scenario
from blackboard.errors import RunFailed, UserError
from blackboard.state.moments import Moment, When
from blackboard.state.team import TeamFold
from blackboard.tables import parse
from blackboard.view.feed import TapeFeed
from blackboard.wire.envelope import Envelope


class Taped:
    """The team on a tape: its name, its boards' drift, and a feed that has read nothing yet."""

    def __init__(
        self,
        file: Path,
        envelopes: Iterator[tuple[float, Envelope]],
        metadata: Callable[[], Mapping[str, str]],
        team: str | None,
    ) -> None:
        """`metadata` is what the tape says about itself, known with its first envelope. UserError: a tape without any."""
        first = next(envelopes, None)
        if first is None:
            raise UserError(f"{file}: there is no message on this tape; record a team that runs")
        about = metadata()
        self.file = file
        self.team = team or about.get("team") or first[1].key.split("/")[1]
        self.feed = TapeFeed(chain([first], envelopes))
        scenario = _scenario(about.get("scenario", ""))
        self.drift = scenario.board.drift
        if about.get("scenario"):
            self.feed.fold.expect(self.team, scenario.team.sub_teams)

    def __enter__(self) -> "Taped":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Nothing was opened but the file, which is closed at its end."""

    @property
    def fold(self) -> TeamFold:
        """The team as far as the tape was read."""
        return self.feed.fold.team(self.team)

    def silence(self) -> str:
        """A tape that can be opened has something on it."""
        return ""

    def read_on(self, each: Callable[[], None] = lambda: None) -> None:
        """Read to the end, and call `each` after every few envelopes."""
        while not self.feed.done:
            self.feed.hear_envelopes(self.feed.receive())
            each()

    def moment(self, when: When | None, seconds: float = 0.0) -> Moment:
        """The moment that is meant in the last run that has it, or the newest; reads to the end. RunFailed: there is none."""
        chosen: Moment | None = None
        seen: Moment | None = None

        def look() -> None:
            nonlocal chosen, seen
            newest = self.fold.moments.newest
            # Each moment once: the older ones are packed.
            if when is not None and newest is not None and newest is not seen:
                last = seen.tick if seen is not None and seen.run == newest.run else -1
                fitting = [moment for moment in self.fold.moments.since(last) if when.fits(moment)]
                chosen, seen = (fitting[-1] if fitting else chosen), newest

        self.read_on(look)
        newest = self.fold.moments.newest
        if newest is None:
            others = ", ".join(sorted(name for name in self.feed.fold.teams if name != self.team))
            there = f"; there is {others}" if others else ""
            raise RunFailed(f"{self.file}: team {self.team} has settled nothing{there}")
        if when is None:
            return newest
        if chosen is None or (when.seconds is not None and not when.is_reached(newest)):
            last_one = f"the last tick is {newest.tick} ({newest.time:.1f} s)"
            raise RunFailed(f"{self.file}: {when} was not settled; {last_one}")
        return chosen


def _scenario(text: str) -> Scenario:
    """The scenario on a tape; the default one where it has none, or one of another version."""
    try:
        return Scenario(parse(text, json.loads) if text else {})
    except (ValueError, UserError):
        return Scenario({})
