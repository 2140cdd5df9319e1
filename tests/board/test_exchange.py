"""The exchange between the boards of sub-teams: the agreed belief, and what is not counted twice in it."""

import pytest

from blackboard.board.board import Board
from blackboard.opinion.belief import blur
from blackboard.wire.messages import Consensus
from tests.board.reports import FINE, at, fine, new_board, only, report, said_by, same


def exchanged(*sub_teams: Board) -> dict[str, Consensus]:
    """Settle and exchange between boards that know one subject; the agreed belief of each."""
    said = [c for b in sub_teams for c in b.settle(0, 0.0)]
    for b in sub_teams:
        for consensus in said:
            b.hear_consensus(consensus, 0.0)
    return {b.sub_team: only(b.exchange(0, 0.0)) for b in sub_teams}


def test_after_the_exchange_all_sub_teams_hold_the_same_belief() -> None:
    a, b = (new_board(sub_team, independence=1.0) for sub_team in "ab")
    a.hear(report("r1", at(10, 10, 3)), 0.0)
    a.hear(report("r2", at(12, 10, 3)), 0.0)
    b.hear(report("r4", at(11, 12, 2)), 0.0)
    agreed = exchanged(a, b)
    assert agreed["a"].belief == agreed["b"].belief
    assert agreed["a"].ancestors == {"r1": 0.0, "r2": 0.0, "r4": 0.0}
    assert agreed["a"].entropy < min(c.entropy for c in a.settle(0, 0.0) + b.settle(0, 0.0))


def test_a_robot_in_two_sub_teams_is_not_counted_twice() -> None:
    """Both consensuses rest on r1 alone: the exchange must not multiply them."""
    a, b = new_board("a"), new_board("b")
    for board in (a, b):
        board.hear(report("r1", at(10, 10, 2)), 0.0)
    alone = only(a.settle(0, 0.0)).entropy
    assert exchanged(a, b)["a"].entropy == pytest.approx(alone, abs=0.02)


def test_two_boards_of_one_sub_team_are_one_opinion_whoever_is_heard_first() -> None:
    """The newest tick counts, then the name that sorts first; with one board each nothing is chosen."""
    own = said_by("a", at(10, 10, 3), name="x")
    older, first, second = (
        said_by("b", at(5, 5, 3), name="b1", tick=0),
        said_by("b", at(12, 10, 3), name="b2", tick=1),
        said_by("b", at(20, 20, 3), name="b3", tick=1),
    )
    agreed = []
    for order in ([own, older, first, second], [second, own, first, older], [own, first]):
        board = new_board("a", name="x")
        for consensus in order:
            board.hear_consensus(consensus, 0.0)
        agreed.append(only(board.exchange(1, 0.0)))
    assert [u.source for u in agreed[0].used] == ["a", "b"]
    assert agreed[0] == agreed[1] == agreed[2]


def test_a_sub_team_is_left_out_once_all_its_boards_are_silent() -> None:
    board = new_board("a", name="x", max_age=5.0)
    for name, time in (("b1", 0.0), ("b2", 3.0)):
        board.hear_consensus(said_by("b", at(12, 10, 3), name=name).model_copy(update={"time": time}), time)
    board.hear_consensus(said_by("a", at(10, 10, 3), name="x").model_copy(update={"time": 6.0}), 6.0)
    assert only(board.exchange(1, 6.0)).left_out == []
    later = only(board.exchange(1, 9.0)).left_out
    assert [(left.source, left.reason) for left in later] == [("b", "silent for 6.0 s")]


def test_without_another_opinion_the_consensus_stands_after_the_exchange() -> None:
    a = new_board("a")
    a.hear(report("r1", at(10, 10, 2), informed=(at(10, 11, 1), {"r1": 0.0, "r2": 0.0})), 0.0)
    consensus = only(a.settle(0, 0.0))
    a.hear_consensus(consensus, 0.0)
    assert only(a.exchange(0, 0.0)).belief == consensus.belief


def test_an_exchange_ages_names_and_forgets_like_a_settlement() -> None:
    board = new_board("a", grid=FINE, drift=0.8, max_age=4.0)
    theirs = fine(10, 6, 0.9)
    board.hear_consensus(said_by("b", theirs, time=1.0, tick=3), 1.0)
    agreed = only(board.exchange(5, 3.25))
    assert (agreed.level, agreed.board, agreed.tick, agreed.time) == ("agreed", "board-a", 5, 3.25)
    same(agreed, blur(theirs.p, 0.8 * 1.5 / 0.5), abs=1e-9)
    assert agreed.ancestors == {"robot-b": 1.0}
    board.hear_consensus(said_by("c", theirs, time=5.5), 5.5)
    later = only(board.exchange(6, 5.5))
    assert [(left.source, left.reason) for left in later.left_out] == [("b", "silent for 4.5 s")]
    assert board.exchange(7, 10.0) == []


def test_one_subject_with_nothing_left_does_not_end_the_others() -> None:
    board = new_board("a", grid=FINE, max_age=4.0)
    for subject, time in (("object/a", 0.0), ("object/b", 3.0)):
        board.hear_consensus(said_by("b", fine(10, 6, 1), time=time).model_copy(update={"subject": subject}), time)
    assert [c.subject for c in board.exchange(0, 5.0)] == ["object/b"]


def test_the_exchange_multiplies_first_hand_parts_and_not_what_they_were_told() -> None:
    first = new_board("b", grid=FINE)
    own, informed = fine(10, 6, 2), fine(10.5, 6, 1)
    first.hear(report("r1", own, informed=(informed, {"r1": 0.0, "r2": 0.0})), 0.0)
    theirs = only(first.settle(0, 0.0))
    board = new_board("a", grid=FINE)
    board.hear_consensus(theirs, 0.0)
    board.hear_consensus(said_by("c", fine(10, 7, 2)), 0.0)
    used = only(board.exchange(0, 0.0)).used
    assert [(u.source, u.how) for u in used] == [("b", "independent"), ("c", "independent"), ("b", "overlapping")]
