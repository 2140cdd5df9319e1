"""The doors for people: `blackboard why | status | echo | hz | view | top`. They look on, and send nothing."""

import logging
import math
import os
import shutil
import sys
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from blackboard.errors import UserError, extra
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.run import door
from blackboard.run.browser import open_page
from blackboard.run.flags import OutputFlags, WhichTeam
from blackboard.run.terminal import beneath
from blackboard.view.echo import Rates, key_expression, line
from blackboard.view.feed import Feed
from blackboard.view.source import PATIENCE, TeamSource, others_there, teams_there, when
from blackboard.view.summary import summary, text
from blackboard.view.why import explain
from blackboard.view.words import sentences

log = logging.getLogger(__name__)

NICE = 10  # lower priority of what looks on: where processors are short, boards and robots come first
CLEAR = "\x1b[H\x1b[2J"  # of a terminal

app = door.new_app("blackboard-view")
Seconds = Annotated[float, Parameter(name="--seconds")]


@app.command
def why(
    subject: str,
    source: TeamSource = TeamSource(),
    *,
    at: str | None = None,
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
    at
        The tick to explain, as 200, or team time, as 40s; of a running team one to come [default: the newest].
    drift
        The boards' [board] drift, by which old reports spread [default: the scenario's, or the tape's].
    seconds
        How long to wait for the tick of a running team.
    """
    wanted = None if at is None else when(at)
    if source.file is None and subject.endswith(".mcap"):
        raise UserError(f"{subject} is a tape; say of whom, too: blackboard why robot/r1 {subject}")
    with source.open(flags, "why") as looked:
        moment = looked.moment(wanted, seconds)
        explained = explain(looked.fold, moment, subject, looked.drift if drift is None else drift)
    output.show(explained, lambda told: "\n".join(sentences(told)))
    return door.DONE


@app.command
def status(
    file: Path | None = None,
    *,
    team: str | None = None,
    scenario: str | None = None,
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
        One team only [default: all, or that of the scenario].
    scenario
        The team's scenario: its robots are shown even if they never came.
    watch
        Look again and again, until it is interrupted; with --json one line each time.
    once
        Look once, which is what happens without --watch.
    seconds
        How long a look takes: rates are measured over that time.
    """
    if watch and once:
        raise UserError("--watch --once: give one of them")
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    which = WhichTeam(team=team, scenario=scenario)
    if file is not None:
        if watch:
            raise UserError("--watch: a tape does not change; leave it out")
        taped = TeamSource(file, which=which).open(flags, "status")
        taped.read_on()
        output.show(summary(taped.feed.fold, taped.feed.now), partial(text, width=width))
        return door.DONE if taped.feed.fold.teams else door.FAILED
    if team is not None or scenario is not None:
        team = which.chosen().team.name
    clock, stop = UnixClock(), door.Stop()
    with Link(flags.link(), "status", patience=PATIENCE) as link:
        feed = Feed(link, clock.now, team or "*")
        while not stop():
            feed.follow(seconds, stop)
            if team in feed.fold.teams:
                feed.fold.expect(team, which.members)
            if watch and not output.as_json and sys.stdout.isatty():
                beneath(sys.stdout).write(CLEAR)
            there = [] if feed.fold.teams else teams_there(link)
            output.show(summary(feed.fold, clock.now()), partial(text, width=width, there=there))
            sys.stdout.flush()
            if not watch:
                break
    return door.DONE if feed.fold.teams else door.FAILED


@app.command
def echo(
    key: str,
    *,
    count: int | None = None,
    short: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Print every message on a key expression, one line each, until it is interrupted.

    Parameters
    ----------
    key
        As cop/demo/a/agreed/object/ball, or with wildcards: cop/*/*/status/*.
    count
        How many messages [default: without end].
    short
        Of each message only its numbers, in one line that fits a screen.
    """
    expression, stop, shown, clock = key_expression(key), door.Stop(), 0, UnixClock()
    with Link(flags.link(), "echo", patience=PATIENCE, stopped=stop) as link:
        link.watch(expression)
        link.subscribe(expression)
        missed_at = clock.now() + PATIENCE
        while not stop():
            if not shown and clock.now() > missed_at:
                log.warning("nothing has come on %s yet%s", expression, others_there(link))
                missed_at = math.inf
            for envelope in link.receive(0.2):
                print(line(envelope, short=short))
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
        As cop/demo/*/report/**.
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
                rates.count(envelope)
    print(rates.text(clock.now() - begin))
    return door.DONE if rates.counts else door.FAILED


@app.command
def view(
    source: TeamSource = TeamSource(),
    *,
    port: int = 8642,
    host: str = "127.0.0.1",
    name: Annotated[list[str] | None, Parameter(negative="", show_default=False)] = None,
    open_it: Annotated[bool, Parameter(name="--open", negative="", show_default=False)] = False,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Serve a live page of a running team, or a page of a tape, until it is stopped (extra `web`).

    Parameters
    ----------
    port
        Where the page is served; 0 takes a free one.
    host
        The address to listen on. Others than 127.0.0.1 show the page to everybody who reaches it.
    name
        A name by which browsers may call the page; may be given again [default: any, and on 127.0.0.1 that and localhost].
    open_it
        Also open it in the browser, where there is one.
    """
    if not 0 <= port < 65536:
        raise UserError(f"--port {port}: give 0 to 65535")
    with extra("web", "the live page"):
        from blackboard.view.web.server import Address, serve
    stop = door.Stop()
    with _in_the_background(source).open(flags, "view", door.PATIENCE, stop) as looked:
        if silence := looked.silence():
            log.warning(silence)
        ready = partial(announce, opened=open_it)
        serve(looked.feed, looked.team, UnixClock().now, Address(host, port, name), stop, ready, looked.drift)
    return door.DONE


@app.command
def top(source: TeamSource = TeamSource(), *, flags: door.ZenohFlags = door.ZenohFlags()) -> int:
    """Show a running team, or how one on a tape ends, in this terminal until q is pressed (extra `tui`)."""
    with extra("tui", "the terminal"):
        from blackboard.view.tui.top import Top
    with _in_the_background(source).open(flags, "top") as looked:
        logging.disable()  # the terminal is drawn on standard error, where logs go
        Top(looked.feed, looked.team, looked.drift).run()
    return door.DONE


def _in_the_background(source: TeamSource) -> TeamSource:
    """A source as it is; where its team runs, this process yields the processor to it."""
    if source.file is None:
        os.nice(NICE)
    return source


def announce(url: str, *, opened: bool) -> None:
    """Log where the page is served, and open it in the browser where that is asked for."""
    door.say("live page", url=url)
    if opened:
        open_page(url)


def main() -> None:
    door.main(app)


if __name__ == "__main__":
    main()
