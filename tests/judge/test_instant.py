"""One tick as the world keeps it: when a board is done, who speaks for a sub-team, and who is not listened to."""

from typing import Any

import pytest

from blackboard.judge import instant as module
from blackboard.judge.instant import Instant
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack
from blackboard.wire.messages import Consensus, Solo, Status, Truth
from tests.wire import envelopes

GRID = Grid((10, 10))


def new_instant() -> Instant:
    return Instant(Truth(run="x", tick=1, time=0.2, positions={}), {"a": ["r1"], "b": ["r2"]})


def consensus(board: str, level: Any = "agreed", subject: str = "robot/r1", x: float = 2.0) -> Consensus:
    return envelopes.consensus(gaussian(GRID, (x, 2.0), 1.0), subject, board=board, level=level, tick=1)


def status(board: str, phase: Any, *subjects: str) -> Status:
    return Status(process=board, kind="board", tick=1, time=0, phase=phase, subjects=list(subjects))


def test_a_board_is_done_once_everything_listed_is_in() -> None:
    instant = new_instant()
    for phase in ("agreed", "consensus"):
        assert not instant.settled("a", "x")
        assert instant.hear_message("a", status("x", phase, "robot/r1"), b"")
        assert not instant.hear_message("a", status("x", phase, "robot/r1"), b"")
    assert not instant.settled("a", "x")
    assert instant.hear_message("a", consensus("x", "agreed"), b"1")
    assert not instant.settled("a", "x")
    assert instant.agreed_subjects() == {}
    assert instant.hear_message("a", consensus("x", "consensus"), b"2")
    assert not instant.hear_message("a", consensus("x", "consensus"), b"2")
    assert instant.settled("a", "x")
    assert instant.agreed_subjects() == {"a": ["robot/r1"]}
    assert not instant.settled("a", "y")


@pytest.mark.parametrize("names", ["xy", "yx"])
def test_two_boards_of_one_sub_team_are_kept_apart_and_the_first_name_speaks(names: str) -> None:
    instant = new_instant()
    for board in names:
        instant.hear_message("a", status(board, "consensus"), b"")
        instant.hear_message("a", status(board, "agreed", "robot/r1", f"object/{board}"), b"")
        instant.hear_message("a", consensus(board, x=2.0 if board == "x" else 7.0), board.encode())
        instant.hear_message("a", consensus(board, subject=f"object/{board}"), board.encode())
    assert instant.settled("a", "x")
    assert instant.settled("a", "y")
    assert instant.agreed_subjects() == {"a": ["object/x", "robot/r1"]}
    assert instant.belief("agreed", "r1", "a", "robot/r1") == consensus("x", x=2.0).belief
    # The other board knows nothing of y.
    assert instant.belief("agreed", "r1", "a", "object/y") == consensus("y").belief
    assert [payload for _, (payload, _) in sorted(instant.consensuses.items())] == [b"x", b"y", b"x", b"y"]


def test_a_board_that_lists_and_does_not_say_speaks_for_nobody() -> None:
    instant = new_instant()
    instant.hear_message("a", status("x", "consensus"), b"")
    instant.hear_message("a", status("x", "agreed", "robot/r1"), b"")
    instant.hear_message("a", status("y", "consensus"), b"")
    instant.hear_message("a", status("y", "agreed"), b"")
    assert instant.agreed_subjects() == {"a": []}


def test_only_who_takes_part_is_listened_to() -> None:
    instant = new_instant()
    instant.hear_message("", Solo(robot="stranger", tick=1, time=0.0, beliefs={}), b"")
    assert not instant.hear_message("c", consensus("x"), b"")
    assert not instant.hear_message("c", status("x", "agreed"), b"")
    assert (instant.solos, instant.consensuses, instant.boards) == ({}, {}, {})
    assert instant.hear_message("", Solo(robot="r1", tick=1, time=0.0, beliefs={}), b"")
    assert set(instant.solos) == {"r1"}


def test_what_is_kept_of_a_tick_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CONSENSUSES", 2)
    instant = new_instant()
    for subject in ("robot/r1", "object/ball", "object/can"):
        instant.hear_message("a", consensus("x", subject=subject), b"")
    assert [name[2] for name in instant.consensuses] == ["robot/r1", "object/ball"]


def test_a_belief_is_found_by_level_robot_and_sub_team() -> None:
    instant = new_instant()
    alone = pack(gaussian(GRID, (3.0, 3.0), 1.0))
    instant.hear_message("", Solo(robot="r1", tick=1, time=0.0, beliefs={"robot/r1": alone}), b"")
    instant.hear_message("a", consensus("x", x=5.0), b"")
    assert instant.belief("agreed", "r2", "a", "robot/r1") == consensus("x", x=5.0).belief
    assert instant.belief("solo", "r1", "b", "robot/r1") == alone
    assert instant.belief("solo", "r1", "a", "object/ball") is None
    assert instant.belief("solo", "r2", "a", "robot/r2") is None
    assert instant.belief("consensus", "r1", "a", "robot/r1") is None
    assert instant.belief("agreed", "r1", "b", "robot/r1") is None
