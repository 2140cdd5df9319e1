"""Whether a process does its work: what the health check of a container asks of the process itself, over Zenoh.

A process may exist and do nothing. A robot is healthy while its belief about its own place is fresh, and a board while what it
settled last is. A world must answer with its Clock, and a session must open through a router. The status of a board carries the
time of the tick that was settled, so that a board which repeats its status and settles nothing is not healthy.
"""

import math
import socket
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Annotated, Any, Literal, Protocol

from cyclopts import Parameter

from blackboard.errors import Refused
from blackboard.net.link import Link
from blackboard.process.clock import UnixClock
from blackboard.process.printable import printable
from blackboard.run import door
from blackboard.tables import read_tables
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from blackboard.wire.raw import unpack_map

ProcessKind = Literal["router", "world", "board", "robot"]
DEFAULT_TEAM = "demo"  # as in `blackboard.config.TeamSection`
MOST_NAMES = 20  # in one line
AGES = 1e8  # seconds: three years; a stamp that is older than that is no Unix time


class Querier(Protocol):
    """What is needed of `blackboard.net.link.Link`."""

    def get(self, key_expr: str) -> list[Envelope]: ...


def diagnose(link: Querier, kind: ProcessKind, name: str, now: float, *, team: str, max_age: float) -> str | None:
    """What is wrong with a process, in one line, or None.

    Ages are of team time, in seconds: by the world's clock where one answers, by `now` (Unix time) where none does.
    """
    if kind == "router":
        return None  # the session that asks was opened through it
    clock = _times(link, keys.CLOCK.key(team=team))
    if kind == "world":
        return None if clock else f"no world of team {team} answers with its Clock"
    if kind == "board":
        key = keys.STATUS.key(team=team, sub_team="*", process=name)
    else:
        key = keys.REPORT.key(team=team, sub_team="*", source=name, subject=f"robot/{name}")
    said = _times(link, key)
    if not said:
        return f"{kind} {name} does not answer on {key}{_there(link, kind, team)}"
    age = max(clock, default=now) - max(said)
    if abs(age) <= max_age:
        return None
    what = f"what board {name} settled last" if kind == "board" else f"the belief of robot {name}"
    if not clock and age > AGES:
        return f"{what} is stamped {max(said):.1f} s by the clock of a world that does not answer any more"
    return f"{what} is {age:.1f} s old"


def _there(link: Querier, kind: ProcessKind, team: str) -> str:
    """The processes of this kind that answer, for a message about one that does not."""
    names = sorted({name for name, _ in _statuses(link, keys.STATUS.key(team=team, sub_team="*", process="*"), kind)})
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"; there is {', '.join(names[:MOST_NAMES])}{more}" if names else f"; no {kind} of team {team} answers"


def board_named(link: Querier, name: str, *, team: str) -> str:
    """The board that is meant: the one of this name, or where none answers, that of the sub-team of this name; the one that leads."""
    if _boards(link, keys.STATUS.key(team=team, sub_team="*", process=name)):
        return name
    return min(_boards(link, keys.STATUS.key(team=team, sub_team=name, process="*")), default=(False, name))[1]


def part(link: Querier, kind: ProcessKind, name: str, *, team: str) -> str:
    """What is printed of a process after "healthy": of a world its tick; of a board that it follows another one of its sub-team.

    Of a robot and a board also that several processes answer under its name.
    """
    if kind == "world":
        ticks = [fields.get("tick") for fields in _answers(link, keys.CLOCK.key(team=team))]
        known = [tick for tick in ticks if isinstance(tick, int)]
        return f", tick {max(known)}" if known else ""
    if kind == "router":
        return ""
    envelopes = link.get(keys.STATUS.key(team=team, sub_team="*", process=name))
    follows = kind == "board" and any(fields.get("follows") for fields in _read(envelopes))
    # one process gives one answer on each of its keys; who merely keeps what it sent (a storage) gives the same bytes
    several = max(Counter(key for key, _ in {(one.key, one.payload) for one in envelopes}).values(), default=0)
    return ", follows" * follows + f", but {several} processes answer as {kind} {name}" * (several > 1)


def health(
    kind: ProcessKind,
    *,
    process: Annotated[str | None, Parameter(name="--id")] = None,
    team: str | None = None,
    scenario: str | None = None,
    max_age: float = 5.0,
    flags: door.ZenohFlags = door.ZenohFlags(),
) -> int:
    """Ask a process over Zenoh whether it does its work; exit status 1 and one line where it does not.

    Parameters
    ----------
    kind
        What the process is.
    process
        Its name; of a board also its sub-team's [default: the name of this host].
    team
        Its team [default: the scenario's].
    scenario
        The team's scenario, a file or the name of one that comes with the package [default: demo].
    max_age
        Seconds of team time after which a belief or a status is no longer fresh.
    """
    name, of = process or socket.gethostname(), team or _team_of(scenario or "demo")
    door.check_name("--team", of)
    # with keys it is asked as the process itself, so that it is also found out whether the router lets this certificate in
    who = {"router": "health", "world": "world"}.get(kind, f"{kind}/{name}")
    with Link(flags.link(who=who), f"health-{name}", patience=3.0) as link:
        meant = board_named(link, name, team=of) if kind == "board" else name
        fault = link.denials() or diagnose(link, kind, meant, UnixClock().now(), team=of, max_age=max_age)
        answer = fault or "healthy" + f", {meant}" * (meant != name) + part(link, kind, meant, team=of)
    sys.stdout.write(f"{printable(answer)}\n")
    return 1 if fault else 0


def _times(link: Querier, key_expr: str) -> list[float]:
    """The stamps of all readable answers, team time in seconds."""
    times = (fields.get("time") for fields in _answers(link, key_expr))
    return [float(time) for time in times if isinstance(time, int | float) and math.isfinite(time)]


def _answers(link: Querier, key_expr: str) -> list[dict[str, Any]]:
    """The fields of all readable answers on keys of the team."""
    return _read(link.get(key_expr))


def _boards(link: Querier, key_expr: str) -> list[tuple[bool, str]]:
    """Of the boards whose statuses answer: whether each follows, and its name."""
    return [(bool(fields.get("follows")), name) for name, fields in _statuses(link, key_expr, "board")]


def _statuses(link: Querier, key_expr: str, kind: ProcessKind) -> Iterator[tuple[str, dict[str, Any]]]:
    """The processes of a kind whose statuses answer, and the fields of these."""
    for envelope in link.get(key_expr):
        for fields in _read([envelope]):
            if fields.get("kind") == kind and (parts := keys.STATUS.match(envelope.key)) is not None:
                yield parts["process"], fields


def _read(envelopes: Iterable[Envelope]) -> list[dict[str, Any]]:
    fields = []
    for envelope in envelopes:
        with suppress(Refused):  # another process sent it; the one that is asked about may be well
            fields.append(unpack_map(envelope.payload))
    return fields


def _team_of(scenario: str) -> str:
    """The name of a scenario's team. The rest of the file is not looked at: the processes that read it have said what is wrong."""
    tables, _ = read_tables(scenario)
    team = tables.get("team")
    return str(team.get("name", DEFAULT_TEAM)) if isinstance(team, dict) else DEFAULT_TEAM
