"""Health is what a process says, not that it exists."""

from __future__ import annotations

import pytest

from blackboard.health import Kind, ailment
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock, Report, Status
from tests.team import matches

NOW = 1_700_000_000.0


class Answers:
    """A network on which some envelopes are the newest."""

    def __init__(self, *envelopes: Envelope) -> None:
        self.envelopes = envelopes

    def get(self, key_expr: str) -> list[Envelope]:
        return [envelope for envelope in self.envelopes if matches(key_expr, envelope.key)]


def clock(time: float) -> Envelope:
    return Envelope(keys.CLOCK.key(team="t"), encode(Clock(run="1", tick=1, time=time, mode="lockstep")))


def belief(robot: str, time: float) -> Envelope:
    subject = f"robot/{robot}"
    report = Report(source=robot, subject=subject, tick=1, time=time, belief=pack(uniform(Grid((5, 5)))))
    return Envelope(keys.REPORT.key(team="t", sub_team="a", source=robot, subject=subject), encode(report))


def status(board: str, time: float) -> Envelope:
    said = Status(process=board, kind="board", tick=1, time=time)
    return Envelope(keys.STATUS.key(team="t", sub_team="a", process=board), encode(said))


def ask(kind: Kind, name: str, *envelopes: Envelope) -> str | None:
    return ailment(Answers(*envelopes), kind, name, NOW, team="t", max_age=5.0)


def test_a_robot_is_healthy_while_its_belief_is_fresh_by_the_worlds_clock() -> None:
    assert ask("robot", "r1", clock(20.0), belief("r1", 16.0)) is None
    assert ask("robot", "r1", clock(20.0), belief("r1", 14.0)) == "the belief of robot r1 is 6.0 s old"


def test_where_no_world_tells_the_time_unix_time_counts() -> None:
    assert ask("robot", "r1", belief("r1", NOW - 1.0)) is None
    assert "8.0 s old" in (ask("robot", "r1", belief("r1", NOW - 8.0)) or "")


def test_a_belief_of_another_run_is_not_fresh() -> None:
    assert "s old" in (ask("robot", "r1", clock(1.0), belief("r1", 60.0)) or "")


def test_the_beliefs_of_others_do_not_count() -> None:
    assert "does not answer" in (ask("robot", "r1", clock(20.0), belief("r2", 20.0)) or "")


def test_a_board_is_healthy_while_its_status_is_fresh() -> None:
    assert ask("board", "a", clock(20.0), status("a", 20.0)) is None
    assert "the status of board a" in (ask("board", "a", clock(30.0), status("a", 20.0)) or "")


def test_what_cannot_be_read_is_no_answer() -> None:
    garbage = Envelope(belief("r1", 0.0).key, b"garbage")
    assert "does not answer" in (ask("robot", "r1", clock(20.0), garbage) or "")
    assert ask("robot", "r1", clock(20.0), garbage, belief("r1", 20.0)) is None


@pytest.mark.parametrize(("envelopes", "well"), [((), False), ((clock(3.0),), True)])
def test_a_world_is_healthy_while_it_tells_the_time(envelopes: tuple[Envelope, ...], well: bool) -> None:
    assert (ask("world", "world", *envelopes) is None) == well


def test_who_asks_has_come_through_the_router() -> None:
    assert ask("router", "router") is None
