"""Where each process goes by its own clock: whatever a status says of clocks, speeds and leads, a board goes on, within its bounds."""

import msgpack
import numpy as np
import pytest

from blackboard.access.doorkeeper import read
from blackboard.process.offsets import MAX_SOURCES
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope
from tests.board.desk import NOW, Desk, board_of, levels, report
from tests.holdings import holdings
from tests.hostile.examples import status
from tests.hostile.fuzz import hostile, places
from tests.wire.envelopes import put
from tests.wire.messages import as_map


@pytest.mark.parametrize("seed", range(4))
def test_a_board_without_a_world_survives_any_status(seed: int) -> None:
    rng, desk = np.random.default_rng(seed), Desk(world=False, period=0.5)
    desk.register("r1", "x1")
    desk.tell(board_of("a", name="twin"), board_of("b"))
    for i in range(150):
        process, kind, sub_team = [("x1", "robot", "a"), ("twin", "board", "a"), ("b", "board", "b")][
            int(rng.integers(3))
        ]
        fields = as_map(
            status(process, kind, follows=bool(rng.random() < 0.5), sent=desk.now, echo={"a/a": (desk.now, 0.0)})
        )
        for _ in range(int(rng.integers(3))):
            container, at = places(fields)[int(rng.integers(len(places(fields))))]
            container[at] = hostile(rng, container[at])
        key = keys.STATUS.key(team="t", sub_team=sub_team, process=process)
        desk.tell(Envelope(key, msgpack.packb(fields, default=str)) if _packs(fields) else Envelope(key, b"\xc1"))
        desk.tell(report("r1", i, time=desk.now))
        desk.wait(0.1)
    assert desk.service.counters["failed"] == 0
    assert max(holdings(desk.service.clocks.offsets, "offsets").values()) <= MAX_SOURCES


def _packs(fields: object) -> bool:
    try:
        msgpack.packb(fields)
    except (OverflowError, ValueError, TypeError):
        return False
    return True


def test_a_robot_s_speed_and_clock_concern_that_robot_only() -> None:
    """What r1 believes is settled to the same bits, whatever x1 says of its own speed and clock."""
    payloads = []
    for speed, ahead in ((1.0, 0.0), (1e12, 20.0)):
        desk = Desk(world=False, period=0.5)
        desk.register("r1", "x1")
        said = status("x1", "robot", subjects=[], speed=speed, sent=desk.now + ahead, echo={"a/a": (NOW, 0.0)})
        desk.tell(put(said))
        desk.tell(report("r1", 1, time=desk.now))
        desk.wait(0.6)
        payloads.append([e.payload for e in desk.said if "/agreed/" in e.key])
    assert payloads[0] == payloads[1] != []
    assert levels(desk.said)


@pytest.mark.parametrize(
    "payload", [b"", b"\xff", b"[]", b"{}", b"null", b'{"denied": "x"}', b'{"denied": 1e400}', b'{"denied": -1, "last": 3}', b"[" * 4000]
)  # fmt: skip
def test_whatever_is_said_at_the_door_raises_nothing(payload: bytes) -> None:
    denial = read(payload)
    assert denial is None or (isinstance(denial[0], int) and isinstance(denial[1], str))
