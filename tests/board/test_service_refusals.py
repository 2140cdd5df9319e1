"""What a board process refuses, and what it keeps until it can be judged: bad input changes nothing."""

import tracemalloc

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.process.intake import MAX_EARLY_BYTES
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, PackedBelief, Report
from blackboard.wire.raw import MAX_BYTES
from tests.board.desk import GRID, NOW, Desk, ball, clock, exchanging, levels, report, reported, settled, theirs
from tests.wire.envelopes import put


@pytest.mark.parametrize("name", ["x", "b2"])
def test_a_consensus_without_the_token_of_its_board_does_not_enter_the_exchange(name: str) -> None:
    """Neither that of a sub-team without a board, nor that of a stranger in a sub-team that has one."""
    sub_team = name[0]
    desk = exchanging()
    desk.tell(settled(sub_team, 0, "object/ball", name=name), theirs(sub_team, 0, name=name))
    said = desk.tell(settled("b", 0))
    assert levels(said) == ["agreed"]
    assert [u.source for u in decode(Consensus, said[0].payload).used] == ["a"]
    assert desk.status().refused == {"unregistered": 2}


def test_without_a_world_a_consensus_needs_a_token_as_well() -> None:
    desk = Desk("r1", world=False, period=0.5)
    desk.tell(report("r1", 7, time=NOW), theirs("x", 7, time=NOW), settled("x", 7, "object/ball"))
    desk.wait(0.6)
    agreed = [decode(Consensus, e.payload) for e in desk.said if "/agreed/" in e.key]
    assert agreed
    assert {u.source for consensus in agreed for u in consensus.used} == {"a"}
    assert desk.service.refused == {"unregistered": 2}


def test_an_empty_list_of_a_board_that_just_started_is_nothing_to_refuse() -> None:
    desk = Desk(world=False)
    desk.tell(settled("b", 7))
    assert desk.status().refused == {}


def test_what_is_refused_under_a_world_is_not_tried_again() -> None:
    desk = Desk("r1")
    desk.tell(clock(0, "r1"), report("r1", 50))  # stamped 10 s ahead
    desk.tell(clock(45, "r1"))  # now it would be 1 s ahead
    desk.register("r2")
    assert levels(desk.tell(reported("r1", 45))) == []
    assert desk.status().refused == {"future": 1}


def test_before_the_first_clock_nothing_large_is_kept_without_bounds() -> None:
    """Sixty reports of nearly 1 MiB: what is kept until the Clock comes is bounded in bytes, the newest per key."""
    desk = Desk()
    names = [f"r{i}" for i in range(60)]
    tracemalloc.start()
    for name in names:
        envelope = report(name, 0, size=MAX_BYTES - 2000)
        assert len(envelope.payload) > 900_000
        desk.tell(envelope)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 2 * MAX_EARLY_BYTES
    desk.tell(clock(0, *names))
    assert 40 < desk.status().counters["early_dropped"] < 60


def hostile() -> list[tuple[str, Envelope]]:
    """One envelope for each thing that can be wrong, by the reason it must be counted under."""
    good = report("r1", 0)
    key = good.key
    packed = pack(ball())
    grid = packed.grid

    def with_mass(value: float) -> Envelope:
        cells = np.full(GRID.shape, 1.0 / GRID.size, dtype="<f4")
        cells[3, 4] = value
        belief = PackedBelief(grid=grid, lo=(0, 0), box=GRID.shape, coding="f32", data=cells.tobytes())
        return put(Report(source="r1", subject="object/ball", tick=0, time=0.0, belief=belief))

    return [
        ("not-msgpack", Envelope(key, b"\xc1 not msgpack")),
        ("not-msgpack", Envelope(key, b"")),
        ("version", Envelope(key, good.payload.replace(b"\xa7version\x01", b"\xa7version\x02"))),
        ("fields", Envelope(key, b"\x81\xa7version\x01")),
        ("grid", report("r1", 0, gaussian(Grid((31, 20)), (3, 3), 1))),
        ("mass", with_mass(float("nan"))),
        ("mass", with_mass(-0.5)),
        ("mass", with_mass(float("inf"))),
        ("too-large", Envelope(key, bytes(64 * MAX_BYTES))),
        ("future", report("r1", 0, time=1e9)),
        ("past", report("r1", 0, time=-1e9)),
        ("impostor", Envelope(key.replace("/r1/", "/r2/"), good.payload)),
        ("wild-key", Envelope(key.replace("/r1/", "/*/"), good.payload)),
        ("unregistered", report("r9", 0)),
    ]


@pytest.mark.parametrize(("reason", "envelope"), hostile(), ids=lambda x: x if isinstance(x, str) else "")
def test_bad_input_is_counted_and_changes_nothing(reason: str, envelope: Envelope) -> None:
    calm, disturbed = Desk(), Desk()
    for desk in (calm, disturbed):
        desk.register("r1", "r2")
        desk.tell(clock(0, "r1", "r2"), report("r2", 0), reported("r2", 0, "object/ball"))
    disturbed.tell(envelope)
    end = report("r1", 0, ball(12)), reported("r1", 0, "object/ball")
    said = [[e for e in desk.tell(*end) if "/status/" not in e.key] for desk in (calm, disturbed)]
    assert said[0] == said[1]
    assert len(said[0]) == 2
    assert disturbed.status().refused == {reason: 1}
    assert calm.status().refused == {}
