"""The router dies with -9 and comes back: everything is restored, nothing is raised in between, and nobody hangs."""

import pytest

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope, Kind
from tests.processes import Letters, introduce, program, wait_until

pytestmark = pytest.mark.system

SUBSCRIBER = """
import sys
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
with Link(LinkConfig(connect=(sys.argv[1],)), "r1", patience=60.0) as link:
    link.subscribe("x/**"); link.watch("t/**"); link.token("t/1")
    print("listening", file=sys.stderr, flush=True)
    {end}
"""


def test_all_is_restored_after_the_router_was_killed() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    config = LinkConfig(connect=(where,))
    with program("-m", "blackboard", "router", "-l", where) as first:
        first.says("ready")
        with Link(config, "a") as a, Link(config, "b") as b:
            a.token("t/a")
            a.watch("t/**")
            b.watch("t/**")
            b.subscribe("x/**")
            introduce(b, a)
            a.send(Envelope("x/1", b"before"))
            at_a, at_b = Letters(a), Letters(b)
            at_b.until(Envelope("t/a", kind=Kind.ALIVE), Envelope("x/1", b"before"))
            assert a.get("nobody") == []  # the router answers in order: by now it has told a of its own token
            first.running.kill()
            assert first.ends() == -9
            for letters in (at_a, at_b):
                letters.until(Envelope("t/a", kind=Kind.GONE))  # its owner is told too
                letters.read.clear()
            a.send(Envelope("x/1", b"into the void"))
            assert b.get("x/1") == []
            with program("-m", "blackboard", "router", "-l", where) as second:
                second.says("ready")
                at_b.until(Envelope("t/a", kind=Kind.ALIVE))
                at_a.until(Envelope("t/a", kind=Kind.ALIVE))
                wait_until(lambda: b.get("x/1") == [Envelope("x/1", b"into the void")], "the newest is answered")
                after = Envelope("x/2", b"after")
                wait_until(lambda: a.send(after) or after in at_b.take(), "what is sent arrives again")


def test_a_link_is_closed_while_the_router_is_gone() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    with program("-m", "blackboard", "router", "-l", where) as router:
        router.says("ready")
        with Link(LinkConfig(connect=(where,)), "a") as a:
            a.token("t/a")
            a.subscribe("x")
            a.send(Envelope("x", b"1"))
            assert a.get("x") == [Envelope("x", b"1")]
            router.running.kill()
            router.ends()


@pytest.mark.parametrize(
    ("end", "status"),
    [("raise RuntimeError('ours')", 1), ("sys.exit(3)", 3), ("pass", 0)],
    ids=["raise", "exit", "end"],
)
def test_a_process_with_callbacks_ends_however_it_ends(endpoint: str, end: str, status: int) -> None:
    with program("-c", SUBSCRIBER.format(end=end), endpoint) as process:
        assert process.ends() == status, process.err
        assert "listening" in process.err
