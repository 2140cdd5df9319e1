"""A link against real Zenoh sessions on 127.0.0.1: what is sent arrives, what is newest is answered, who is there is told."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh

from blackboard.errors import Mistake, Refused
from blackboard.launch import free_port
from blackboard.link import DEFAULT_ENDPOINT, ENCODING, Link, LinkConfig, Stopped
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_BYTES
from tests.link.net import LONG, Letters, introduce, wait_until

Connect = Callable[[str], Link]


def answers(link: Link, key_expr: str, *wanted: Envelope) -> None:
    wait_until(lambda: link.get(key_expr) == list(wanted), f"{key_expr} is answered by {wanted}")


# --- put and delete ------------------------------------------------------------------------------------------------------


def test_what_is_sent_arrives_in_order_and_never_at_the_sender(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    for link in (a, b):
        link.subscribe("x/**")
    introduce(b, a)
    introduce(a, b)
    sent = [Envelope("x/1", b"one"), Envelope("x/2", b""), Envelope("x/1", kind=Kind.DELETE), Envelope("x/1", b"two")]
    for envelope in sent:
        a.send(envelope)
    assert Letters(b).until(*sent) == sent
    b.send(Envelope("x/3", b"last"))
    assert Letters(a).until(Envelope("x/3", b"last")) == [Envelope("x/3", b"last")]
    liveliness = 1  # of the introduction
    assert a.counters == {"sent": 4, "received": liveliness + 1, "dropped": 0, "bytes": 4}
    assert b.counters == {"sent": 1, "received": liveliness + 4, "dropped": 0, "bytes": 6}


def test_a_sample_carries_its_encoding_and_a_stamp(endpoint: str, connect: Connect) -> None:
    config = LinkConfig(connect=(endpoint,)).build("plain")
    arrived = threading.Event()
    seen: list[zenoh.Sample] = []
    with (
        zenoh.open(config) as session,
        session.declare_subscriber("x", lambda sample: (seen.append(sample), arrived.set())),
    ):
        a = connect("a")
        wait_until(lambda: a.send(Envelope("x", b"1")) or arrived.wait(0.05), "it arrives")
    assert str(seen[0].encoding) == ENCODING
    assert seen[0].timestamp is not None


@pytest.mark.parametrize("size", [MAX_BYTES, MAX_BYTES + 1, 8 * MAX_BYTES])
def test_of_what_is_too_large_only_that_it_is_too_large_arrives(connect: Connect, size: int) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe("x")
    introduce(b, a)
    a.send(Envelope("x", b"\xff" * size))
    found: list[Envelope] = []
    wait_until(lambda: found or found.extend(b.receive(0.1)), "it arrives")
    assert len(found[0].payload) == min(size, MAX_BYTES + 1)
    assert b.counters["bytes"] == size


def test_a_publication_on_a_wild_key_is_refused_by_its_key(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe("cop/t/a/report/**")
    introduce(b, a)
    a.send(Envelope("cop/t/a/report/**", b"for everybody"))
    (letter,) = Letters(b).until(Envelope("cop/t/a/report/**", b"for everybody"))
    with pytest.raises(Refused, match="wild-key"):
        open_envelope(letter)


def test_liveliness_is_not_sent(connect: Connect) -> None:
    with pytest.raises(ValueError, match="hold a token"):
        connect("a").send(Envelope("x", kind=Kind.ALIVE))


# --- queries -------------------------------------------------------------------------------------------------------------


def test_the_newest_of_each_key_is_answered_once(connect: Connect) -> None:
    a, b, asking = connect("a"), connect("b"), connect("asking")
    r1, r2 = "cop/t/a/report/r1/robot/r1", "cop/t/a/report/r1/object/ball"
    mine = "cop/t/a/consensus/robot/r1"
    for key in (r1, r2, "cop/t/a/status/r1"):
        for payload in (b"old", b"new"):
            a.send(Envelope(key, payload))
    b.send(Envelope(mine, b"agreed"))
    answers(asking, "cop/t/a/report/**", Envelope(r2, b"new"), Envelope(r1, b"new"))
    answers(asking, r1, Envelope(r1, b"new"))
    answers(asking, "cop/*/*/*/robot/r1", Envelope(mine, b"agreed"))
    answers(asking, "cop/**", *(Envelope(k, b"agreed" if k == mine else b"new") for k in sorted((r1, r2, mine, "cop/t/a/status/r1"))))  # fmt: skip
    a.send(Envelope(r1, kind=Kind.DELETE))
    answers(asking, "cop/t/a/report/**", Envelope(r2, b"new"))


def test_two_who_answer_for_one_key_are_both_heard(connect: Connect) -> None:
    for name in ("a", "b"):
        connect(name).send(Envelope("x", name.encode()))
    asking = connect("asking")
    wait_until(lambda: {e.payload for e in asking.get("x")} == {b"a", b"b"}, "both answer")


def test_nobody_answers_for_what_nobody_sent(connect: Connect) -> None:
    assert connect("a").get("x/**", timeout=LONG) == []


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


# --- liveliness ----------------------------------------------------------------------------------------------------------


def test_tokens_are_told_those_already_there_too(connect: Connect, endpoint: str) -> None:
    a, watching = connect("a"), connect("watching")
    a.token("t/1")
    watching.token("t/own")
    watching.watch("t/**")
    letters = Letters(watching)
    letters.until(Envelope("t/1", kind=Kind.ALIVE), Envelope("t/own", kind=Kind.ALIVE))
    with Link(LinkConfig(connect=(endpoint,)), "b") as b:
        b.token("t/2")
        letters.until(Envelope("t/2", kind=Kind.ALIVE))
    letters.until(Envelope("t/2", kind=Kind.GONE))
    a.close()
    letters.until(Envelope("t/1", kind=Kind.GONE))
    assert len(letters.read) == 5


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
    with pytest.raises(Mistake, match=r"^r1: no Zenoh router answers at tcp/127\.0\.0\.1:1; start `blackboard router`"):
        Link(LinkConfig(connect=("tcp/127.0.0.1:1",)), "r1", patience=0.0)


def test_it_stops_trying_when_asked_to() -> None:
    with pytest.raises(Stopped):
        Link(LinkConfig(connect=("tcp/127.0.0.1:1",)), "r1", patience=LONG, stopped=lambda: True)


def test_a_port_in_use_is_a_mistake_at_once(endpoint: str) -> None:
    with pytest.raises(Mistake, match=r"Address already in use.*-l"):
        Link(LinkConfig(mode="router", listen=(endpoint,)), "second", patience=LONG)


@pytest.mark.parametrize(
    ("config", "says"),
    [
        (LinkConfig(file="nowhere.json5"), r"--config nowhere\.json5: No such file"),
        (LinkConfig(connect=("nonsense",)), "nonsense: .*Endpoints must be of the form"),
        (LinkConfig(cfg=("foo/bar:1",)), r"--cfg foo/bar:1: .*unknown key"),
        (LinkConfig(cfg=("mode",)), r"--cfg mode: write KEY:VALUE"),
        (LinkConfig(cfg=("mode:client",)), r"--cfg mode:client: Zenoh does not take it"),
    ],
)
def test_what_zenoh_does_not_take_is_a_mistake_in_one_line(config: LinkConfig, says: str) -> None:
    with pytest.raises(Mistake, match=says) as caught:
        config.build("r1")
    assert "\n" not in str(caught.value)
    assert ".rs" not in str(caught.value)


def setting(config: LinkConfig, key: str) -> object:
    return json.loads(config.build("r1").get_json(key))


def test_without_a_word_it_is_a_client_that_finds_nobody_by_chance() -> None:
    plain = LinkConfig()
    assert setting(plain, "mode") == "client"
    assert setting(plain, "connect/endpoints") == [DEFAULT_ENDPOINT]
    assert setting(plain, "scouting/multicast/enabled") is False
    assert setting(plain, "transport/shared_memory/enabled") is False
    assert setting(plain, "timestamping/enabled") is True
    assert setting(plain, "metadata") == {"name": "r1"}
    assert setting(LinkConfig(mode="router"), "listen/endpoints") == [DEFAULT_ENDPOINT]
    assert setting(LinkConfig(mode="peer"), "listen/endpoints") == []
    assert setting(LinkConfig(mode="peer"), "connect/endpoints") == []
    assert setting(LinkConfig(multicast=True), "connect/endpoints") == []


def test_a_flag_goes_before_the_file_and_cfg_before_both(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        "{mode: 'peer', connect: {endpoints: ['tcp/127.0.0.1:1']}, scouting: {multicast: {enabled: true}},"
        " transport: {link: {tx: {lease: 500}}}}"
    )
    said = LinkConfig(file=str(file))
    assert setting(said, "mode") == "peer"
    assert setting(said, "connect/endpoints") == ["tcp/127.0.0.1:1"]
    assert setting(said, "scouting/multicast/enabled") is True
    assert setting(said, "transport/link/tx/lease") == 500
    assert setting(said, "transport/shared_memory/enabled") is False  # the file says nothing of it
    flags = LinkConfig(file=str(file), mode="client", connect=("tcp/127.0.0.1:2",), multicast=False)
    assert setting(flags, "mode") == "client"
    assert setting(flags, "connect/endpoints") == ["tcp/127.0.0.1:2"]
    assert setting(flags, "scouting/multicast/enabled") is False
    cfg = LinkConfig(file=str(file), mode="client", cfg=('mode:"router"', "transport/link/tx/lease:700"))
    assert setting(cfg, "mode") == "router"
    assert setting(cfg, "transport/link/tx/lease") == 700
