"""Rounds: when a phase of a tick is over, for every kind of process and every pace, as one table each. Pure.

A phase ends with a fact ("reports": all reports of the tick are in), or when its longest time is over. The tables say only
when that is and which phase follows; what a process does at the end of a phase stands in its service.
`python -m blackboard.process.rounds` prints them.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from blackboard.process.columns import columns
from blackboard.process.team_clock import Pace


@dataclass(frozen=True)
class Row:
    """A phase of a tick."""

    until: str  # the fact that ends it; "" for none
    at_most: str  # which wait ends it otherwise: "at once", "never", or the name of one that the process is given
    then: str  # the phase that follows
    late: bool = False  # whether it counts as late when time ends it
    when: str = "message"  # after which of `MOMENTS` it may end


Table = Mapping[tuple[Pace, str], Row]

#: "message": after each message, and when the process is woken; "batch": when it is woken, which in real time is after each batch of
#: messages; "before": also before a message is taken.
MOMENTS = {"message": ("message", "batch"), "batch": ("batch",), "before": ("before", "batch")}

#: A board. "settled" is left when a tick begins: by the world's Clock, or by Unix time (`TeamClock.look`). In real time a board
#: that needs longer than a tick to settle would settle every tick that it reads of, later each time; so it settles after a batch only.
#: A new Clock would end an exchange without publishing what is agreed; so that ends before the next message.
BOARD: Table = {
    (Pace.WAITING, "settled"): Row("", "never", "settled"),
    (Pace.FREE, "settled"): Row("", "never", "settled"),
    (Pace.FREE, "reports"): Row("", "at once", "exchange"),
    (Pace.FREE, "exchange"): Row("", "at once", "settled"),
    (Pace.REALTIME, "settled"): Row("", "never", "settled"),
    (Pace.REALTIME, "reports"): Row("reports", "half a period", "exchange", late=True, when="batch"),
    (Pace.REALTIME, "exchange"): Row("consensuses", "half a period", "settled", late=True, when="before"),
    (Pace.LOCKSTEP, "settled"): Row("", "never", "settled"),
    (Pace.LOCKSTEP, "reports"): Row("reports", "patience", "exchange", late=True),
    (Pace.LOCKSTEP, "exchange"): Row("consensuses", "patience with boards", "settled", late=True),
}

#: A robot. It acts on its readings at the end of "agreed": in lockstep once it has what the boards agreed on before.
ROBOT: Table = {
    (Pace.WAITING, "readings"): Row("", "never", "readings"),
    (Pace.FREE, "readings"): Row("readings", "never", "agreed"),
    (Pace.FREE, "agreed"): Row("", "at once", "readings"),
    (Pace.REALTIME, "readings"): Row("readings", "never", "agreed"),
    (Pace.REALTIME, "agreed"): Row("", "at once", "readings"),
    (Pace.LOCKSTEP, "readings"): Row("readings and clock", "never", "agreed"),
    (Pace.LOCKSTEP, "agreed"): Row("agreed", "patience", "readings", late=True),
}

#: A world, which makes the ticks. It waits in "gather" for the team, before the first tick and, in lockstep, whenever too
#: few are there to go on. In real time the last tick may be answered for a while.
WORLD: Table = {
    (Pace.REALTIME, "start"): Row("", "at once", "gather"),
    (Pace.REALTIME, "gather"): Row("team", "gather", "tick"),
    (Pace.REALTIME, "tick"): Row("", "tick", "tick"),
    (Pace.REALTIME, "last"): Row("", "linger", "last"),
    (Pace.LOCKSTEP, "start"): Row("", "at once", "gather"),
    (Pace.LOCKSTEP, "gather"): Row("team", "gather", "tick"),
    (Pace.LOCKSTEP, "tick"): Row("answers", "give_up", "tick", late=True),
}

TABLES: dict[str, Table] = {"board": BOARD, "robot": ROBOT, "world": WORLD}


class Rounds:
    """In which phase of a tick a process is, and until when. `now` is Unix time in seconds."""

    def __init__(self, table: Table, waits: Mapping[str, float], phase: str) -> None:
        """`waits` has the length in seconds of each wait that the table names; `phase` is the one to begin with."""
        self.table = table
        self.waits = {"never": math.inf, "at once": 0.0, **waits}
        self.phase = phase
        self.began = 0.0  # Unix seconds

    def enter(self, phase: str, now: float) -> None:
        self.phase, self.began = phase, now

    def ends_at(self, pace: Pace) -> float:
        """When time ends the phase, at the latest; infinity if it does not."""
        row = self.table.get((pace, self.phase))
        return math.inf if row is None else self.began + self.waits[row.at_most]

    def check(self) -> None:
        """AssertionError: the process is in a phase that it does not have."""
        assert any(phase == self.phase for _, phase in self.table), self.phase

    def turn(
        self, pace: Pace, now: float, fact: Callable[[str], bool], moment: str = "batch"
    ) -> tuple[str, bool] | None:
        """Enter the next phase where this one is over: the phase that ended, and whether it counts as late; else None.

        `moment` is one of `MOMENTS`. A phase that the pace does not have lasts until `enter`: the process changed its pace and
        begins anew.
        """
        row = self.table.get((pace, self.phase))
        if row is None or moment not in MOMENTS[row.when]:
            return None
        complete = bool(row.until) and fact(row.until)
        if not complete and now < self.began + self.waits[row.at_most]:
            return None
        ended = self.phase
        self.enter(row.then, now)
        return ended, row.late and not complete


def text() -> str:
    rows = [
        (name, pace.value, phase, row.until or "-", row.at_most, row.when, row.then)
        for name, table in TABLES.items()
        for (pace, phase), row in table.items()
    ]
    return "\n".join(columns([("process", "pace", "phase", "until", "at most", "when", "then"), *rows]))


if __name__ == "__main__":
    print(text())  # noqa: T201
