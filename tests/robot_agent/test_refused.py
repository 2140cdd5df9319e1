"""A robot whose reports a board refuses says so in its log, once for each reason, and counts it."""

from __future__ import annotations

import pytest

from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Refusal
from tests.robot_agent.test_service import NOW, service


def refusal(reason: str, board: str = "board-a") -> Envelope:
    said = Refusal(
        board=board, sub_team="a", robot="r1", time=1.0, subject="object/ball", reason=reason, text="no\nlines", count=1
    )
    return Envelope(keys.REFUSED.key(team="t", sub_team="a", robot="r1"), encode(said))


def test_it_logs_each_reason_once_in_one_line(caplog: pytest.LogCaptureFixture) -> None:
    robot = service("a")
    for reason in ("grid", "grid", "past"):
        robot.receive(refusal(reason), NOW)
    lines = [record.getMessage() for record in caplog.records]
    assert [line.split(";")[0] for line in lines] == [
        f"board-a refused the report about object/ball of r1 ({reason}: no\\nlines)" for reason in ("grid", "past")
    ]
    assert robot.counters["told_refused"] == 3


def test_who_is_no_board_tells_nothing(caplog: pytest.LogCaptureFixture) -> None:
    robot = service("a")
    robot.receive(refusal("grid", board="x"), NOW)
    assert robot.counters["told_refused"] == 0
    assert robot.refused["unregistered"] == 1
