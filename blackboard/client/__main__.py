"""The door of `blackboard share`: a process that joins two teams."""

import re
from collections.abc import Sequence
from functools import partial
from typing import Annotated

from cyclopts import Parameter

from blackboard.client.ask import Found, ask
from blackboard.client.share import OBJECTS, Share
from blackboard.config import BoardSection, Scenario, load
from blackboard.errors import UserError
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.process.loop import run
from blackboard.run import door
from blackboard.wire.names import LONGEST_NAME, NAME, OF_TEAM, VIA


def share(
    source: str,
    team: str,
    *,
    sub_team: str | None = None,
    subject: Annotated[list[str] | None, Parameter(negative="", show_default=False)] = None,
    every: float = 1.0,
    scenario: str | None = None,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Tell a team what another one agrees on, until it is stopped; two of these share both ways.

    It takes part as one more robot, named from.SOURCE, and robots of the other team as SOURCE..r1. Nothing is counted twice.

    Parameters
    ----------
    source
        The team that is heard.
    team
        The team that is told. Both have the same grid.
    sub_team
        Its sub-team that is told [default: its only one].
    subject
        What is shared, as object/ball, 'object/*' or 'robot/*'; may be given again [default: 'object/*'].
    every
        Seconds between two reports on a subject, at least.
    scenario
        The scenario of the team that is told, a file or a name that comes with the package [default: its board says the grid].
    """
    subjects, chosen = tuple(subject or OBJECTS), None if scenario is None else load(scenario)
    settings = BoardSection() if chosen is None else chosen.board
    _check(source, team, sub_team, subjects, every, settings.max_age, flags)
    stop, clock = door.Stop(), UnixClock()
    with Link(flags.link(), VIA + source, patience=door.PATIENCE, stopped=stop, clock=clock) as link:
        told = _destination(link, clock, team, sub_team, chosen, stop)
        if told.feedback != "guarded":
            raise UserError(
                f"{team}: its boards have feedback = {told.feedback!r}, by which what is shared would be "
                + ("counted twice" if told.feedback == "paper" else "left out")
                + '; set [board] feedback = "guarded"'
            )
        service = Share(
            source, team, sub_team=told.sub_team, grid=told.grid, settings=settings, subjects=subjects, every=every
        )
        ready = partial(
            door.say, "ready", process=VIA + source, team=team, sub_team=told.sub_team, subjects=", ".join(subjects)
        )
        run(service, link, clock, stop, ready)
    return door.DONE


def _destination(
    link: Link, clock: UnixClock, team: str, sub_team: str | None, scenario: Scenario | None, stop: door.Stop
) -> Found:
    """Where the reports go. UserError: no board says it and no scenario either, or it could be several sub-teams."""
    if scenario is None:
        named = () if sub_team is None else (sub_team,)
        return ask(link.get, clock.now, team, team, named, door.PATIENCE, stop, cure="say --sub-team")
    sub_teams = sorted(scenario.team.sub_teams)
    if sub_team is None and len(sub_teams) > 1:
        raise UserError(f"{team}: there are {', '.join(sub_teams)}; say --sub-team")
    return Found(team, sub_team or sub_teams[0], scenario.grid, scenario.board.feedback)


def _check(
    source: str,
    team: str,
    sub_team: str | None,
    subjects: Sequence[str],
    every: float,
    max_age: float,
    flags: door.ZenohFlags,
) -> None:
    """Look through the flags before anything is connected. UserError: one that cannot be."""
    if flags.keys is not None:
        raise UserError("--keys: a certificate is for one team, so two teams with keys cannot be joined")
    _check_names(source, team, sub_team)
    for one in subjects:
        if not re.fullmatch(rf"(?:object|robot)/(?:\*|{NAME})", one):
            raise UserError(f"--subject {one}: write object/NAME, 'object/*', robot/NAME or 'robot/*'")
    if not 0.0 < every < max_age:
        raise UserError(f"--every {every:g}: give seconds above 0 and below [board] max_age, which is {max_age:g}")


def _check_names(source: str, team: str, sub_team: str | None) -> None:
    for what, name in (("SOURCE", source), ("TEAM", team), ("--sub-team", sub_team)):
        if name is not None:
            door.check_name(what, name)
    if source == team:
        raise UserError(f"{source} {team}: give two teams")
    for name in (source, team):
        if OF_TEAM in name:
            raise UserError(
                f"{name}: {OF_TEAM} stands between a team and its robots; give teams without it in their names"
            )
    if len(VIA + source) > LONGEST_NAME:
        raise UserError(f"SOURCE {source}: at most {LONGEST_NAME - len(VIA)} letters, because {VIA}{source} reports")
