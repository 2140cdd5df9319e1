"""Health is what a process says, not that it exists."""

from typing import Literal

import pytest

from blackboard.board.service import BoardService
from blackboard.config import BoardSection
from blackboard.net.bus import intersects
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Grid
from blackboard.run.health import ProcessKind, board_named, diagnose, part
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Report, Status
from tests.wire.envelopes import put, token

NOW = 1_700_000_000.0


class Answers:
    """A network on which some envelopes are the newest."""

    def __init__(self, *envelopes: Envelope) -> None:
        self.envelopes = envelopes

    def get(self, key_expr: str) -> list[Envelope]:
        return [envelope for envelope in self.envelopes if intersects(key_expr, envelope.key)]


def clock(time: float) -> Envelope:
    return put(Clock(run="1", tick=1, time=time, mode="lockstep"))


def belief(robot: str, time: float) -> Envelope:
    subject = f"robot/{robot}"
    return put(Report(source=robot, subject=subject, tick=1, time=time, belief=pack(uniform(Grid((5, 5))))))


def status(board: str, time: float) -> Envelope:
    return put(Status(process=board, kind="board", tick=1, time=time))


def ask(kind: ProcessKind, name: str, *envelopes: Envelope) -> str | None:
    return diagnose(Answers(*envelopes), kind, name, NOW, team="t", max_age=5.0)


def test_a_robot_is_healthy_while_its_belief_is_fresh_by_the_worlds_clock() -> None:
    assert ask("robot", "r1", clock(20.0), belief("r1", 16.0)) is None
    assert ask("robot", "r1", clock(20.0), belief("r1", 14.0)) == "the belief of robot r1 is 6.0 s old"


def test_where_no_world_tells_the_time_unix_time_counts() -> None:
    assert ask("robot", "r1", belief("r1", NOW - 1.0)) is None
    assert "8.0 s old" in (ask("robot", "r1", belief("r1", NOW - 8.0)) or "")


def test_a_stamp_by_a_world_that_is_gone_is_no_age() -> None:
    verdict = ask("robot", "r1", belief("r1", 60.0))
    assert verdict == "the belief of robot r1 is stamped 60.0 s by the clock of a world that does not answer any more"


def test_a_belief_of_another_run_is_not_fresh() -> None:
    assert "s old" in (ask("robot", "r1", clock(1.0), belief("r1", 60.0)) or "")


def test_the_beliefs_of_others_do_not_count() -> None:
    assert "does not answer" in (ask("robot", "r1", clock(20.0), belief("r2", 20.0)) or "")


def test_who_does_not_answer_is_told_with_those_who_do() -> None:
    verdict = ask("board", "x", clock(20.0), status("board-b", 20.0), status("board-a", 20.0))
    assert (verdict or "").endswith("; there is board-a, board-b")
    assert (ask("robot", "x", status("board-a", 20.0)) or "").endswith("; no robot of team t answers")


def test_a_board_is_healthy_while_what_it_settled_is_fresh() -> None:
    assert ask("board", "a", clock(20.0), status("a", 20.0)) is None
    assert ask("board", "a", clock(30.0), status("a", 20.0)) == "what board a settled last is 10.0 s old"
    assert ask("board", "a", status("a", NOW - 1.0)) is None


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_board_that_repeats_its_status_and_settles_nothing_is_not_healthy(mode: str) -> None:
    """A real board under a world that is alive and whose Clock answers nobody: it says its status again every second."""
    board = BoardService(team="t", sub_team="a", board="a", grid=Grid((5, 5)), settings=BoardSection(period=0.2))

    def diagnosis(now: float) -> str | None:
        said = [e for e in board.wake(now) if "/status/" in e.key]
        return diagnose(Answers(*said[-1:]), "board", "a", now, team="t", max_age=5.0)

    assert diagnosis(NOW) is None  # no world: it settles by Unix time
    board.receive(token(keys.WORLD), NOW)
    message = Clock(run="1", tick=1, time=NOW, mode=mode)  # type: ignore[arg-type]
    board.receive(put(message), NOW)
    board.wake(NOW)  # as the loop does after a batch
    assert [diagnosis(NOW + seconds) for seconds in (1.0, 2.5, 4.0)] == [None] * 3
    assert "board a settled last" in (diagnosis(NOW + 6.0) or "")
    board.receive(token(keys.WORLD, kind=Kind.GONE), NOW + 7.0)
    board.wake(NOW + 8.0)
    assert [diagnosis(NOW + seconds) for seconds in (9.5, 11.0)] == [None] * 2  # the world is gone: Unix time again


def test_what_cannot_be_read_is_no_answer() -> None:
    garbage = Envelope(belief("r1", 0.0).key, b"garbage")
    assert "does not answer" in (ask("robot", "r1", clock(20.0), garbage) or "")
    assert ask("robot", "r1", clock(20.0), garbage, belief("r1", 20.0)) is None


@pytest.mark.parametrize(("envelopes", "well"), [((), False), ((clock(3.0),), True)])
def test_a_world_is_healthy_while_it_tells_the_time(envelopes: tuple[Envelope, ...], well: bool) -> None:
    assert (ask("world", "world", *envelopes) is None) == well


def test_who_asks_has_come_through_the_router() -> None:
    assert ask("router", "router") is None


@pytest.mark.parametrize(("follows", "verdict"), [(True, ", follows"), (False, "")])
def test_a_board_that_follows_another_one_is_told_from_one_that_leads(follows: bool, verdict: str) -> None:
    network = Answers(put(Status(process="board-a2", kind="board", tick=1, time=3.0, follows=follows)))
    assert part(network, "board", "board-a2", team="t") == verdict
    assert part(network, "robot", "board-a2", team="t") == ""


def test_a_healthy_world_says_its_tick() -> None:
    network = Answers(put(Clock(run="1", tick=12, time=2.4, mode="lockstep")))
    assert part(network, "world", "world", team="t") == ", tick 12"
    assert part(Answers(), "world", "world", team="t") == ""


def test_several_processes_of_one_name_are_told() -> None:
    def answers(kind: ProcessKind, *sent: int) -> str:
        said = [Status(process="x", kind="board", tick=1, time=3.0, counters={"sent": n}) for n in sent]
        return part(Answers(*(put(message, sub_team=s) for message in said for s in ("a", "b"))), kind, "x", team="t")

    assert answers("robot", 1) == answers("board", 1, 1) == ""  # the same bytes again: who keeps what it sent
    assert answers("robot", 1, 2) == ", but 2 processes answer as robot x"
    assert answers("board", 1, 2, 3) == ", but 3 processes answer as board x"


def test_a_board_may_be_named_by_its_sub_team() -> None:
    def named(name: str, *said: tuple[str, str, Literal["board", "robot"], bool]) -> str:
        statuses = (
            put(Status(process=process, kind=kind, tick=1, time=3.0, follows=follows), sub_team=sub_team)
            for sub_team, process, kind, follows in said
        )
        return board_named(Answers(*statuses), name, team="t")

    twins = ("a", "board-a", "board", True), ("a", "desk", "board", False), ("a", "r1", "robot", False)
    other = ("b", "a", "board", False)
    assert named("board-a", *twins, other) == "board-a"
    assert named("a", *twins, other) == "a"  # a board of this name goes before a sub-team
    assert named("a", *twins) == "desk"  # the one that leads
    assert named("a", *twins[:1]) == "board-a"
    assert named("a", *twins[2:]) == named("a") == "a"  # nobody: what is told is that it does not answer
