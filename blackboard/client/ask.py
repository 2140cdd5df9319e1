"""Which team is meant, and on which grid, as the boards that answer say in their statuses."""

import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from blackboard.errors import Refused, UserError
from blackboard.opinion.grid import Anchor, Grid
from blackboard.wire import keys
from blackboard.wire.arrays import unpacked_grid
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Status

PAUSE = 0.1  # seconds between two questions

#: What a robot must know of a board's settings, and what it takes where the board does not say so.
SETTINGS = {"feedback": "guarded", "fusion": "opinions"}

Get = Callable[[str], Iterable[Envelope]]  # the newest on a key expression, of each who answers: `Link.get`


@dataclass(frozen=True)
class Found:
    team: str
    sub_team: str
    grid: Grid
    feedback: str = SETTINGS["feedback"]  # `[board] feedback`
    fusion: str = SETTINGS["fusion"]  # `[board] fusion`


def ask(
    get: Get,
    now: Callable[[], float],
    who: str,
    team: str | None,
    sub_teams: Sequence[str],
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
    cure: str = "say team=... and sub_team=...",
) -> Found:
    """The team, sub-team and grid of a board that answers within `patience` seconds; `team` and `sub_teams` where they are known.

    UserError: no board answers, or boards of several sub-teams do and none was named. Its sentence begins with `who` and ends
    with `cure`.
    """
    end, pause = now() + patience, threading.Event()
    known = dict[tuple[str, str], Found]()
    while not known:
        for sub_team in sub_teams or ("*",):
            known |= _boards(get, keys.STATUS.key(team=team or "*", sub_team=sub_team, process="*"))
        if not known and (now() >= end or stopped()):
            others = [
                f"{board[0]}/{board[1]}"
                for board in sorted(_boards(get, keys.STATUS.key(team="*", sub_team="*", process="*")))
            ]
            there = (
                f"there are boards of {', '.join(others)}" if others else "start `blackboard serve`, or name a scenario"
            )
            raise UserError(f"{who}: no board {_of(team, sub_teams)}answers; {there}")
        pause.wait(0.0 if known else PAUSE)
    if not sub_teams and len(known) > 1:
        names = ", ".join(f"{team}/{sub_team}" for team, sub_team in sorted(known))
        raise UserError(f"{who}: there are {names}; {cure}")
    return known[min(known)]


def _of(team: str | None, sub_teams: Sequence[str]) -> str:
    named = [f"{team or '*'}/{sub_team}" for sub_team in sub_teams] or ([team] if team else [])
    return f"of {', '.join(named)} " if named else ""


def _boards(get: Get, key_expr: str) -> dict[tuple[str, str], Found]:
    """What boards tell in their statuses, by team and sub-team."""
    boards = {}
    for envelope in get(key_expr):
        try:
            _, parts, message = open_envelope(envelope)
            if isinstance(message, Status) and message.kind == "board" and message.grid is not None:
                at, (team, sub_team) = message.anchor, (parts["team"], parts["sub_team"])
                anchor = None if at is None else Anchor(at.latitude, at.longitude, at.bearing)
                grid = replace(unpacked_grid(message.grid), anchor=anchor)
                told = (str(message.settings.get(key, default)) for key, default in SETTINGS.items())
                boards[team, sub_team] = Found(team, sub_team, grid, *told)
        except Refused:
            continue
    return boards
