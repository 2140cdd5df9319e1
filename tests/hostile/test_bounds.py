"""Memory and work that one source can cause are bounded, and what it takes is not what others need."""

from contextlib import suppress
from typing import Any

import msgpack
import pytest

from blackboard.board.board import Board
from blackboard.board.entries import Entries, Entry
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.judge.traffic import Traffic
from blackboard.opinion.belief import gaussian
from blackboard.opinion.believed import MAX_SOURCES, MAX_SUBJECTS
from blackboard.opinion.grid import Grid
from blackboard.process.roster import MAX_TOKENS, Roster
from blackboard.wire import keys
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import Informed, Report, Status
from blackboard.wire.raw import MAX_BYTES, MAX_TOTAL
from blackboard.wire.types import MAX_OPINIONS, capped
from tests.board.desk import Desk, clock, report
from tests.board.reports import at, new_board, only
from tests.holdings import grown, holdings
from tests.wire.envelopes import put, token, world

TINY = Grid((3,))
NO_ENTRY = Entry(0, 0.0, ())


def test_a_megabyte_of_empty_lists_is_refused_before_all_of_it_is_read() -> None:
    payload = msgpack.packb({"version": 1, "x": [[[]] * 1023] * 1000})
    assert 900_000 < len(payload) < MAX_BYTES
    with pytest.raises(Refused, match=f"not-msgpack: more than {MAX_TOTAL} items"):
        decode(Status, payload)


def test_a_belief_on_a_wrong_grid_is_refused_before_it_is_inflated() -> None:
    """Else it would be refused as one whose data cannot be inflated."""
    packed = pack(gaussian(Grid((1024, 1024)), (3, 3), 1.0))
    broken = packed.model_copy(update={"data": b"nothing that can be inflated"})
    for grid, reason in ((Grid((1024, 1024)), "fields"), (Grid((30, 20)), "grid")):
        with pytest.raises(Refused, match=f"^{reason}"):
            unpack(broken, grid)


@pytest.mark.parametrize("world", [True, False])
def test_statuses_of_invented_robots_and_boards_leave_nothing_behind(world: bool) -> None:
    desk = Desk(world=world)
    desk.register("r1")
    if world:
        desk.tell(clock(0, "r1", b=["r4"]))
    before = holdings(desk.service.reception, "reception")
    for i in range(1200):
        kind = ("robot", "board")[i % 2]
        subjects = [] if i % 3 else [f"object/o{j}" for j in range(20)]
        phase: Any = "reported" if kind == "robot" else "consensus"
        said = Status(process=f"x{i}", kind=kind, tick=0, time=0.0, phase=phase, subjects=subjects)  # type: ignore[arg-type]
        sub_team = "a" if kind == "robot" else f"z{i}"
        desk.tell(put(said, sub_team=sub_team))
    held = grown(before, holdings(desk.service.reception, "reception"))
    assert {path for path in held if "intake" not in path} == set()


def test_a_status_of_nearly_a_megabyte_is_refused() -> None:
    fields = {"version": 1, "process": "x", "kind": "robot", "tick": 1, "time": 0.0}
    for more in (
        {"settings": {f"{i}": "x" * 900 for i in range(1000)}},
        {"counters": {"x" * 900 + str(i): i for i in range(900)}},
    ):
        with pytest.raises(Refused, match="fields"):
            decode(Status, msgpack.packb({**fields, **more}))


def test_the_world_keeps_only_what_it_sums_up() -> None:
    held = []
    for subjects in ([], [f"object/o{i}" for i in range(200)]):
        traffic = Traffic()
        traffic.hear_status(
            "a", Status(process="r1", kind="robot", tick=1, time=0.0, counters={"sent": 3}, subjects=subjects)
        )
        assert traffic.counters({}) == {"sent": 3}
        held.append(holdings(traffic, "traffic"))
    assert held[0] == held[1]


def test_invented_tokens_are_bounded_and_the_world_s_is_still_seen() -> None:
    own = token(keys.BOARD, "a")
    roster = Roster(own.key)
    for i in range(MAX_TOKENS + 100):
        roster.hear_token(token(keys.MEMBER, "x", sub_team=f"z{i}"), 0.0)
    assert len(roster.tokens) == max(holdings(roster, "roster").values()) == MAX_TOKENS
    roster.hear_token(world(), 0.0)
    roster.hear_token(own, 0.0)
    assert roster.world
    assert own.key in roster.tokens


# --- room for the sub-team's own ------------------------------------------------------------------------------------------


