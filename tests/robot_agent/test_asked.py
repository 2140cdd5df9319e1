"""A world asks again: a robot answers what it is asked, and nothing where others are."""

from __future__ import annotations

from blackboard.wire import keys
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock
from tests.robot_agent.test_service import NOW, clock, kinds, readings, said, service, world


def test_a_clock_that_asks_others_is_not_answered_and_one_that_asks_for_a_status_with_that_alone() -> None:
    robot = service()
    robot.receive(world(), NOW)
    robot.receive(readings(0), NOW)
    first = robot.receive(clock(0), NOW)

    def asked(**fields: list[str]) -> list[Envelope]:
        again = decode(Clock, clock(0).payload).model_copy(update=fields)
        return robot.receive(Envelope(keys.CLOCK.key(team="t"), encode(again)), NOW + 1)

    assert asked(asked=["robot/r2"], again=["board/a/x"]) == []
    assert kinds(asked(asked=["robot/r1"])) == ["Status"]
    assert said(asked(again=["robot/r1"]))[:-1] == said(first)[:-1]
