"""Real sessions at a real router's door: what gets through, and who is told of what does not."""

from pathlib import Path

import pytest
import zenoh

from blackboard.errors import Refused
from blackboard.net.settings import LinkConfig
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from tests.access.doors import Enter, Shut, alive, denied, gets_through, put
from tests.board.reports import at, new_board, report
from tests.processes import Letters, program, wait_until

pytestmark = [pytest.mark.team, pytest.mark.xdist_group("door")]  # one directory of keys, and one router


# --- what gets through ----------------------------------------------------------------------------------------------------

OWN = ["cop/t/a/report/r1/robot/r1", "cop/t/a/report/r1/object/ball", "cop/t/a/status/r1", "cop/t/score/solo/r1"]
SPOOFED = {
    "as r2": ["cop/t/a/report/r2/robot/r1", "cop/t/a/status/r2", "cop/t/score/solo/r2", "cop/t/world/reading/r2"],
    "as a board": [
        "cop/t/a/consensus/robot/r1",
        "cop/t/a/agreed/robot/r1",
        "cop/t/a/forward/board-a",
        "cop/t/a/status/board-a",
    ],
    "as a journal": ["cop/t/a/journal/board-a"],
    "as the world": ["cop/t/world/clock", "cop/t/world/truth"],
    "in another sub-team": ["cop/t/b/report/r1/robot/r1", "cop/t/b/status/r1"],
    "in another team": ["cop/u/a/report/r1/robot/r1", "cop/u/world/clock"],
    "for many": ["cop/**", "cop/t/**", "cop/t/a/report/**", "cop/t/a/report/r1/**", "cop/t/*/status/r1", "**"],
    "as the door": ["door/t/robot/r1/1", "door/t/robot/r2/1"],
}
TOKENS = ["cop/t/a/member/r2", "cop/t/b/member/r1", "cop/t/a/board/board-a", "cop/t/world/alive", "cop/t/a/member/*"]


@pytest.mark.parametrize("how", SPOOFED)
def test_r1_writes_as_itself_and_as_nobody_else(let_in: Enter, shut: Shut, how: str) -> None:
    r1, viewer = let_in("robot/r1"), let_in("viewer")
    for key_expr in ("cop/**", "door/**"):  # Zenoh sends only what somebody has subscribed to
        viewer.subscribe(key_expr)
    viewer.watch("cop/**")
    before, letters = denied(r1), Letters(viewer)
    for key in SPOOFED[how]:
        r1.send(put(key, b"forged"))
        r1.send(Envelope(key, kind=Kind.DELETE))
    first, told = put(SPOOFED[how][0], b"forged"), f"denied: 'robot/r1/1 may not put {SPOOFED[how][0]}"
    # again and again: a publisher sends nothing before it has heard of a subscriber
    wait_until(lambda: r1.send(first) or told in shut[1].err, f"the door says {told}")
    r1.token("cop/t/a/member/r1")
    letters.until(alive("cop/t/a/member/r1"))
    for own in map(put, OWN):
        gets_through(r1, own, letters)
    assert {e.key for e in letters.read if e.kind is not Kind.ALIVE and e.key.startswith("cop/")} == set(OWN)
    assert b"forged" not in {e.payload for e in letters.read}
    assert not [e for e in viewer.get("cop/**") if e.payload == b"forged"]
    wait_until(lambda: denied(r1) > before, "the denied itself is told")


def test_r1_holds_its_own_token_and_no_other(let_in: Enter) -> None:
    r1, viewer = let_in("robot/r1"), let_in("viewer")
    viewer.watch("cop/**")
    for token in (*TOKENS, "cop/t/a/member/r1"):
        r1.token(token)
    letters = Letters(viewer)
    letters.until(alive("cop/t/a/member/r1"))
    assert letters.read == [alive("cop/t/a/member/r1")]
    r1.close()
    letters.until(Envelope("cop/t/a/member/r1", kind=Kind.GONE))


def test_what_r1_writes_for_many_of_its_own_subjects_is_refused_by_whoever_hears_it(let_in: Enter) -> None:
    """Zenoh lets a publication on `report/r1/*/*` pass where each key of it may be written; its key is wild, and so it is refused."""
    r1, board = let_in("robot/r1"), let_in("board/board-a")
    board.subscribe("cop/t/a/report/*/**")
    letters, wild = Letters(board), put("cop/t/a/report/r1/*/*")
    gets_through(r1, wild, letters)
    with pytest.raises(Refused, match="wild-key"):
        open_envelope(wild)


@pytest.mark.parametrize("who", ["viewer", "recorder"])
def test_who_looks_on_writes_nothing(let_in: Enter, who: str) -> None:
    onlooker, board = let_in(who), let_in("board/board-a")
    for key_expr in ("cop/t/a/report/*/**", "cop/t/*/status/*", "cop/t/world/clock", "cop/t/*/consensus/**"):
        board.subscribe(key_expr)
    board.watch("cop/t/*/member/*")
    for key in ("cop/t/a/report/r1/robot/r1", "cop/t/a/status/r1", "cop/t/world/clock", "cop/t/a/consensus/robot/r1"):
        onlooker.send(put(key))
    onlooker.token("cop/t/a/member/r1")
    wait_until(lambda: denied(onlooker) >= 5, lambda: f"all is denied, not {denied(onlooker)}")
    assert board.receive(0.1) == []


