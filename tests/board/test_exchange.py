"""The exchange between the boards of sub-teams: the agreed belief, and what is not counted twice in it."""

from __future__ import annotations

import pytest

from blackboard.board.board import Board
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief
from blackboard.wire.messages import Consensus
from tests.board.reports import GRID, at, only, report


def exchanged(*sub_teams: Board, tick: int = 0, now: float = 0.0) -> dict[str, Consensus]:
    """Settle and exchange between boards that know one subject; the agreed belief of each."""
    said = [c for b in sub_teams for c in b.settle(tick, now)]
    for b in sub_teams:
        for consensus in said:
            b.hear_consensus(consensus, now)
    return {b.sub_team: only(b.exchange(tick, now)) for b in sub_teams}


def test_after_the_exchange_all_sub_teams_hold_the_same_belief() -> None:
    settings = BoardSection.model_validate({"independence": 1.0})
    a, b = Board("a", "a", GRID, settings), Board("b", "b", GRID, settings)
    a.hear(report("r1", at(10, 10, 3)), 0.0)
    a.hear(report("r2", at(12, 10, 3)), 0.0)
    b.hear(report("r4", at(11, 12, 2)), 0.0)
    agreed = exchanged(a, b)
    assert agreed["a"].belief == agreed["b"].belief
    assert agreed["a"].ancestors == {"r1": 0.0, "r2": 0.0, "r4": 0.0}
    assert agreed["a"].entropy < min(c.entropy for c in a.settle(0, 0.0) + b.settle(0, 0.0))


def test_a_robot_in_two_sub_teams_is_not_counted_twice() -> None:
    """Both consensuses rest on r1 alone: the exchange must not multiply them."""
    a, b = Board("a", "a", GRID, BoardSection()), Board("b", "b", GRID, BoardSection())
    for it in (a, b):
        it.hear(report("r1", at(10, 10, 2)), 0.0)
    alone = only(a.settle(0, 0.0)).entropy
    assert exchanged(a, b)["a"].entropy == pytest.approx(alone, abs=0.02)


def said_by(name: str, sub_team: str, belief: Belief, tick: int = 0) -> Consensus:
    """The consensus of one board on the ball, from one robot of its sub-team."""
    it = Board(sub_team, name, GRID, BoardSection())
    it.hear(report(f"robot-of-{sub_team}", belief, tick=tick), 0.0)
    return only(it.settle(tick, 0.0))


def test_two_boards_of_one_sub_team_are_one_opinion_whoever_is_heard_first() -> None:
    """The newest tick counts, then the name that sorts first; with one board each nothing is chosen."""
    own = said_by("x", "a", at(10, 10, 3))
    older, first, second = (
        said_by("b1", "b", at(5, 5, 3), tick=0),
        said_by("b2", "b", at(12, 10, 3), tick=1),
        said_by("b3", "b", at(20, 20, 3), tick=1),
    )
    found = []
    for order in ([own, older, first, second], [second, own, first, older], [own, first]):
        it = Board("a", "x", GRID, BoardSection())
        for consensus in order:
            it.hear_consensus(consensus, 0.0)
        found.append(only(it.exchange(1, 0.0)))
    assert [u.source for u in found[0].used] == ["a", "b"]
    assert found[0] == found[1] == found[2]


def test_a_sub_team_is_left_out_once_all_its_boards_are_silent() -> None:
    it = Board("a", "x", GRID, BoardSection(max_age=5.0))
    for name, time in (("b1", 0.0), ("b2", 3.0)):
        it.hear_consensus(said_by(name, "b", at(12, 10, 3)).model_copy(update={"time": time}), time)
    it.hear_consensus(said_by("x", "a", at(10, 10, 3)).model_copy(update={"time": 6.0}), 6.0)
    assert only(it.exchange(1, 6.0)).left_out == []
    later = only(it.exchange(1, 9.0)).left_out
    assert [(one.source, one.reason) for one in later] == [("b", "silent for 6.0 s")]


def test_without_another_opinion_the_consensus_stands_after_the_exchange() -> None:
    a = Board("a", "a", GRID, BoardSection())
    a.hear(report("r1", at(10, 10, 2), informed=(at(10, 11, 1), {"r1": 0.0, "r2": 0.0})), 0.0)
    consensus = only(a.settle(0, 0.0))
    a.hear_consensus(consensus, 0.0)
    assert only(a.exchange(0, 0.0)).belief == consensus.belief
