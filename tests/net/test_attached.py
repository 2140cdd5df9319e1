"""A link that attaches bytes to messages, holds a token for each publisher, and keeps the last message for who comes late."""

import threading

import zenoh
from zenoh import ext

from blackboard.net.attached import AttachedLink
from blackboard.net.link import ENCODING
from blackboard.net.settings import LinkConfig
from blackboard.wire.envelope import Envelope, Kind
from tests.processes import Letters, wait_until


class Counted:
    token = "tokens/x"

    def __init__(self) -> None:
        self.count = 0

    def attach(self) -> bytes:
        self.count += 1
        return b"number %d" % self.count


def test_what_is_attached_and_who_comes_late(endpoint: str) -> None:
    config = LinkConfig(connect=(endpoint,))
    live, late = list[zenoh.Sample](), list[zenoh.Sample]()
    with (
        AttachedLink(config, "a") as link,
        AttachedLink(config, "b") as watcher,
        zenoh.open(config.build("c")) as other,
    ):
        int(link.session_id, 16)
        assert link.session_id != watcher.session_id
        link.outlet = {"x": Counted(), "y": Counted()}.get
        watcher.watch("tokens/**")
        other.declare_subscriber("*", live.append)
        wait_until(
            lambda: link.send(Envelope("x", b"first")) or threading.Event().wait(0.05) or live, "what is live comes"
        )
        letters = Letters(watcher)
        wait_until(lambda: Envelope("tokens/x", kind=Kind.ALIVE) in letters.take(), "the publisher has a token")
        link.send(Envelope("x", b"last"))
        wait_until(lambda: live[-1].payload.to_bytes() == b"last", "the last one comes")
        numbers = [sample.attachment.to_bytes() for sample in live if sample.attachment is not None]
        first = int(numbers[0].split()[1])
        assert numbers == [b"number %d" % (first + n) for n in range(len(live))]
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        latecomer = ext.declare_advanced_subscriber(other, "x", late.append, history=history)
        wait_until(lambda: late, "the last one is told again")
        assert [sample.payload.to_bytes() for sample in late] == [b"last"]
        assert late[0].attachment is not None
        assert late[0].attachment.to_bytes() == numbers[-1]
        latecomer.undeclare()
        assert letters.take() == [Envelope("tokens/x", kind=Kind.ALIVE)]  # nothing was sent on y


def test_what_has_no_outlet_goes_as_in_any_link(endpoint: str) -> None:
    config, samples = LinkConfig(connect=(endpoint,)), list[zenoh.Sample]()
    with AttachedLink(config, "a") as link, zenoh.open(config.build("c")) as other:
        other.declare_subscriber("cop/**", samples.append)
        link.outlet = {"x": Counted()}.get
        wait_until(
            lambda: link.send(Envelope("cop/t/a", b"1")) or threading.Event().wait(0.05) or samples, "it arrives"
        )
        assert samples[0].attachment is None
        assert str(samples[0].encoding) == ENCODING
        assert [envelope.payload for envelope in link.get("cop/t/a")] == [b"1"]
