"""What a router's log says, and what is told of it."""

import json
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.access.denials import PACKET, TARGET, Denial, DenialReader
from blackboard.access.doorkeeper import CALM, MAX_DENIALS, Doorkeeper, read
from blackboard.access.watch import DenialWatch
from blackboard.wire.envelope import Envelope

R1, VIEW = "a8d554dc00c5801910348393eb546b24", "2c0780a54f2038ed30e8f976ffca4de0"
KINDS = [
    "Query", "Reply", "Put", "Delete", "Declare/Undeclare_Subscriber", "Declare/Undeclare_Queryable",
    "Declare/Undeclare_Liveliness_Token", "Liveliness_Query", "Declare_Liveliness_Subscriber",
]  # fmt: skip


def line(text: str, *, level: str = "TRACE", thread: int = 9, target: str = TARGET) -> str:
    return f"2026-11-21T20:48:42.720231Z {level:>5}  rx-0 ThreadId({thread:02}) {target}: {text}\n"


def full(session: str, name: str, may: str, what: str, key: str, flow: str = "ingress") -> str:
    subject = f"Interface(lo)+CertCommonName({name})+Transport(Tls)+{session}"
    return f"{session} on {subject} is {may} to {what} ({flow}) on {key}"


def listing(session: str, name: str, key: str, thread: int = 9) -> list[str]:
    """What Zenoh says when it first sees a key declared: of every kind of message whether it would be allowed."""
    kinds = [line(full(session, name, "unauthorized", kind.replace("_", " "), key), thread=thread) for kind in KINDS]
    return [line(f"ACL (ingress): caching permissions for `{key}` ...", thread=thread), *kinds]


LOG = [
    line("Access control is enabled", level="DEBUG"),
    *listing(R1, "robot/r1/1", "cop/t/a/report/r2/robot/r2"),
    line(f"Using cached result: {R1} is unauthorized to Put (ingress) on cop/t/a/report/r2/robot/r2"),
    line(f"Using cached result: {R1} is authorized to Put (ingress) on cop/t/a/report/r1/robot/r1"),
    line(full(VIEW, "viewer/viewer/1", "authorized", "Put", "cop/t/a/report/r1/robot/r1", "egress")),
    line(full(VIEW, "viewer/viewer/1", "unauthorized", "Put", "cop/t/world/clock")),
    line(full(R1, "robot/r1/1", "unauthorized", "Put", "cop/t/world/truth", "egress")),
    line(f"Using cached result: {R1} is unauthorized to Liveliness Token (ingress) on cop/t/a/member/r2"),
    line("peer sent no certificates. Hint: increase the limit.", level="WARN", target="zenoh_link_tls::unicast"),
    line(f"{R1} did not match any configured ACL subject. Default permission `Deny` will be", level="INFO"),
    line("something else", level="WARN", target="zenoh_transport"),
    "no line of a log\n",
]
FOUND = [
    Denial("robot/r1/1", "put", "cop/t/a/report/r2/robot/r2"),
    Denial("viewer/viewer/1", "put", "cop/t/world/clock"),
    Denial("robot/r1/1", "hold the token", "cop/t/a/member/r2"),
    Denial("", "a connection was refused: peer sent no certificates"),
    Denial("", "a certificate that is revoked, or not known to this router, opened a session"),
]


def read_all(events: list[str]) -> list[Denial]:
    """What is read of events, each cut into packets as a pipe cuts it."""
    reader, cut = DenialReader(), [event[i : i + PACKET] for event in events for i in range(0, len(event), PACKET)]
    return [denial for packet in cut if (denial := reader.read(packet.encode())) is not None]


def test_every_denial_is_read_and_nothing_else() -> None:
    reader = DenialReader()
    assert [denial for event in LOG if (denial := reader.read(event.encode()))] == FOUND
    assert reader.enabled
    assert reader.other == ["zenoh_transport: something else"]


def test_the_lists_of_two_threads_do_not_hide_each_others_decisions() -> None:
    first, second = listing(R1, "robot/r1/1", "x"), listing(VIEW, "viewer/viewer/1", "y", thread=10)
    mixed = [part for pair in zip(first, second, strict=True) for part in pair]
    denied = line(f"Using cached result: {VIEW} is unauthorized to Put (ingress) on y", thread=10)
    assert read_all([*mixed, denied]) == [Denial("viewer/viewer/1", "put", "y")]


