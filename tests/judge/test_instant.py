"""One tick as the world keeps it: when a board is done, who speaks for a sub-team, and who is not listened to."""

from __future__ import annotations

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


def instant() -> Instant:
    return Instant(Truth(run="x", tick=1, time=0.2, positions={}), {"a": ["r1"], "b": ["r2"]})


def consensus(board: str, level: Any = "agreed", subject: str = "robot/r1", x: float = 2.0) -> Consensus:
    return envelopes.consensus(gaussian(GRID, (x, 2.0), 1.0), subject, board=board, level=level, tick=1)


def status(board: str, phase: Any, *subjects: str, tick: int = 1) -> Status:
    return Status(process=board, kind="board", tick=tick, time=0, phase=phase, subjects=list(subjects))


def test_a_board_is_done_once_everything_listed_is_in() -> None:
    it = instant()
    for phase in ("agreed", "consensus"):
        assert not it.settled("a", "x")
        assert it.hear_message("a", status("x", phase, "robot/r1"), b"")
        assert not it.hear_message("a", status("x", phase, "robot/r1"), b"")
    assert not it.settled("a", "x")
    assert it.hear_message("a", consensus("x", "agreed"), b"1")
    assert not it.settled("a", "x")
    assert it.agreed_subjects() == {}
    assert it.hear_message("a", consensus("x", "consensus"), b"2")
    assert not it.hear_message("a", consensus("x", "consensus"), b"2")
    assert it.settled("a", "x")
    assert it.agreed_subjects() == {"a": ["robot/r1"]}
    assert not it.settled("a", "y")


@pytest.mark.parametrize("names", ["xy", "yx"])
def test_two_boards_of_one_sub_team_are_kept_apart_and_the_first_name_speaks(names: str) -> None:
    it = instant()
    for board in names:
        it.hear_message("a", status(board, "consensus"), b"")
        it.hear_message("a", status(board, "agreed", "robot/r1", f"object/{board}"), b"")
        it.hear_message("a", consensus(board, x=2.0 if board == "x" else 7.0), board.encode())
        it.hear_message("a", consensus(board, subject=f"object/{board}"), board.encode())
    assert it.settled("a", "x")
    assert it.settled("a", "y")
    assert it.agreed_subjects() == {"a": ["object/x", "robot/r1"]}
    assert it.belief("agreed", "r1", "a", "robot/r1") == consensus("x", x=2.0).belief
    assert it.belief("agreed", "r1", "a", "object/y") == consensus("y").belief  # the other board knows nothing of it
    assert [payload for _, (payload, _) in sorted(it.consensuses.items())] == [b"x", b"y", b"x", b"y"]


def test_a_board_that_lists_and_does_not_say_speaks_for_nobody() -> None:
    it = instant()
    it.hear_message("a", status("x", "consensus"), b"")
    it.hear_message("a", status("x", "agreed", "robot/r1"), b"")
    it.hear_message("a", status("y", "consensus"), b"")
    it.hear_message("a", status("y", "agreed"), b"")
    assert it.agreed_subjects() == {"a": []}


def test_only_who_takes_part_is_listened_to() -> None:
    it = instant()
    it.hear_message("", Solo(robot="stranger", tick=1, time=0.0, beliefs={}), b"")
    assert not it.hear_message("c", consensus("x"), b"")
    assert not it.hear_message("c", status("x", "agreed"), b"")
    assert (it.solos, it.consensuses, it.boards) == ({}, {}, {})
    assert it.hear_message("", Solo(robot="r1", tick=1, time=0.0, beliefs={}), b"")
    assert set(it.solos) == {"r1"}


def test_what_is_kept_of_a_tick_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CONSENSUSES", 2)
    it = instant()
    for subject in ("robot/r1", "object/ball", "object/can"):
        it.hear_message("a", consensus("x", subject=subject), b"")
    assert [name[2] for name in it.consensuses] == ["robot/r1", "object/ball"]


def test_a_belief_is_found_by_level_robot_and_sub_team() -> None:
    it = instant()
    alone = pack(gaussian(GRID, (3.0, 3.0), 1.0))
    it.hear_message("", Solo(robot="r1", tick=1, time=0.0, beliefs={"robot/r1": alone}), b"")
    it.hear_message("a", consensus("x", x=5.0), b"")
    assert it.belief("agreed", "r2", "a", "robot/r1") == consensus("x", x=5.0).belief
    assert it.belief("solo", "r1", "b", "robot/r1") == alone
    assert it.belief("solo", "r1", "a", "object/ball") is None
    assert it.belief("solo", "r2", "a", "robot/r2") is None
    assert it.belief("consensus", "r1", "a", "robot/r1") is None
    assert it.belief("agreed", "r1", "b", "robot/r1") is None
