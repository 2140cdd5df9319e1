"""The doors for people: `blackboard why | status | echo | hz | view | top`. They look on, and send nothing.

Long, because it is the door of six commands, each with its flags.
"""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from blackboard.config import load
from blackboard.errors import RunFailed, UserError, missing_extra
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.run import door
from blackboard.run.browser import open_page
from blackboard.run.flags import OutputFlags
from blackboard.run.terminal import beneath
from blackboard.state.fold import TeamFold
from blackboard.state.moments import Moment
from blackboard.view.echo import Rates, key_expression, line
from blackboard.view.feed import Feed
from blackboard.view.summary import summary, text
from blackboard.view.taped import Taped
from blackboard.view.why import explain
from blackboard.view.words import sentences

PATIENCE = 3.0  # seconds to wait for a router, and for a team to settle something
TEAM = "demo"  # the scenario where no other is named
NICE = 10  # lower priority of what looks on: where processors are short, boards and robots come first
CLEAR = "\x1b[H\x1b[2J"  # of a terminal

app = door.new_app("blackboard-view")
Seconds = Annotated[float, Parameter(name="--seconds")]


@app.command
def why(
    subject: str,
    file: Path | None = None,
    *,
    at: int | None = None,
    team: str | None = None,
    scenario: str | None = None,
    drift: float | None = None,
    seconds: Seconds = PATIENCE,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Say why a running team, or one on a tape, believes what it believes about a subject.

    Parameters
    ----------
    subject
        As robot/r1 or object/ball.
    file
        A tape (MCAP) to look at instead of a running team; of several runs on it, the last one.
    at
        The tick to explain: of a running team the newest, or one that is still to come [default: the newest].
    team
        Its team [default: the scenario's, or the one on the tape].
    scenario
        The team's scenario, a file or the name of one that comes with the package [default: demo].
    drift
        The boards' [board] drift, by which old reports spread [default: the scenario's, or the tape's].
    seconds
        How long to wait for the tick of a running team.
    """
    if file is not None:
        taped = open_tape(file, team, flags)
        moment = taped.moment(at)
        found = explain(taped.fold, moment, subject, taped.drift if drift is None else drift)
    else:
        chosen = load(scenario or TEAM)
        name = team or chosen.team.name
        door.check_name("--team", name)
        with Link(flags.link(), "why", patience=PATIENCE) as link:
            feed = Feed(link, UnixClock().now, name)
            moment = _wait_for(feed, name, at, seconds)
        found = explain(feed.fold.teams[name], moment, subject, chosen.board.drift if drift is None else drift)
    output.show(found, lambda it: "\n".join(sentences(it)))
    return door.DONE


def _wait_for(feed: Feed, name: str, tick: int | None, seconds: float) -> Moment:
    """A moment of which everything was seen, so not the first one; of a team that stands still, the one that it stands at."""
    first = _newest(feed, name)
    if tick is not None and first is not None and tick < first.tick:
        raise UserError(f"--at {tick}: that tick is over, the newest is {first.tick}; ask for a later one")

    def enough() -> bool:
        newest = _newest(feed, name)
        if newest is None or (first is not None and newest.tick <= first.tick + 1 and newest.run == first.run):
            return False
        return tick is None or newest.tick >= tick

    feed.follow(seconds, enough)
    team = feed.fold.teams.get(name) or TeamFold(name)
    found = team.moments.newest if tick is None else team.moments.at(tick)
    if found is None:
        what = "has settled nothing" if tick is None else f"did not settle tick {tick}"
        others = ", ".join(sorted(other for other in feed.fold.teams if other != name))
        raise RunFailed(f"team {name} {what} within {seconds:g} s" + (f"; there is {others}" if others else ""))
    return found


def _newest(feed: Feed, name: str) -> Moment | None:
    team = feed.fold.teams.get(name)
    return None if team is None else team.moments.newest


@app.command
def status(
    file: Path | None = None,
    *,
    team: str | None = None,
    watch: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    once: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    seconds: Seconds = 1.5,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Show teams, processes and beliefs: one look, or again and again; exit status 1 where no team is there.

    Parameters
    ----------
    file
        A tape (MCAP), to show how it ends, instead of running teams.
    team
        One team only [default: all].
    watch
        Look again and again, until it is interrupted; with --json one line each time.
    once
        Look once, which is what happens without --watch.
    seconds
        How long a look takes: rates are measured over that time.
    """
    if watch and once:
        raise UserError("--watch --once: give one of them")
    if file is not None:
        if watch:
            raise UserError("--watch: a tape does not change; leave it out")
        taped = open_tape(file, team, flags)
        taped.read_on()
        output.show(summary(taped.feed.fold, taped.feed.now), text)
        return door.DONE if taped.feed.fold.teams else door.FAILED
    if team is not None:
        door.check_name("--team", team)
    clock, stop = UnixClock(), door.Stop()
    with Link(flags.link(), "status", patience=PATIENCE) as link:
        feed = Feed(link, clock.now, team or "*")
        while not stop():
            feed.follow(seconds, stop)
            if watch and not output.as_json and sys.stdout.isatty():
                beneath(sys.stdout).write(CLEAR)
            output.show(summary(feed.fold, clock.now()), text)
            sys.stdout.flush()
            if not watch:
                break
    return door.DONE if feed.fold.teams else door.FAILED


@app.command
def echo(key: str, *, count: int | None = None, flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Print every message on a key expression, one line each, until it is interrupted.

    Parameters
    ----------
    key
        As cop/demo/a/agreed/object/ball, or with wildcards: cop/*/*/status/*.
    count
        How many messages [default: without end].
    """
    expression, stop, shown = key_expression(key), door.Stop(), 0
    with Link(flags.link(), "echo", patience=PATIENCE, stopped=stop) as link:
        link.watch(expression)
        link.subscribe(expression)
        while not stop():
            for envelope in link.receive(0.2):
                print(line(envelope))
                shown += 1
                if shown == count:
                    return door.DONE
            sys.stdout.flush()
    return door.DONE


@app.command
def hz(key: str = "cop/**", *, seconds: Seconds = 5.0, flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Count messages and bytes on each key of a key expression for a while, and print how often they came.

    Parameters
    ----------
    key
        As cop/demo/*/report/** [default: everything].
    seconds
        For how long.
    """
    if not seconds > 0:
        raise UserError(f"--seconds {seconds:g}: give a time above 0")
    expression, stop, rates, clock = key_expression(key), door.Stop(), Rates(), UnixClock()
    with Link(flags.link(), "hz", patience=PATIENCE, stopped=stop) as link:
        link.subscribe(expression)
        begin = clock.now()
        while not stop() and clock.now() < begin + seconds:
            for envelope in link.receive(0.1):
                rates.take(envelope)
    print(rates.text(clock.now() - begin))
    return door.DONE if rates.counts else door.FAILED


@app.command
def view(
    file: Path | None = None,
    *,
    team: str | None = None,
    scenario: str | None = None,
    port: int = 8642,
    host: str = "127.0.0.1",
    name: Annotated[list[str] | None, Parameter(negative="", show_default=False)] = None,
    open_it: Annotated[bool, Parameter(name="--open", negative="", show_default=False)] = False,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Serve a live page of a running team, or a page of a tape, until it is stopped (extra `web`).

    Parameters
    ----------
    file
        A tape (MCAP) to show instead of a running team; of several runs on it, the last one.
    team
        Its team [default: the scenario's, or the one on the tape].
    scenario
        The team's scenario, a file or the name of one that comes with the package [default: demo].
    port
        Where the page is served; 0 takes a free one.
    host
        The address to listen on. Others than 127.0.0.1 show the page to everybody who reaches it.
    name
        A name by which browsers may call the page; may be given again [default: any, and on 127.0.0.1 that and localhost].
    open_it
        Also open it in the browser, where there is one.
    """
    ready = _ready_and_open if open_it else _ready
    if not 0 <= port < 65536:
        raise UserError(f"--port {port}: give 0 to 65535")
    try:
        from blackboard.view.web.server import Address, serve
    except ImportError:
        raise missing_extra("the live page", "web") from None
    clock = UnixClock()
    if file is not None:
        taped = open_tape(file, team, flags)
        stop = door.Stop()
        serve(taped.feed, taped.team, clock.now, Address(host, port, name), stop, ready, taped.drift)
        return door.DONE
    chosen = load(scenario or TEAM)
    of = team or chosen.team.name
    door.check_name("--team", of)
    os.nice(NICE)
    stop = door.Stop()
    with Link(flags.link(), "view", patience=30.0, stopped=stop) as link:
        feed = Feed(link, clock.now, of)
        serve(feed, of, clock.now, Address(host, port, name), stop, ready, chosen.board.drift)
    return door.DONE


@app.command
def top(
    file: Path | None = None,
    *,
    team: str | None = None,
    scenario: str | None = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Show a running team, or how one on a tape ends, in this terminal until q is pressed (extra `tui`).

    Parameters
    ----------
    file
        A tape (MCAP) to show instead of a running team.
    team
        Its team [default: the scenario's, or the one on the tape].
    scenario
        The team's scenario, a file or the name of one that comes with the package [default: demo].
    """
    try:
        from blackboard.view.tui.top import Top
    except ImportError:
        raise missing_extra("the terminal", "tui") from None
    if file is not None:
        taped = open_tape(file, team, flags)
        Top(taped.feed, taped.team, taped.drift).run()
        return door.DONE
    chosen = load(scenario or TEAM)
    of = team or chosen.team.name
    door.check_name("--team", of)
    os.nice(NICE)
    with Link(flags.link(), "top", patience=PATIENCE) as link:
        feed = Feed(link, UnixClock().now, of)
        logging.disable()  # the terminal is drawn on standard error, where logs go
        Top(feed, of, chosen.board.drift).run()
    return door.DONE


def open_tape(file: Path, team: str | None, flags: door.ZenohFlags) -> Taped:
    """A tape to look at. UserError: it is none, is empty, or the flags are for a network."""
    if flags != door.ZenohFlags():
        raise UserError(f"{file}: a tape is looked at without a network; leave out where the network is")
    from blackboard.tape.file import About, look_through  # extra `record`

    about = About()
    return Taped(file, look_through(file, about), lambda: about.metadata, team)


def _ready(url: str) -> None:
    door.say("live page", url=url)


def _ready_and_open(url: str) -> None:
    _ready(url)
    open_page(url)


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