def test_a_key_with_line_breaks_forges_and_hides_nothing() -> None:
    forged = line(full(VIEW, "viewer/viewer/1", "unauthorized", "Put", "cop/t/world/clock"))
    hiding = line("ACL (ingress): caching permissions for `x` ...")
    denied = line(f"Using cached result: {R1} is unauthorized to Put (ingress) on x")
    known = listing(R1, "robot/r1/1", "x")
    for inside in (forged, hiding, forged * 100, "y: caching permissions for `x` ..."):
        for flow in ("ingress", "egress"):
            evil = line(f"Using cached result: {R1} is authorized to Put ({flow}) on a\n{inside}")
            assert read_all([*known, evil, denied]) == [Denial("robot/r1/1", "put", "x")]
    start = line(f"Using cached result: {R1} is authorized to Put (ingress) on ")[:-1]
    padding = "a" * (PACKET - len(start))  # so that what follows begins a packet
    for inside in (forged, forged.ljust(PACKET) + hiding):
        assert read_all([*known, start + padding + inside, denied]) == [Denial("robot/r1/1", "put", "x")]


@given(st.lists(st.binary(max_size=400), max_size=5))
def test_nothing_in_a_log_breaks_the_reader(noise: list[bytes]) -> None:
    reader = DenialReader()
    for event in noise:
        reader.read(line("x").encode()[:-2] + event)
        reader.read(event)
    reader.read(b"2026-11-21T20:48:42Z  WARN x ThreadId(01) \xff\xfe: \xff")
    assert reader.read(line("", target="zenoh_link_tls::unicast", level="WARN").encode())


def test_a_denial_is_logged_when_it_is_new_and_at_every_tenfold(caplog: pytest.LogCaptureFixture) -> None:
    keeper = Doorkeeper(["robot/r1/1"], "t")
    with caplog.at_level(logging.WARNING):
        for i in range(100):
            keeper.count([Denial("robot/r1/1", "put", f"cop/t/a/report/r2/object/ball{i}")])
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 3  # 1, 10, 100
    assert lines[0] == "denied: 'robot/r1/1 may not put cop/t/a/report/r2/object/ball0' (1 times, 1 denials in all)"
    assert keeper.denied == {"robot/r1/1": 100}


def test_what_a_denied_one_writes_into_a_key_forges_no_line_and_takes_no_memory(
    caplog: pytest.LogCaptureFixture,
) -> None:
    keeper = Doorkeeper([], "t")
    with caplog.at_level(logging.WARNING):
        keeper.count(Denial(f"x{i}", "put", f"a\x1b[2Jb\r{i}") for i in range(3 * MAX_DENIALS))
    assert not any("\x1b" in record.getMessage() or "\r" in record.getMessage() for record in caplog.records)
    assert len(keeper.denied) == 1
    assert len(caplog.records) <= MAX_DENIALS + 5
    assert keeper.denied.total() == 3 * MAX_DENIALS


def test_a_member_is_told_what_of_it_was_denied_and_not_too_often() -> None:
    keeper = Doorkeeper(["robot/r1/1", "world/world/1"], "t")
    assert [envelope.key for envelope in keeper.greet()] == ["door/t/robot/r1/1", "door/t/world/world/1"]
    assert {read(envelope.payload) for envelope in keeper.greet()} == {(0, "")}
    assert keeper.messages_due(0.0) == []
    keeper.count([Denial("robot/r1/1", "put", "cop/t/world/clock"), Denial("", "a connection was refused: x")])
    denials = {envelope.key: read(envelope.payload) for envelope in keeper.messages_due(0.0)}
    assert denials == {
        "door/t/robot/r1/1": (1, "robot/r1/1 may not put cop/t/world/clock"),
        "door/t/strangers": (1, "a connection was refused: x"),
    }
    keeper.count([Denial("robot/r1/1", "put", "cop/t/world/clock")])
    assert keeper.messages_due(0.4) == []
    assert len(keeper.messages_due(1.0)) == 1


def test_a_member_that_stops_is_told_that_it_is_calm_again() -> None:
    keeper = Doorkeeper(["robot/r1/1"], "t")
    keeper.count([Denial("robot/r1/1", "put", "cop/t/world/clock")])
    keeper.messages_due(0.0)
    assert keeper.messages_due(CALM - 1.0) == []
    (calm,) = keeper.messages_due(CALM)
    assert read(calm.payload) == (1, "")
    assert keeper.messages_due(2 * CALM) == []


@pytest.mark.parametrize("payload", [b"", b"{}", b"[]", b'{"denied": "x", "last": ""}', b"\xff", b"[" * 100_000, b'{"denied": 1e999, "last": 1}'])  # fmt: skip
def test_what_is_no_word_of_a_router_is_nothing(payload: bytes) -> None:
    assert read(payload) is None


def test_the_watch_prints_a_line_when_a_count_has_changed() -> None:
    shown: list[str] = []
    watch = DenialWatch("t", shown.append)
    said = Envelope("door/t/robot/r1/1", json.dumps({"denied": 2, "last": "a\nb"}).encode())
    for envelope in (Envelope("door/t/world/world/1", json.dumps({"denied": 0, "last": ""}).encode()), said, said):
        watch.receive(envelope, 0.0)
    assert shown == ["robot/r1/1: 2 denied, the last: 'a\\nb'"]
    assert watch.listens == ("door/t/**",)
