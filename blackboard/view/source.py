"""The team that a command looks at: one on a tape, or one that runs. For doors, because it connects."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from cyclopts import Parameter

from blackboard.errors import RunFailed, UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run import door
from blackboard.run.flags import WhichTeam
from blackboard.state.moments import Moment, When
from blackboard.state.team import TeamFold
from blackboard.view.feed import Feed
from blackboard.view.taped import Taped
from blackboard.wire import keys

PATIENCE = 3.0  # seconds to wait for a router, and for a team to settle something


@Parameter(name="*")
@dataclass(frozen=True)
class TeamSource:
    """Which team is looked at."""

    file: Path | None = None
    "A tape (MCAP) to look at instead of a running team; of several runs on it, the last one. It says the team, too."
    which: WhichTeam = field(default=WhichTeam(), kw_only=True)

    def open(
        self, flags: door.ZenohFlags, name: str, patience: float = PATIENCE, stopped: Callable[[], bool] = lambda: False
    ) -> "Taped | Running":
        """The team, as a context manager: a tape, or one to which `name` connects within `patience` seconds when it is entered.

        UserError: no tape or an empty one, flags for a network beside a tape, no such scenario, or a team of no possible name.
        """
        if self.file is not None:
            if flags != door.ZenohFlags():
                raise UserError(f"{self.file}: a tape is looked at without a network; leave out where the network is")
            return open_tape(self.file, self.which.team)
        return Running(flags.link(), name, self.which, patience, stopped)


def teams_there(link: Link) -> list[str]:
    """The teams of which some process answers."""
    topics = (keys.parse(status.key) for status in link.get(keys.STATUS.key(team="*", sub_team="*", process="*")))
    return sorted({parsed[1]["team"] for parsed in topics if parsed is not None})


def others_there(link: Link, team: str = "") -> str:
    """`; there is demo`: the teams beside one of which some process answers; empty where there is none."""
    others = ", ".join(other for other in teams_there(link) if other != team)
    return f"; there is {others}" if others else ""


class Running:
    """A running team: its name, its boards' drift, and a feed that follows it while this context lasts."""

    feed: Feed

    def __init__(
        self, config: LinkConfig, name: str, which: WhichTeam, patience: float, stopped: Callable[[], bool]
    ) -> None:
        """Without a name in `which` it is the team that is there, or else the demo. UserError: as in `WhichTeam.chosen`."""
        chosen = which.chosen()
        self.team, self.drift, self._which = chosen.team.name, chosen.board.drift, which
        self._config, self._name, self._patience, self._stopped = config, name, patience, stopped

    def __enter__(self) -> "Running":
        """UserError: no name was given, and there are several teams."""
        self._link = Link(self._config, self._name, patience=self._patience, stopped=self._stopped)
        self._link.__enter__()
        if self._which.team is None and self._which.scenario is None and (there := teams_there(self._link)):
            if len(there) > 1:
                self._link.__exit__(None, None, None)
                raise UserError(f"{self._name}: there are the teams {', '.join(there)}; name one with --team")
            (self.team,) = there
        self.feed = Feed(self._link, UnixClock().now, self.team)
        self.feed.fold.expect(self.team, self._which.members)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._link.__exit__(kind, error, at)

    @property
    def fold(self) -> TeamFold:
        """The team as far as it was heard."""
        return self.feed.fold.team(self.team)

    def silence(self) -> str:
        """That nothing of the team was heard until now, and who else is there; empty where something was."""
        if any(process.alive or process.heard_at for process in self.fold.processes.values()):
            return ""
        return f"team {self.team} is not heard of yet{others_there(self._link, self.team)}"

    def read_on(self, each: Callable[[], None] = lambda: None) -> None:
        """Take in what arrives until it is stopped, and call `each` after every look."""
        while not self._stopped():
            self.feed.hear_envelopes(self.feed.receive())
            each()

    def moment(self, when: When | None, seconds: float) -> Moment:
        """The moment that is meant and is still to come, or the newest of which everything was seen, so not the first one.

        Of a team that stands still it is the one at which it stands. UserError: what is meant is over. RunFailed: nothing
        was settled within `seconds`.
        """
        first = self.fold.moments.newest
        if when is not None and first is not None and when.is_reached(first) and not when.fits(first):
            raise UserError(
                f"--at: {when} is over, the newest is {first.tick} ({first.time:.1f} s); ask for a later one"
            )

        def enough() -> bool:
            newest, last = self.fold.moments.newest, self.fold.moments.ticks[-2:]
            if newest is None or (first is not None and last[0] <= first.tick and newest.run == first.run):
                return False
            return when is None or when.is_reached(newest)

        self.feed.follow(seconds, enough)
        moments = self.fold.moments
        newest = moments.newest
        chosen = newest
        if when is not None:
            fitting = [moment for moment in moments if when.fits(moment)]
            chosen = fitting[-1] if fitting and newest is not None and when.is_reached(newest) else None
        if chosen is None:
            what = "has settled nothing" if when is None else f"did not settle {when}"
            raise RunFailed(f"team {self.team} {what} within {seconds:g} s{others_there(self._link, self.team)}")
        return chosen


def when(at: str) -> When:
    """The moment that a person names. UserError: it is neither a tick nor seconds."""
    try:
        return When.of(at)
    except ValueError:
        raise UserError(f"--at {at}: give a tick as 200, or seconds of team time as 40s") from None


def open_tape(file: Path, team: str | None) -> Taped:
    """A tape to look at. UserError: it is none, or empty."""
    from blackboard.tape.file import TapeAbout, look_through  # extra `record`

    about = TapeAbout()
    return Taped(file, look_through(file, about), lambda: about.metadata, team)
