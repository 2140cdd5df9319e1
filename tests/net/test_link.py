"""What only a link over Zenoh has: its samples, its threads, and how it is opened. The rest is in test_network.py."""

import itertools
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from blackboard.errors import UserError
from blackboard.net.link import ENCODING, Link, Stopped
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope
from tests.processes import LONG, wait_until

Connect = Callable[[str], Link]


def answers(link: Link, key_expr: str, *wanted: Envelope) -> None:
    wait_until(lambda: link.get(key_expr) == list(wanted), f"{key_expr} is answered by {wanted}")


# --- put and delete ------------------------------------------------------------------------------------------------------


def test_a_sample_carries_its_encoding_and_a_stamp(endpoint: str, connect: Connect) -> None:
    config = LinkConfig(connect=(endpoint,)).build("plain")
    arrived = threading.Event()
    samples: list[zenoh.Sample] = []
    with (
        zenoh.open(config) as session,
        session.declare_subscriber("x", lambda sample: (samples.append(sample), arrived.set())),
    ):
        a = connect("a")
        wait_until(lambda: a.send(Envelope("x", b"1")) or arrived.wait(0.05), "it arrives")
    assert str(samples[0].encoding) == ENCODING
    assert samples[0].timestamp is not None


def test_what_is_urgent_is_sent_with_a_priority_of_its_own(endpoint: str, connect: Connect) -> None:
    """By the topic table; the queue of each priority that is used holds as much."""
    config = LinkConfig(connect=(endpoint,)).build("plain")
    priorities: dict[str, zenoh.Priority] = {}
    with (
        zenoh.open(config) as session,
        session.declare_subscriber("cop/**", lambda sample: priorities.update({str(sample.key_expr): sample.priority})),
    ):
        a = connect("a")
        asked = {
            "cop/t/world/clock": zenoh.Priority.INTERACTIVE_HIGH,
            "cop/t/s/status/r1": zenoh.Priority.INTERACTIVE_HIGH,
            "cop/t/s/report/r1/robot/r1": zenoh.Priority.DATA,
            "cop/t/world/truth": zenoh.Priority.DATA_LOW,
            "cop/of/no/topic": zenoh.Priority.DATA,
        }
        wait_until(
            lambda: [a.send(Envelope(key, b"1")) for key in asked] and set(priorities) == set(asked), "all arrive"
        )
    assert priorities == asked
    for name in ("interactive_high", "data", "data_low"):
        assert config.get_json(f"transport/link/tx/queue/size/{name}") == "16", name


# --- queries -------------------------------------------------------------------------------------------------------------


def test_questions_and_answers_do_not_stop_each_other(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    stop = threading.Event()

    def ask(link: Link) -> int:
        return sum(len(link.get("x/**")) for _ in iter(stop.is_set, True))

    a.send(Envelope("x/0", b"first"))
    b.send(Envelope("x/0", b"first"))
    answers(a, "x/0", *[Envelope("x/0", b"first")] * 2)
    with ThreadPoolExecutor() as pool:
        try:
            heard = [pool.submit(ask, link) for link in (a, b)]
            for i in range(500):
                for link in (a, b):
                    link.send(Envelope(f"x/{i % 5}", bytes(1000)))
        finally:
            stop.set()
    assert all(task.result(LONG) > 0 for task in heard)


# --- opening -------------------------------------------------------------------------------------------------------------


def test_it_waits_for_a_router_that_comes_later() -> None:
    where = f"tcp/127.0.0.1:{free_port()}"
    tried = threading.Event()
    with ThreadPoolExecutor() as pool:
        opening = pool.submit(
            Link, LinkConfig(connect=(where,)), "early", patience=LONG, stopped=lambda: tried.set() or False
        )
        assert tried.wait(LONG)
        with Link(LinkConfig(mode="router", listen=(where,)), "router"), opening.result(LONG) as link:
            assert link.get("x") == []


def test_where_nobody_answers_is_a_mistake_that_names_the_place() -> None:
    with pytest.raises(
        UserError,
        match=r"^r1: no Zenoh router answers at tcp/127\.0\.0\.1:1; start `blackboard router` there, or name another endpoint with -e ",
    ):
        Link(LinkConfig(connect=("tcp/127.0.0.1:1",)), "r1", patience=0.0)


def test_it_stops_trying_when_asked_to() -> None:
    with pytest.raises(Stopped):
        Link(LinkConfig(connect=("tcp/127.0.0.1:1",)), "r1", patience=LONG, stopped=lambda: True)


def test_a_port_in_use_is_a_mistake_at_once(endpoint: str) -> None:
    with pytest.raises(UserError, match=r"Address already in use.*-l"):
        Link(LinkConfig(mode="router", listen=(endpoint,)), "second", patience=LONG)


# --- floods --------------------------------------------------------------------------------------------------------------


def flood(board: Link, stranger: Link) -> None:
    """Send in invented names until the board has noticed."""

    def noticed() -> bool:
        for i in range(500):
            stranger.send(Envelope(f"cop/t/a/status/x{i}", b"!"))
        board.receive(0.01)
        return "floods" in board.counters

    wait_until(noticed, "they are too many")


def test_while_strangers_flood_the_router_carries_only_what_members_say(connect: Connect) -> None:
    board, member, stranger = connect("board"), connect("member"), connect("stranger")
    board.watch("cop/t/*/member/*")
    board.subscribe("cop/t/*/status/*")
    member.token("cop/t/a/member/r1")
    said = itertools.count()
    flood(board, stranger)

    def alone() -> bool:
        """Whether what a stranger says before a member does not come, and what the member says does."""
        before, mine = board.counters["received"], Envelope("cop/t/a/status/r1", str(next(said)).encode())
        stranger.send(Envelope("cop/t/a/status/x", b"late"))
        member.send(mine)
        wait_until(lambda: mine in board.receive(0.05), "the member is heard")
        return board.counters["received"] - before == 1

    wait_until(alone, "nobody else is heard")
    assert board.counters["floods"] == 1


def test_who_shows_a_token_while_strangers_flood_is_heard(connect: Connect) -> None:
    board, stranger, late = connect("board"), connect("stranger"), connect("late")
    board.watch("cop/t/*/member/*")
    board.subscribe("cop/t/*/status/*")
    connect("early").token("cop/t/a/member/r1")
    flood(board, stranger)
    late.token("cop/t/a/member/r2")
    said = Envelope("cop/t/a/status/r2", b"here")
    wait_until(lambda: late.send(said) or said in board.receive(0.05), "it is heard")