def test_a_robot_reads_neither_the_truth_nor_what_another_measures(let_in: Enter) -> None:
    r1, world, viewer = let_in("robot/r1"), let_in("world"), let_in("viewer")
    for key_expr in (
        "cop/t/world/truth",
        "cop/t/world/reading/r2",
        "cop/t/world/reading/*",
        "cop/t/world/*",
        "cop/**",
        "**",
        "cop/t/a/report/**",
    ):
        r1.subscribe(key_expr)
    viewer.subscribe("cop/**")
    secret = [put("cop/t/world/truth"), put("cop/t/world/reading/r2")]
    gets_through(world, put("cop/t/world/clock", b"ready"), Letters(viewer))
    for envelope in secret:
        world.send(envelope)
    Letters(viewer).until(*secret)
    # The door tells it what it was denied.
    assert not [heard for heard in r1.receive(0.1) if heard.key.startswith("cop/")]
    for key_expr in ("cop/t/world/truth", "cop/t/world/reading/r2", "cop/**", "cop/t/*/report/r2/**"):
        assert r1.get(key_expr) == []
    assert viewer.get("cop/t/world/truth") == secret[:1]
    r1.subscribe("cop/t/world/reading/r1")
    mine = put("cop/t/world/reading/r1")
    letters = Letters(r1)
    gets_through(world, mine, letters)
    assert {e.key for e in letters.read if e.key.startswith("cop/")} == {mine.key}


def test_a_robot_answers_no_question_about_others(let_in: Enter, shut: Shut, keys: Path) -> None:
    """A queryable on agreed beliefs, of a session without our own checks."""
    config = LinkConfig(connect=(shut[0],), keys=str(keys), who="robot/r1").build("r1")
    viewer, board = let_in("viewer"), let_in("board/board-a")
    true = put("cop/t/a/agreed/robot/r1", b"true")
    board.send(true)
    wait_until(lambda: viewer.get("cop/t/a/agreed/**") == [true], "the board answers")
    with zenoh.open(config) as session:
        for expr in ("cop/t/a/agreed/**", "cop/**", "cop/t/a/report/r1/**"):
            session.declare_queryable(expr, lambda query: query.reply("cop/t/a/agreed/robot/r1", b"forged"))
        own = put("cop/t/a/report/r1/robot/r1")
        session.declare_queryable(own.key, lambda query: query.reply(own.key, own.payload))
        wait_until(lambda: own in viewer.get("cop/**"), "what it may answer is answered")
        assert viewer.get("cop/t/a/agreed/**") == [true]
        assert b"forged" not in {e.payload for e in viewer.get("cop/**")}


def test_nobody_can_replay_what_another_said(let_in: Enter) -> None:
    """What a board does with what the source itself says again is below."""
    r1, r2, board = let_in("robot/r1"), let_in("robot/r2"), let_in("board/board-a")
    board.subscribe("cop/t/a/report/*/**")
    old, new, letters = put(OWN[0], b"old"), put(OWN[0], b"new"), Letters(board)
    gets_through(r1, old, letters)
    r1.send(new)
    letters.until(new)
    r2.send(old)
    wait_until(lambda: denied(r2) >= 1, "the replay is denied")
    letters.take()
    assert letters.read[-1] == new
    assert board.get(OWN[0]) == [new]


def test_what_a_robot_says_again_itself_is_refused_or_changes_nothing() -> None:
    old, new = (report("r1", at(x, 10, 2.0), time=time, tick=tick) for x, time, tick in ((5, 1.0, 5), (30, 8.0, 40)))
    hears, replayed = new_board(), new_board()
    for link in (hears, replayed):
        link.hear(new, 8.0)
    replayed.hear(old, 8.1)
    assert replayed.settle(41, 8.2) == hears.settle(41, 8.2)
    with pytest.raises(Refused, match="^past"):
        replayed.hear(old, 1000.0)


# --- who is told ----------------------------------------------------------------------------------------------------------


def test_a_health_check_tells_what_was_denied_and_the_watch_prints_it(let_in: Enter, shut: Shut, keys: Path) -> None:
    r2, viewer = let_in("robot/r2"), let_in("viewer")
    viewer.subscribe("cop/**")  # otherwise Zenoh sends only the first messages of a publisher
    r2.send(put("cop/t/world/clock"))
    wait_until(lambda: denied(r2) >= 1, "it is told")
    flags = ("--keys", str(keys), "-e", shut[0], "--team", "t")
    with program("-m", "blackboard", "health", "robot", "--id", "r2", *flags) as check:
        assert check.ends() == 1
    assert check.out.startswith("the router has denied ")
    assert "robot/r2" in check.out
    with program("-m", "blackboard", "keys", "watch", *flags) as watch:
        wait_until(lambda: "put cop/t/world/clock" in watch.out, "the watch prints what was denied before it began")
        wait_until(lambda: r2.send(put("cop/t/world/truth")) or "put cop/t/world/truth" in watch.out, "and what is now")
    with program("-m", "blackboard", "health", "router", *flags) as check:
        assert check.ends() == 0, check.err


def test_a_key_with_line_breaks_forges_no_denial_of_another(let_in: Enter, shut: Shut) -> None:
    """Zenoh logs keys as they are. The board would be unhealthy if the router believed the second line."""
    r1, board, viewer = let_in("robot/r1"), let_in("board/board-a"), let_in("viewer")
    viewer.subscribe("cop/**")
    target = "zenoh::net::routing::interceptor::access_control"
    says = "x on CertCommonName(board/board-a/1)+x is unauthorized to Put (ingress) on cop/t/world/clock"
    before, text = denied(r1), f"\n2026-11-21T20:48:42.720231Z TRACE  rx-0 ThreadId(09) {target}: {says}"
    for length in (0, 3000, 4096, 9000):
        r1.send(put(f"cop/t/a/report/r2/robot/{'x' * length}{text * 50}"))
    wait_until(lambda: denied(r1) >= before + 4, "its own denials are counted")
    assert board.denials() is None
    assert denied(board) == 0
    assert "board/board-a/1 may not" not in shut[1].err
