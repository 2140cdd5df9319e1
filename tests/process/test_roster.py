"""Roster: who counts as there, for how long, and what a router that dies means."""

from __future__ import annotations

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
    it = Roster()
    assert (it.robots, it.boards, it.world) == ({}, {}, False)
    alive(it, R2, R1, BOARD, OTHER, WORLD)
    assert (it.robots, it.boards, it.world) == ({"a": ["r1", "r2"]}, {"a": ["w", "x"]}, True)
    assert it.tokens == {R1, R2, BOARD, OTHER, WORLD}
    assert it.changes_at() == math.inf


def test_what_is_no_token_of_a_team_is_ignored() -> None:
    it = Roster()
    assert alive(it, "cop/t/what/ever", "cop/t/a/member/*") == [False, False]
    assert (it.tokens, it.robots) == (set(), {})


def test_a_token_counts_until_its_grace_is_over() -> None:
    it = Roster(grace=1.0)
    assert alive(it, R1, BOARD) == [False, False]
    assert gone(it, R1, now=10.0) == [False]
    assert it.tokens == {BOARD}
    assert it.changes_at() == 11.0
    it.forget(10.9)
    assert it.robots == {"a": ["r1"]}
    assert not it.has_gone(R1)
    assert alive(it, R1, now=10.9) == [True]  # it came back in time
    gone(it, R1, now=12.0)
    it.forget(13.0)
    assert (it.robots, it.boards) == ({}, {"a": ["x"]})
    assert it.has_gone(R1)
    assert not it.has_gone(R2)  # was never seen
    assert alive(it, R1, now=14.0) == [False]
    assert not it.has_gone(R1)
    assert it.robots == {"a": ["r1"]}


def test_while_its_own_token_is_gone_nobody_is_forgotten() -> None:
    it = Roster(BOARD, grace=1.0, comeback=5.0)
    alive(it, BOARD, R1, R2, WORLD)
    gone(it, R1, WORLD, R2, now=10.0)
    assert not it.away
    gone(it, BOARD, now=10.5)
    assert it.away
    assert it.changes_at() == math.inf
    it.forget(100.0)
    assert (it.robots, it.world) == ({"a": ["r1", "r2"]}, True)
    assert alive(it, BOARD, now=100.0) == [False]
    assert not it.away
    assert it.changes_at() == 105.0
    assert alive(it, R1, now=104.0) == [True]
    it.forget(105.0)
    assert (it.robots, it.boards, it.world) == ({"a": ["r1"]}, {"a": ["x"]}, False)
    assert it.has_gone(R2)


def test_a_sub_team_that_lost_a_board_is_told_from_one_that_never_had_any() -> None:
    it = Roster(grace=1.0)
    alive(it, BOARD, OTHER)
    gone(it, BOARD, now=0.0)
    assert not it.has_lost_boards("a")  # it may come back
    it.forget(1.0)
    assert it.has_lost_boards("a")
    assert not it.has_lost_boards("b")
    assert it.boards == {"a": ["w"]}
    alive(it, BOARD, now=2.0)
    assert not it.has_lost_boards("a")


def test_the_first_sight_of_its_own_token_gives_no_time_to_anybody() -> None:
    it = Roster(BOARD, grace=1.0, comeback=5.0)
    alive(it, R1)
    gone(it, R1, now=1.0)
    alive(it, BOARD, now=1.5)
    assert it.changes_at() == 2.0


def test_those_who_have_gone_are_remembered_within_bounds() -> None:
    it = Roster(grace=1.0)
    tokens = [keys.MEMBER.key(team="t", sub_team="a", robot=f"r{i}") for i in range(MAX_GONE + 2)]
    for i, token in enumerate(tokens):
        alive(it, token, now=float(i))
        gone(it, token, now=float(i))
        it.forget(i + 1.0)
    assert [it.has_gone(token) for token in (*tokens[:3], tokens[-1])] == [False, False, True, True]
    assert it.robots == {}
