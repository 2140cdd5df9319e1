"""Whether a process does its work: what the health check of a container asks of the process itself, over Zenoh.

A process may exist and do nothing. So a robot is healthy while its belief about its own place is fresh, a board while what it
settled last is, a world while it answers with its Clock, a router while a session opens through it. The status of a board carries
the time of the tick that was settled, so that a board which repeats its status and settles nothing is not healthy.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Literal, Protocol

from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock, Report, Status
from blackboard.wire.types import Message

ProcessKind = Literal["router", "world", "board", "robot"]


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
        return f"{kind} {name} does not answer on {key}"
    age = max(clock, default=now) - max(said)
    if abs(age) <= max_age:
        return None
    what = f"what board {name} settled last" if kind == "board" else f"the belief of robot {name}"
    return f"{what} is {age:.1f} s old"


def part(link: Querier, kind: ProcessKind, name: str, *, team: str) -> str:
    """What is told of a process after "healthy": of a world its tick; of a board that it follows another one of its sub-team."""
    if kind == "world":
        clocks = _opened(link, keys.CLOCK.key(team=team))
        return f", tick {max(clock.tick for clock in clocks if isinstance(clock, Clock))}" if clocks else ""
    if kind != "board":
        return ""
    messages = _opened(link, keys.STATUS.key(team=team, sub_team="*", process=name))
    return ", follows" if any(isinstance(message, Status) and message.follows for message in messages) else ""


def _times(link: Querier, key_expr: str) -> list[float]:
    """The stamps of all readable answers, team time in seconds."""
    return [message.time for message in _opened(link, key_expr) if isinstance(message, Clock | Report | Status)]


def _opened(link: Querier, key_expr: str) -> list[Message]:
    found = []
    for envelope in link.get(key_expr):
        with suppress(Refused):  # another process sent it; the one that is asked about may be well
            found.append(open_envelope(envelope)[2])
    return found
