"""When strangers flood, and to whom a link listens then."""

import pytest
import zenoh

from blackboard.board.service import BoardService
from blackboard.config import BoardSection, Scenario
from blackboard.net.bus import intersects
from blackboard.net.flood import CALM, FIRST, LONGEST, RATE, WINDOW, Flood, narrowed
from blackboard.wire import keys

NOW = 1_000_000.0
STEP = 2 * WINDOW
MANY = round(100 * RATE * STEP)  # in a step, they are a flood


def begun(at: float = NOW) -> Flood:
    """A flood that is on since `at`."""
    flood = Flood()
    assert not flood.look(at - STEP, 0)
    assert flood.look(at, MANY)
    return flood


def test_what_came_before_it_looked_first_is_no_flood() -> None:
    flood = Flood()
    assert not flood.look(NOW, MANY)
    assert not flood.look(NOW + STEP, MANY)
    assert (flood.on, flood.count) == (False, 0)


def test_who_sends_less_than_the_rate_does_not_flood() -> None:
    flood, sent = Flood(), 0
    for step in range(100):
        sent += round(0.9 * RATE * STEP)
        assert not flood.look(NOW + STEP * step, sent)


def test_a_burst_counts_over_a_window_at_least() -> None:
    flood = Flood()
    flood.look(NOW, 0)
    assert not flood.look(NOW + WINDOW / 2, MANY)
    assert not flood.look(NOW + 200 * STEP, MANY)


def test_it_lasts_for_a_pause_and_then_all_are_listened_to_again() -> None:
    flood = begun()
    assert not flood.look(NOW + FIRST - 0.01, MANY)
    assert flood.on
    assert flood.look(NOW + FIRST, MANY)
    assert (flood.on, flood.count) == (False, 1)


def test_a_flood_that_goes_on_is_the_same_one_and_its_pauses_grow() -> None:
    flood, at, sent, pauses = begun(), NOW, MANY, []
    for _ in range(6):
        began = at
        while flood.on:
            at += 0.5
            flood.look(at, sent)
        pauses.append(at - began)
        at, sent = at + STEP, sent + MANY
        assert flood.look(at, sent)
    assert pauses == [FIRST, 2 * FIRST, 4 * FIRST, 8 * FIRST, LONGEST, LONGEST]
    assert flood.count == 1


def test_after_a_calm_it_is_another_flood() -> None:
    flood = begun()
    flood.look(NOW + FIRST, MANY)
    later = NOW + FIRST + CALM + STEP
    flood.look(later - STEP, MANY)
    assert flood.look(later, 2 * MANY)
    assert flood.count == 2
    assert flood.look(later + FIRST, 2 * MANY)


def test_a_clock_that_is_set_back_shuts_nobody_out() -> None:
    flood = begun()
    assert flood.look(NOW - 3600.0, MANY)
    assert not flood.on


# --- to whom it listens --------------------------------------------------------------------------------------------------

TOKENS = ("cop/t/a/member/r1", "cop/t/b/member/r1", "cop/t/b/member/r2", "cop/t/a/board/x", "cop/t/world/alive")


@pytest.mark.parametrize("token", TOKENS)
@pytest.mark.parametrize("topic", keys.TOPICS, ids=lambda topic: topic.name)
def test_what_the_holder_of_a_token_writes_is_what_it_may_write_as_itself(token: str, topic: keys.Topic) -> None:
    """Held against `identities`, by which an inbox tells whose a message is."""
    if topic.message == "token" or topic is keys.READING:  # which name nobody who holds a token
        return
    role = "world" if token.endswith("alive") else "robot" if "/member/" in token else "board"
    for sub_team in "ab":
        for name in ("r1", "r2", "x", "y"):
            parts = dict.fromkeys(("robot", "source", "board", "process", "recorder"), name)
            key = topic.key(team="t", sub_team=sub_team, subject="object/ball", **parts)
            listened = any(intersects(expression, key) for expression in keys.written_by(token))
            mine = keys.writer(key) in keys.identities(token)
            assert listened == (mine and role in topic.writers), key


def test_a_board_hears_its_robots_and_other_boards_and_no_invented_names() -> None:
    board = BoardService(team="t", sub_team="a", board="x", grid=Scenario({}).grid, settings=BoardSection())
    expressions = narrowed(board.listens, TOKENS, zenoh.KeyExpr)
    assert expressions == {
        "cop/t/world/clock",
        "cop/t/a/report/r1/**",
        "cop/t/a/consensus/**",
        "cop/t/a/memory/x",
        "cop/t/a/status/r1",
        "cop/t/b/status/r1",
        "cop/t/b/status/r2",
        "cop/t/a/status/x",
    }


def test_who_looks_at_everything_hears_each_message_once() -> None:
    expressions = narrowed(["cop/t/**"], TOKENS, zenoh.KeyExpr)
    for key in ("cop/t/world/clock", "cop/t/score/solo/r1", "cop/t/b/report/r2/object/x", "cop/t/a/agreed/robot/r1"):
        assert sum(intersects(expression, key) for expression in expressions) == 1, key
    assert not any(intersects(expression, "cop/t/a/status/z") for expression in expressions)


def test_what_is_narrow_already_stays() -> None:
    listens = ["cop/t/world/clock", "cop/*/*/agreed/object/ball"]
    assert narrowed(listens, TOKENS, zenoh.KeyExpr) == set(listens)


def test_nobody_without_a_token_is_left() -> None:
    assert narrowed(["cop/t/a/report/*/**"], ["cop/t/a/board/x"], zenoh.KeyExpr) == frozenset()
