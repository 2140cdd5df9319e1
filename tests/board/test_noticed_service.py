"""Whose words a board's process takes, against tables of what may be said by whom."""

from __future__ import annotations

import pytest

from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Status
from tests.board.desk import Desk, clock, levels, report, reported


@pytest.mark.parametrize(
    ("sub_team", "kind", "phase", "withdrawn"),
    [
        ("a", "robot", "reported", True),
        ("b", "robot", "reported", False),
        ("a", "board", "reported", False),
        ("a", "robot", "agreed", False),
    ],
)
def test_only_a_robot_of_the_sub_team_that_has_reported_withdraws_what_it_does_not_list(
    sub_team: str, kind: str, phase: str, withdrawn: bool
) -> None:
    desk = Desk(patience=2.0)
    desk.register("r1", "r2")
    desk.tell(clock(0, "r1", "r2"), report("r1", 0), reported("r1", 0, "object/ball"))
    desk.tell(report("r2", 0), reported("r2", 0, "object/ball"))
    desk.tell(clock(1, "r1", "r2"))
    said = Status(process="r1", kind=kind, tick=1, time=0.2, phase=phase, subjects=[])  # type: ignore[arg-type]
    desk.tell(Envelope(keys.STATUS.key(team="t", sub_team=sub_team, process="r1"), encode(said)))
    told = desk.wait(2.1)
    assert levels(told) == ["consensus", "agreed"]
    assert [used.source for used in decode(Consensus, told[0].payload).used] == (["r2"] if withdrawn else ["r1", "r2"])


def test_a_clock_without_a_world_is_logged_once_and_counted_each_time(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk(world=False)
    for tick in range(3):
        desk.tell(clock(tick, "r1"))
        assert sum("is not followed" in record.message for record in caplog.records) == 1
    assert desk.status().counters["unannounced"] == 3


def test_only_a_phase_that_time_has_ended_counts_as_late() -> None:
    desk = Desk(patience=2.0)
    desk.tell(clock(0, "r1"))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus", "agreed"]
    assert desk.status().counters.get("late", 0) == 0
    desk.tell(clock(1, "r1"))
    assert levels(desk.wait(2.1)) == ["consensus", "agreed"]
    assert desk.status().counters["late"] == 1
