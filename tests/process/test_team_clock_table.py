"""Whose clock is followed: each row of the table is walked, and no sequence of events is unknown to it."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.roster import Roster
from blackboard.process.team_clock import CLOCKLESS, STOPPED, WORLD_SILENT, ClockEvent, News, Pace, State, TeamClock
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock

NOW = 1_000_000.0
WORLD = keys.WORLD.key(team="t")


class Walk:
    """A clock, and what may happen to it: each action returns its news."""

    def __init__(self, period: float | None = None) -> None:
        self.clock = TeamClock(Roster(grace=0.0), period)
        self.now, self.tick = NOW, 0

    def do(self, action: tuple[Any, ...]) -> list[News]:
        name, *arguments = action
        news: list[News] = getattr(self, f"_{name}")(*arguments)
        self.clock.check()
        return news

    def _token(self, kind: Kind) -> list[News]:
        self.clock.roster.hear_token(Envelope(WORLD, kind=kind), self.now)
        self.clock.roster.forget(self.now)
        return []

    def _clock(self, run: str, ticks: int) -> list[News]:
        """A Clock that is so many ticks after the one before."""
        self.tick = max(0, self.tick + ticks)
        clock = Clock(run=run, tick=self.tick, time=0.2 * self.tick, mode="lockstep")
        event = self.clock.hear_clock(clock, self.now)
        return [] if event is News.NOTHING else [event]

    def _wait(self, seconds: float) -> list[News]:
        self.now += seconds
        self.clock.roster.forget(self.now)
        return list(iter(lambda: self.clock.look(self.now), News.NOTHING))


ALIVE, GONE, CLOCK, AGAIN = ("token", Kind.ALIVE), ("token", Kind.GONE), ("clock", "one", 1), ("clock", "one", 0)
JUMP, BACK, OTHER, LOOK, LATER = (
    ("clock", "one", 9),
    ("clock", "one", -1),
    ("clock", "two", 1),
    ("wait", 0.0),
    ("wait", 1.0),
)
IN_VAIN = [ALIVE, LOOK, ("wait", CLOCKLESS)]  # a token without a Clock
FOLLOWED = [ALIVE, CLOCK]
STRANGER = [CLOCK, ("wait", 3.0), ALIVE, LOOK]  # its Clocks came long before the token
WALKS: dict[tuple[State, ClockEvent], list[tuple[Any, ...]]] = {
    (State.FREE, ClockEvent.STRAY): [CLOCK],
    (State.FREE, ClockEvent.MORE): [CLOCK, ("wait", WORLD_SILENT), CLOCK],
    (State.FREE, ClockEvent.STRANGER): [*IN_VAIN, GONE, *STRANGER, CLOCK],
    (State.FREE, ClockEvent.FIRST): [*IN_VAIN, CLOCK],
    (State.FREE, ClockEvent.PERIOD): [LATER],
    (State.CLOCK, ClockEvent.MORE): [CLOCK, CLOCK],
    (State.CLOCK, ClockEvent.TOKENLESS): [CLOCK, ("wait", WORLD_SILENT)],
    (State.TOKEN, ClockEvent.STRANGER): [*STRANGER, CLOCK],
    (State.TOKEN, ClockEvent.FIRST): FOLLOWED,
    (State.TOKEN, ClockEvent.CLOCKLESS): IN_VAIN,
    (State.FOLLOWED, ClockEvent.MORE): [*FOLLOWED, GONE, CLOCK],
    (State.FOLLOWED, ClockEvent.NEXT): [*FOLLOWED, CLOCK],
    (State.FOLLOWED, ClockEvent.SAME): [*FOLLOWED, AGAIN],
    (State.FOLLOWED, ClockEvent.RIVAL): [*FOLLOWED, JUMP],
    (State.FOLLOWED, ClockEvent.JUMP): [*FOLLOWED, JUMP, LATER, AGAIN],
    (State.FOLLOWED, ClockEvent.RUN): [*FOLLOWED, BACK, LATER, AGAIN],
    (State.FOLLOWED, ClockEvent.SILENT): [*FOLLOWED, ("wait", STOPPED)],
}


ROWS = [(state, event) for event in ClockEvent for state in event.value.states]


@pytest.mark.parametrize(("state", "event"), ROWS, ids=[f"{s.value}-{e.name.lower()}" for s, e in ROWS])
def test_each_row_is_walked(state: State, event: ClockEvent) -> None:
    walk = Walk(0.5 if event is ClockEvent.PERIOD else None)
    *before, last = WALKS[state, event]
    for action in before:
        walk.do(action)
    assert walk.clock.state is state
    row = event.value
    assert (walk.do(last), walk.clock.state) == ([] if row.news is None else [row.news], row.then or state)


actions = st.sampled_from(
    [ALIVE, GONE, CLOCK, AGAIN, JUMP, BACK, OTHER, LOOK, LATER, ("wait", 0.2), ("wait", 6.0), ("wait", 61.0)]
)


@given(st.lists(actions, max_size=30))
def test_whatever_happens_the_table_knows_it(done: list[tuple[Any, ...]]) -> None:
    walk = Walk(0.5)
    for action in done:
        walk.do(action)
        assert (walk.clock.pace is Pace.FREE) == (walk.clock.state is State.FREE)
