"""Who counts as there: a team at work is right, and who is wrong is named."""

import pytest

from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from tests.nights import faults
from tests.nights.events import Ended, Event, Moved, Over
from tests.nights.night import Night, Team
from tests.nights.rosters import RostersAreTrue
from tests.nights.run import judged, played

TEAM = Team({"a": ("r1", "r2")}, "realtime", tick=1.0, latency=0.02)


def reason(events: list[Event]) -> str:
    return judged(RostersAreTrue(Night(TEAM)), events)


@pytest.mark.parametrize("fault", [(), (faults.Routerless(2.0, 4.0),), (faults.Killed(2.0, 4.0, "robot/r2"),)])
def test_boards_are_right_about_who_is_there(fault: tuple[faults.Fault, ...]) -> None:
    assert not reason(played(Night(TEAM, fault)))


def test_a_board_that_counts_who_has_gone_is_named() -> None:
    events = played(Night(TEAM))
    gone = next(event for event in events if isinstance(event, Ended) and event.process == "robot/r2")
    before_the_end = next(n for n, event in enumerate(events) if isinstance(event, Over))
    assert "board/a/board-a is wrong about who is there: robot/a/r2" in reason(
        [*events[:before_the_end], gone, *events[before_the_end:]]
    )


def test_who_forgets_while_it_is_cut_off_is_named() -> None:
    events = played(Night(TEAM))
    moved = next(event for event in reversed(events) if isinstance(event, Moved) and event.process == "board/a/board-a")
    roster, now = moved.service.roster, 1e9  # type: ignore[attr-defined]
    oracle = RostersAreTrue(Night(TEAM))
    roster.hear_token(Envelope(roster.own, kind=Kind.GONE), now)
    oracle.see(moved)
    roster.hear_token(Envelope(keys.MEMBER.key(team="t", sub_team="a", robot="r2"), kind=Kind.GONE), now)
    oracle.see(moved)
    assert oracle.verdict() is None
    roster.away = False  # as if it took its router for there
    roster.forget(now + 10.0)
    roster.away = True
    oracle.see(moved)
    assert "forgets board/a/board-a while" in str(oracle.verdict())
