"""A hostile client against a real board."""

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Status
from blackboard.wire.raw import MAX_BYTES
from tests.processes import program, wait_until


def test_a_hostile_client_is_counted_and_the_board_lives(endpoint: str) -> None:
    served = ("serve", "--team", "t", "--sub-team", "a", "--id", "desk", "-e", endpoint)
    with program("-m", "blackboard", *served) as board, Link(LinkConfig(connect=(endpoint,)), "attacker") as link:
        board.says("ready")
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
