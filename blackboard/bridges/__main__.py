"""The doors of the bridges: `blackboard-rerun`, and `blackboard tape export`. They look on, and send nothing."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from blackboard.bridges.stream import Stream
from blackboard.errors import UserError
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.run import door
from blackboard.view.feed import Feed
from blackboard.view.taped import Taped

app = App(
    name="blackboard-rerun", help="Show a team that runs, or one on a tape, in the Rerun viewer.", version=door.version
)


@app.default
def rerun(
    file: Path | None = None,
    *,
    team: str | None = None,
    save: Path | None = None,
    viewer: Annotated[str | None, Parameter(name="--viewer")] = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Show a team that runs until a signal comes, or one on a tape, in the Rerun viewer (extra `rerun`).

    Parameters
    ----------
    file
        A tape (MCAP) to show instead of a running team.
    team
        Its team [default: demo, or the one on the tape].
    save
        Write a recording (.rrd) instead of opening a viewer.
    viewer
        A viewer that runs, as rerun+http://127.0.0.1:9876/proxy [default: one that is started here].
    """
    from blackboard.bridges.rerun import open_viewer

    if save is not None and viewer is not None:
        raise UserError("--save --viewer: give one of them")
    if file is not None:
        taped = open_tape(file, team)
        sink, stream = open_viewer(taped.team, save, viewer), Stream(taped.feed, taped.team)
        moments = 0

        def look() -> None:
            nonlocal moments
            moments += stream.new(sink)

        taped.read_on(look)
        sink.close()
        sys.stderr.write(f"{file}: {moments} ticks shown\n")
        return door.DONE
    name = team or "demo"
    door.check_name("--team", name)
    sink, stop = open_viewer(name, save, viewer), door.Stop()
    with Link(flags.link(), "rerun", patience=30.0, stopped=stop) as link:
        feed = Feed(link, UnixClock().now, name)
        stream = Stream(feed, name)
        while not stop():
            feed.take(feed.receive())
            stream.new(sink)
    sink.close()
    return door.DONE


def export(file: Path, out: Path, *, to: Literal["foxglove"] = "foxglove", team: str | None = None) -> int:
    """Write a tape for other people's viewers: an MCAP file with the schemas that Foxglove shows (extra `foxglove`).

    Parameters
    ----------
    out
        The new file.
    to
        For which viewer.
    team
        Its team [default: the one on the tape].
    """
    from blackboard.bridges.foxglove import export as write

    count = write(open_tape(file, team), out)
    sys.stderr.write(f"{out}: {count} messages for {to}\n")
    return door.DONE


def open_tape(file: Path, team: str | None) -> Taped:
    """A tape to look at. UserError: it is none, or empty."""
    from blackboard.tape.file import About, look_through  # extra `record`

    about = About()
    return Taped(file, look_through(file, about), lambda: about.metadata, team)


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
