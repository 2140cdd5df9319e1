"""Whether a process does its work: what the health check of a container asks of the process itself, over Zenoh.

That a process exists says little. A robot is healthy while its belief about its own place is fresh, a board while its
status is, a world while it tells the time, a router while a session opens through it.
"""

from __future__ import annotations

from typing import Literal, Protocol

from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock, Report, Status

Kind = Literal["router", "world", "board", "robot"]


class Network(Protocol):
    """What is needed of `blackboard.link.Link`."""

    def get(self, key_expr: str) -> list[Envelope]: ...


def ailment(network: Network, kind: Kind, name: str, now: float, *, team: str, max_age: float) -> str | None:
    """What is wrong with a process, in one line, or None.

    Ages are of team time, in seconds: by the world's clock where one answers, by `now` (Unix time) where none does.
    """
    if kind == "router":
        return None  # whoever asks has come through it
    clock = _times(network, keys.CLOCK.key(team=team))
    if kind == "world":
        return None if clock else f"no world tells the time of team {team}"
    if kind == "board":
        what, key = "status", keys.STATUS.key(team=team, sub_team="*", process=name)
    else:
        what, key = "belief", keys.REPORT.key(team=team, sub_team="*", source=name, subject=f"robot/{name}")
    said = _times(network, key)
    if not said:
        return f"{kind} {name} does not answer on {key}"
    age = max(clock, default=now) - max(said)
    return f"the {what} of {kind} {name} is {age:.1f} s old" if abs(age) > max_age else None


def _times(network: Network, key_expr: str) -> list[float]:
    """The stamps of all readable answers, team time in seconds."""
    found = []
    for envelope in network.get(key_expr):
        try:
            _, _, message = open_envelope(envelope)
        except Refused:  # whoever sent it is not well; whoever is asked about may be
            continue
        if isinstance(message, Clock | Report | Status):
            found.append(message.time)
    return found