def test_who_invents_subjects_loses_its_own() -> None:
    entries: Entries[str] = Entries(TINY.size)
    for i in range(MAX_SUBJECTS):
        entries.keep(f"object/x{i:03}", "liar", NO_ENTRY)
    with pytest.raises(Refused, match="too-many"):
        entries.keep("object/one-more", "liar", NO_ENTRY)
    for robot in ("r1", "r2"):
        for subject in (f"robot/{robot}", "object/ball", f"object/{robot}"):
            entries.keep(subject, robot, NO_ENTRY)
    assert {"robot/r1", "robot/r2", "object/ball", "object/r1", "object/r2"} <= set(entries)
    assert len(list(entries)) == MAX_SUBJECTS


def test_what_a_robot_says_of_itself_has_room_among_as_many_sources_as_there_may_be() -> None:
    entries: Entries[str] = Entries(TINY.size)
    for i in range(MAX_SOURCES):
        entries.keep("robot/r1", f"x{i}", NO_ENTRY)
    entries.keep("robot/r1", "r1", NO_ENTRY)
    assert "r1" in entries.usable("robot/r1", 0.0, 1.0)[0]
    assert len(entries.usable("robot/r1", 0.0, 1.0)[0]) == MAX_SOURCES


def test_a_board_s_own_has_room_whatever_other_boards_say() -> None:
    own = ("a", "a")
    entries: Entries[tuple[str, str]] = Entries(TINY.size, own)
    for i in range(MAX_SUBJECTS):
        entries.keep(f"object/x{i}", ("b", "b"), NO_ENTRY)
    for i in range(MAX_SUBJECTS):
        entries.keep(f"object/own{i}", own, NO_ENTRY)
    assert all(own in entries.usable(subject, 0.0, 1.0)[0] for subject in entries)
    with pytest.raises(Refused):
        entries.keep("object/x", ("b", "b"), NO_ENTRY)


def test_all_entries_together_are_bounded_by_the_size_of_a_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blackboard.board.entries.MAX_HELD", 16 * TINY.size * 300)
    entries: Entries[str] = Entries(TINY.size)
    for i in range(200):
        entries.keep(f"object/x{i}", "r1", NO_ENTRY)
    for i in range(200):
        with suppress(Refused):
            entries.keep(f"object/x{i}", "r2", NO_ENTRY)
    sources = [source for subject in entries for source in entries.usable(subject, 0.0, 1.0)[0]]
    assert len(sources) == 300
    assert sources.count("r1") == pytest.approx(150, abs=1)


def test_a_board_takes_no_word_for_whose_information_a_report_is() -> None:
    """Ancestors that leave out the source, or name everybody, change nothing of what is multiplied."""
    settled = []
    for belief, informed in (
        ({}, {"r1": 0.0, "r2": 0.0}),
        ({"x": 0.0}, {"r2": 0.0}),
        ({f"x{i}": 0.0 for i in range(256)}, {"r2": 0.0}),
    ):
        board = new_board()
        for robot, x in (("r1", 10.0), ("r2", 11.0)):
            said = Report(
                source=robot, subject="object/ball", tick=0, time=0.0, belief=pack(at(x, 10, 2)), ancestors=belief
            )
            more = Informed(belief=pack(at(10, 10, 1)), ancestors=informed)
            board.hear(said.model_copy(update={"informed": more} if robot == "r1" else {}), 0.0)
        consensus = only(board.settle(0, 0.0))
        settled.append((consensus.belief, consensus.ancestors))
    assert settled[0] == settled[1] == settled[2]
    assert settled[0][1].keys() == {"r1", "r2"}


def test_too_many_ancestors_are_cut_with_room_for_the_sub_team_s_own() -> None:
    board = Board("a", "a", TINY, BoardSection())
    packed = pack(gaussian(TINY, (1,), 1.0))
    for robot, names in (("z1", [f"a{i}" for i in range(256)]), ("z2", [f"b{i}" for i in range(256)])):
        informed = Informed(belief=packed, ancestors=dict.fromkeys(names, 0.0))
        board.hear(Report(source=robot, subject="object/ball", tick=0, time=0.0, belief=packed, informed=informed), 0.0)
    consensus = only(board.settle(0, 0.0))
    assert len(consensus.ancestors) <= MAX_OPINIONS
    assert {"z1", "z2"} <= consensus.ancestors.keys()
    assert capped({"a": 1.0}, lambda: pytest.fail("it is not asked where there is room")) == {"a": 1.0}


def test_a_robot_s_list_counts_only_with_its_token() -> None:
    desk = Desk()
    desk.register("r1")
    desk.tell(clock(0, "r1"), report("r1", 0))
    said = Status(process="r9", kind="robot", tick=0, time=0.0, phase="reported", subjects=["object/ball"])
    desk.tell(put(said))
    assert desk.status().refused == {"unregistered": 1}
