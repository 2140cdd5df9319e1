"""The rows of the table of network trouble. Pure."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from blackboard.chaos.trouble import Trouble
from blackboard.config import Scenario
from blackboard.errors import UserError

T = TypeVar("T")
Who = Literal["nobody", "robots", "robot", "board", "sub-team", "router", "sites"]


@dataclass(frozen=True)
class TroubleCase:
    """A row: who is troubled (`members`), how, and for how many seconds. One of `trouble`, `cut`, `signal` and `lose` at most."""

    name: str
    what: str
    who: Who = "nobody"
    seconds: float = 0.0
    trouble: Trouble | None = None  # of the lines in both directions
    cut: bool = False
    # SIGSTOP is taken back with SIGCONT at the end; what is killed is started again at once.
    signal: signal.Signals | None = None
    lose: float = 0.0  # share of reports that never arrive (`[[fault]] kind = "lose"`)


CASES = {
    case.name: case
    for case in (
        TroubleCase("calm", "nothing", seconds=10),
        TroubleCase("loss-5", "5 % of segments lost, robots", "robots", 10, Trouble(loss=0.05)),
        TroubleCase("loss-20", "20 % of segments lost, robots", "robots", 10, Trouble(loss=0.2)),
        TroubleCase("delay-100", "100 +- 20 ms each way, robots", "robots", 10, Trouble(0.1, 0.02)),
        TroubleCase("delay-500", "500 +- 100 ms each way, robots", "robots", 10, Trouble(0.5, 0.1)),
        TroubleCase("reports-20", "20 % of reports lost, robots", "robots", 10, lose=0.2),
        TroubleCase("cut-robot", "3 s cut, a robot", "robot", 3, cut=True),
        TroubleCase("cut-sub-team", "3 s cut, a sub-team with its board", "sub-team", 3, cut=True),
        TroubleCase("sites", "6 s partition of two sites", "sites", 6, cut=True),
        TroubleCase("freeze-robot", "frozen 5 s, a robot", "robot", 5, signal=signal.SIGSTOP),
        TroubleCase("freeze-board", "frozen 5 s, a board", "board", 5, signal=signal.SIGSTOP),
        TroubleCase("freeze-router", "frozen 5 s, the router", "router", 5, signal=signal.SIGSTOP),
        TroubleCase("kill-robot", "killed and started again, a robot", "robot", signal=signal.SIGKILL),
        TroubleCase("kill-board", "killed and started again, a board", "board", signal=signal.SIGKILL),
        TroubleCase("kill-router", "killed and started again, the router", "router", signal=signal.SIGKILL),
    )
}


def chosen(only: str | None, known: Mapping[str, T], what: str) -> list[T]:
    """What a list of names with commas names, or all that is known. UserError: there is no such `what`."""
    names = list(known) if only is None else [name.strip() for name in only.split(",")]
    for name in names:
        if name not in known:
            raise UserError(f"--only {name}: no such {what}; choose from {', '.join(known)}")
    return [known[name] for name in names]


def members(who: Who, scenario: Scenario) -> list[str]:
    """The names of those who are troubled: the first robot, the board of the last sub-team, or that sub-team with its boards."""
    team = scenario.team
    last = list(team.sub_teams)[-1]
    return {
        "robots": list(team.robots),
        "robot": list(team.robots)[:1],
        "board": team.boards_of(last)[:1],
        "sub-team": [*team.sub_teams[last], *team.boards_of(last)],
        "router": ["router"],
        "sites": ["sites"],
    }.get(who, [])
