"""Roster: who counts as there, for how long, and what a router that dies means."""

import math

from blackboard.process.roster import MAX_GONE, Roster
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

R1 = keys.MEMBER.key(team="t", sub_team="a", robot="r1")
R2 = keys.MEMBER.key(team="t", sub_team="a", robot="r2")
BOARD = keys.BOARD.key(team="t", sub_team="a", board="x")
OTHER = keys.BOARD.key(team="t", sub_team="a", board="w")
WORLD = keys.WORLD.key(team="t")


def alive(roster: Roster, *tokens: str, now: float = 0.0) -> list[bool]:
    return [roster.hear_token(Envelope(token, kind=Kind.ALIVE), now) for token in tokens]


def gone(roster: Roster, *tokens: str, now: float) -> list[bool]:
    return [roster.hear_token(Envelope(token, kind=Kind.GONE), now) for token in tokens]


def test_tokens_tell_who_is_there() -> None:
    roster = Roster()
    assert (roster.robots, roster.boards, roster.world) == ({}, {}, False)
    alive(roster, R2, R1, BOARD, OTHER, WORLD)
    assert (roster.robots, roster.boards, roster.world) == ({"a": ["r1", "r2"]}, {"a": ["w", "x"]}, True)
    assert roster.tokens == {R1, R2, BOARD, OTHER, WORLD}
    assert roster.changes_at() == math.inf


def test_a_board_whose_token_comes_again_has_arrived_again() -> None:
    roster = Roster()
    alive(roster, R1, BOARD, BOARD, OTHER)
    assert roster.arrivals == 2
    gone(roster, BOARD, now=1.0)
    alive(roster, BOARD, now=1.1)
    assert roster.arrivals == 3


def test_what_is_no_token_of_a_team_is_ignored() -> None:
    roster = Roster()
    assert alive(roster, "cop/t/what/ever", "cop/t/a/member/*") == [False, False]
    assert (roster.tokens, roster.robots) == (set(), {})


def test_a_token_counts_until_its_grace_is_over() -> None:
    roster = Roster(grace=1.0)
    assert alive(roster, R1, BOARD) == [False, False]
    assert gone(roster, R1, now=10.0) == [False]
    assert roster.tokens == {BOARD}
    assert roster.changes_at() == 11.0
    roster.forget(10.9)
    assert roster.robots == {"a": ["r1"]}
    assert not roster.has_gone(R1)
    assert alive(roster, R1, now=10.9) == [True]  # it came back in time
    gone(roster, R1, now=12.0)
    roster.forget(13.0)
    assert (roster.robots, roster.boards) == ({}, {"a": ["x"]})
    assert roster.has_gone(R1)
    assert not roster.has_gone(R2)  # was never seen
    assert alive(roster, R1, now=14.0) == [False]
    assert not roster.has_gone(R1)
    assert roster.robots == {"a": ["r1"]}


def test_while_its_own_token_is_gone_nobody_is_forgotten() -> None:
    roster = Roster(BOARD, grace=1.0, comeback=5.0)
    alive(roster, BOARD, R1, R2, WORLD)
    gone(roster, R1, WORLD, R2, now=10.0)
    assert not roster.away
    gone(roster, BOARD, now=10.5)
    assert roster.away
    assert roster.changes_at() == math.inf
    roster.forget(100.0)
    assert (roster.robots, roster.world) == ({"a": ["r1", "r2"]}, True)
    assert alive(roster, BOARD, now=100.0) == [False]
    assert not roster.away
    assert roster.changes_at() == 105.0
    assert alive(roster, R1, now=104.0) == [True]
    roster.forget(105.0)
    assert (roster.robots, roster.boards, roster.world) == ({"a": ["r1"]}, {"a": ["x"]}, False)
    assert roster.has_gone(R2)


def test_a_sub_team_that_lost_a_board_is_told_from_one_that_never_had_any() -> None:
    roster = Roster(grace=1.0)
    alive(roster, BOARD, OTHER)
    gone(roster, BOARD, now=0.0)
    assert not roster.has_lost_boards("a")  # it may come back
    roster.forget(1.0)
    assert roster.has_lost_boards("a")
    assert not roster.has_lost_boards("b")
    assert roster.boards == {"a": ["w"]}
    alive(roster, BOARD, now=2.0)
    assert not roster.has_lost_boards("a")


def test_the_first_sight_of_its_own_token_gives_no_time_to_anybody() -> None:
    roster = Roster(BOARD, grace=1.0, comeback=5.0)
    alive(roster, R1)
    gone(roster, R1, now=1.0)
    alive(roster, BOARD, now=1.5)
    assert roster.changes_at() == 2.0


def test_those_who_have_gone_are_remembered_within_bounds() -> None:
    roster = Roster(grace=1.0)
    tokens = [keys.MEMBER.key(team="t", sub_team="a", robot=f"r{i}") for i in range(MAX_GONE + 2)]
    for i, token in enumerate(tokens):
        alive(roster, token, now=float(i))
        gone(roster, token, now=float(i))
        roster.forget(i + 1.0)
    assert [roster.has_gone(token) for token in (*tokens[:3], tokens[-1])] == [False, False, True, True]
    assert roster.robots == {}
