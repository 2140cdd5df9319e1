"""The doors for people: `blackboard why | status | echo | hz | view`. They look on, and send nothing."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import App, Parameter

from blackboard.errors import RunFailed, UserError
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.run import door
from blackboard.run.flags import OutputFlags
from blackboard.view.echo import Rates, key_expression, line
from blackboard.view.feed import Feed
from blackboard.view.fold import TeamFold
from blackboard.view.moments import Moment
from blackboard.view.summary import summary, text
from blackboard.view.why import explain
from blackboard.view.words import sentences

PATIENCE = 3.0  # seconds to wait for a router, and for a team to settle something
CLEAR = "\x1b[H\x1b[2J"  # of a terminal
NO_WEB = "the live page needs the extra `web`: pip install 'cop-blackboard[web]'"

app = App(name="blackboard-view", version=door.version)
Seconds = Annotated[float, Parameter(name="--seconds")]


@app.command
def why(
    subject: str,
    *,
    at: int | None = None,
    team: str = "demo",
    drift: float = 1.0,
    seconds: Seconds = PATIENCE,
    output: OutputFlags = OutputFlags(),
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Say why a running team believes what it believes about a subject.

    Parameters
    ----------
    subject
        As robot/r1 or object/ball.
    at
        The tick to explain: the newest, or one that is still to come [default: the newest].
    team
        Its team.
    drift
        The boards' [board] drift, by which old reports spread.
    seconds
        How long to wait for the tick.
    """
    door.check_name("--team", team)
    with Link(flags.link(), "why", patience=PATIENCE) as link:
        feed = Feed(link, UnixClock().now, team)
        moment = _wait_for(feed, team, at, seconds)
    found = explain(feed.fold.teams[team], moment, subject, drift)
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
    if team is not None:
        door.check_name("--team", team)
    clock, stop = UnixClock(), door.Stop()
    with Link(flags.link(), "status", patience=PATIENCE) as link:
        feed = Feed(link, clock.now, team or "*")
        while not stop():
            feed.follow(seconds, stop)
            if watch and not output.as_json and sys.stdout.isatty():
                sys.stdout.write(CLEAR)
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
    *,
    team: str = "demo",
    port: int = 8642,
    host: str = "127.0.0.1",
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Serve a live page of a running team until it is stopped (extra `web`).

    Parameters
    ----------
    team
        Its team.
    port
        Where the page is served; 0 takes a free one.
    host
        The address to listen on. Others than 127.0.0.1 show the page to everybody who reaches it.
    """
    door.check_name("--team", team)
    if not 0 <= port < 65536:
        raise UserError(f"--port {port}: give 0 to 65535")
    try:
        from blackboard.view.web.server import serve
    except ImportError:
        raise UserError(NO_WEB) from None
    stop, clock = door.Stop(), UnixClock()
    with Link(flags.link(), "view", patience=30.0, stopped=stop) as link:
        feed = Feed(link, clock.now, team)
        serve(feed, team, clock.now, host, port, stop, _ready)
    return door.DONE


def _ready(url: str) -> None:
    door.log.info("live page", url=url)


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
