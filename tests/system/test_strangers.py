"""Somebody else's robot, written from docs/wire.md alone, and a hostile client, against a real board."""

from collections.abc import Callable, Iterator

import pytest

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Consensus, Status
from blackboard.wire.raw import MAX_BYTES
from tests.files import ROOT
from tests.processes import program, wait_until


@pytest.fixture
def desk(endpoint: str) -> Iterator[str]:
    """Where the board of sub-team a is to be reached."""
    with program(
        "-m", "blackboard", "serve", "--team", "t", "--sub-team", "a", "--id", "desk", "-e", endpoint
    ) as board:
        board.says("ready")
        yield endpoint


def test_a_robot_from_the_wire_document_alone_is_understood(desk: str, connect: Callable[[str], Link]) -> None:
    link, consensuses = connect("watcher"), list[Consensus]()
    link.subscribe("cop/t/a/agreed/**")
    example = str(ROOT / "examples" / "minimal_robot.py")
    about = ("--team", "t", "--sub-team", "a", "--id", "guest", "--at", "12", "20", "--seconds", "60")
    with program(example, "-e", desk, *about) as robot:

        def heard() -> bool:
            consensuses.extend(decode(Consensus, e.payload) for e in link.receive(0.1))
            return {"robot/guest", "object/ball"} <= {c.subject for c in consensuses}

        wait_until(heard, "the board agrees on what the guest reported")
        place = next(c for c in consensuses if c.subject == "robot/guest")
        assert place.ancestors.keys() == {"guest"}
        late = link.get("cop/t/a/agreed/robot/guest")
        assert [e.key for e in late] == ["cop/t/a/agreed/robot/guest"]
        wait_until(lambda: "robot/guest" in robot.out, "it prints what is agreed")


def test_a_hostile_client_is_counted_and_the_board_lives(desk: str) -> None:
    with Link(LinkConfig(connect=(desk,)), "attacker") as link:
        link.subscribe("cop/t/a/status/desk")
        key = "cop/t/a/report/r1/object/ball"
        statuses: list[Status] = []

        def refused() -> dict[str, int]:
            statuses.extend(decode(Status, e.payload) for e in link.receive(0.1))
            return statuses[-1].refused if statuses else {}

        wait_until(lambda: bool(refused()) or bool(statuses), "the board is alive")
        bad = {
            "not-msgpack": b"\xc1",
            "version": b"\x81\xa7version\x09",
            "fields": b"\x81\xa7version\x01",
            "too-large": bytes(64 * MAX_BYTES),
        }
        for reason, payload in bad.items():

            def counted(reason: str = reason, payload: bytes = payload) -> bool:
                link.send(Envelope(key, payload))  # again and again: a loaded network may drop what is DROP
                return reason in refused()

            wait_until(counted, f"{reason} is counted", 60.0)
        before = len(statuses)
        wait_until(lambda: refused() and len(statuses) > before, "the board lives on")
