"""Bytes are a message, or they are refused with the first reason that applies."""

import math
from typing import Any

import msgpack
import numpy as np
import pytest

from blackboard.errors import Refused
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode, encode, enveloped, message_in, open_envelope
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import MODELS, REASONS, Report, Status
from blackboard.wire.raw import MAX_BYTES, pack_map, unpack_map
from blackboard.wire.types import Message
from tests.wire.messages import CONSENSUS, EXAMPLES, REPORT, STATUS, TOPICS, as_map

ALL = [message for _, message in EXAMPLES.values()]


def reason_of(payload: bytes) -> str:
    with pytest.raises(Refused) as refusal:
        decode(Report, payload)
    assert refusal.value.reason in REASONS
    return refusal.value.reason


def report(**changes: Any) -> bytes:
    packed: bytes = msgpack.packb({**as_map(REPORT), **changes})
    return packed


# --- what is a message -------------------------------------------------------------------------------------------------


def test_every_model_has_an_example() -> None:
    assert {type(message).__name__ for message in ALL} == set(MODELS)


@pytest.mark.parametrize("message", ALL, ids=lambda m: type(m).__name__)
def test_a_message_comes_back_and_so_does_a_spelt_out_one(message: Message) -> None:
    assert decode(type(message), encode(message)) == message
    assert decode(type(message), msgpack.packb(as_map(message))) == message
    assert encode(decode(type(message), encode(message))) == encode(message)


def test_defaults_are_not_sent_but_the_version_always_is_and_first() -> None:
    status = Status(process="r1", kind="robot", tick=0, time=0.0)
    sent = msgpack.unpackb(encode(status))
    assert list(sent.items()) == [("version", 1), ("process", "r1"), ("kind", "robot"), ("tick", 0), ("time", 0.0)]
    assert decode(Status, encode(status)) == status


def test_numpy_numbers_leave_as_plain_numbers() -> None:
    status = STATUS.model_copy(update={"time": np.float64(0.5)})
    plain = STATUS.model_copy(update={"time": 0.5})
    assert encode(status) == encode(plain)
    made = Status(process="r1", kind="robot", tick=np.int64(3), time=np.float32(0.5))  # type: ignore[arg-type]
    assert decode(Status, encode(made)) == Status(process="r1", kind="robot", tick=3, time=0.5)


def test_a_report_is_small() -> None:
    belief = pack(gaussian(Grid((200, 200)), (93.37, 71.81), 5.0))
    sent = encode(Report(source="r1", subject="object/ball", tick=1234, time=1763690000.5, belief=belief))
    assert len(sent) < 1000


def test_unknown_fields_are_ignored_and_an_integer_is_a_number() -> None:
    later = as_map(REPORT) | {"colour": {"deep": [1, None, b"x"]}, "time": 1}
    assert decode(Report, msgpack.packb(later)) == REPORT.model_copy(update={"time": 1.0})


# --- what is none ------------------------------------------------------------------------------------------------------


def nested(depth: int) -> bytes:
    return b"\x91" * depth + b"\x01"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"hello",
        b"\xc1",
        encode(REPORT)[:-1],
        encode(REPORT) + b"\x00",
        msgpack.packb([1, 2]),
        msgpack.packb(None),
        msgpack.packb({1: 2}),
        msgpack.packb({b"version": 1}),
        msgpack.packb({"version": 1, "x": msgpack.Timestamp(1)}),
        msgpack.packb({"version": 1, "x": msgpack.ExtType(5, b"")}),
        msgpack.packb({"version": 1, "x": msgpack.ExtType(5, b"abc")}),
        b"\x82\xa1a\x01\xa1a\x01",  # the same key twice
        b"\x81\xa7version\xa1\xff",  # not UTF-8
        b"\x81\xa1x" + nested(5000),
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        msgpack.packb({"version": 1, "x": list(range(2000))}),
        msgpack.packb({"version": 1, "x": "x" * 5000}),
    ],
)
def test_what_is_no_map_is_refused_as_such(payload: bytes) -> None:
    assert reason_of(payload) == "not-msgpack"


@pytest.mark.parametrize("size", [MAX_BYTES + 1, 64 << 20])
def test_size_is_looked_at_before_anything_else(size: int) -> None:
    assert reason_of(bytes(size)) == "too-large"


@pytest.mark.parametrize("version", [0, 2, -1, 1.0, True, "1", None, [1], 1 << 63])
def test_the_version_is_looked_at_before_the_fields(version: Any) -> None:
    assert reason_of(msgpack.packb({"version": version})) == "version"
    assert reason_of(report(version=version)) == "version"


def test_a_version_that_is_nested_deeply_is_refused_too() -> None:
    with pytest.raises(Refused, match="version: version of type list"):
        unpack_map(b"\x81\xa7version" + b"\x91" * 1005 + b"\x90")


def test_a_message_without_version_is_of_none() -> None:
    fields = as_map(REPORT)
    del fields["version"]
    assert reason_of(msgpack.packb(fields)) == "version"


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"time": math.nan}, "Report.time"),
        ({"time": math.inf}, "Report.time"),
        ({"time": True}, "Report.time"),
        ({"time": "1.0"}, "Report.time"),
        ({"tick": 1.0}, "Report.tick"),
        ({"tick": True}, "Report.tick"),
        ({"tick": -1}, "Report.tick"),
        ({"tick": 1 << 63}, "Report.tick"),
        ({"source": b"r1"}, "Report.source"),
        ({"source": "r/1"}, "Report.source"),
        ({"source": "r1\n"}, "Report.source"),
        ({"source": "x" * 65}, "Report.source"),
        ({"source": ""}, "Report.source"),
        ({"source": "**"}, "Report.source"),
        ({"subject": "ball"}, "Report.subject"),
        ({"subject": "ghost/ball"}, "Report.subject"),
        ({"belief": None}, "Report.belief"),
        ({"belief": {}}, "Report.belief.grid"),
        ({"belief": as_map(REPORT)["belief"] | {"data": "text"}}, "Report.belief.data"),
        ({"belief": as_map(REPORT)["belief"] | {"coding": "f64"}}, "Report.belief.coding"),
        ({"belief": as_map(REPORT)["belief"] | {"lo": [-1, 0]}}, "Report.belief.lo.0"),
        ({"belief": as_map(REPORT)["belief"] | {"box": [1, 2, 3, 4]}}, "Report.belief.box"),
        ({"belief": as_map(REPORT)["belief"] | {"box": "ab"}}, "Report.belief.box"),
        ({"belief": as_map(REPORT)["belief"] | {"rest": "0"}}, "Report.belief.rest"),
        ({"ancestors": [["r1", 0.5]]}, "Report.ancestors"),
        ({"ancestors": {"r 1": 0.5}}, "Report.ancestors.r 1"),
        ({"ancestors": {f"r{i}": 0.5 for i in range(300)}}, "Report.ancestors"),
        ({"source": msgpack.unpackb(nested(900))}, "Report.source"),
    ],
)
def test_the_first_fault_is_named(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(Refused, match=f"^fields: {named}") as refusal:
        decode(Report, report(**changes))
    assert len(str(refusal.value)) < 500


# --- envelopes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_envelope_is_opened_by_its_key(name: str) -> None:
    parts, message = EXAMPLES[name]
    assert open_envelope(Envelope(TOPICS[name].key(**parts), encode(message))) == (TOPICS[name], parts, message)


@pytest.mark.parametrize(
    "key",
    [
        "",
        "elsewhere",
        "cop/t/a/report/*/object/ball",
        "cop/t/**",
        "cop/t/a/report/r1/ball",
        "cop/t/a/report/r1/object/ball/red",
        "cop/t/a/report/r1/object/ball\n",
        "cop/t/a/member/r1",  # a liveliness token
        "cop/t/world/alive",
    ],
)
def test_a_key_that_no_message_belongs_on(key: str) -> None:
    with pytest.raises(Refused, match="^wild-key:"):
        open_envelope(Envelope(key, bytes(MAX_BYTES + 1)))


@pytest.mark.parametrize(
    ("name", "part", "other"),
    [
        ("reading", "robot", "r2"),
        ("solo", "robot", "r2"),
        ("report", "source", "r2"),
        ("report", "subject", "object/cup"),
        ("consensus", "sub_team", "b"),
        ("consensus", "subject", "robot/ball"),
        ("agreed", "sub_team", "b"),
        ("agreed", "subject", "object/cup"),
        ("status", "process", "r2"),
    ],
)
def test_who_says_otherwise_than_its_key_is_an_impostor(name: str, part: str, other: str) -> None:
    parts, message = EXAMPLES[name]
    with pytest.raises(Refused, match="^impostor:"):
        open_envelope(Envelope(TOPICS[name].key(**{**parts, part: other}), encode(message)))


def test_a_consensus_on_the_key_of_the_other_level_is_an_impostor() -> None:
    with pytest.raises(Refused, match="^impostor:"):
        open_envelope(Envelope(TOPICS["agreed"].key(**EXAMPLES["agreed"][0]), encode(CONSENSUS)))


def test_an_envelope_is_opened_once_for_all_who_hear_it_and_refused_by_each() -> None:
    parts, report = EXAMPLES["report"]
    sound = Envelope(TOPICS["report"].key(**parts), encode(report))
    assert open_envelope(sound)[2] is open_envelope(sound)[2]
    broken = Envelope(sound.key, sound.payload[:-1])
    for _ in range(2):
        with pytest.raises(Refused):
            open_envelope(broken)
    assert message_in(broken) is None
    assert open_envelope(sound)[2] == message_in(sound) == report


@pytest.mark.parametrize("name", EXAMPLES)
def test_what_this_process_wrote_is_taken_as_it_is_where_its_key_says_the_same(name: str) -> None:
    parts, message = EXAMPLES[name]
    envelope = enveloped(TOPICS[name].key(**parts), message)
    assert envelope == Envelope(envelope.key, encode(message))
    open_envelope.cache_clear()  # another test may have opened the same bytes
    assert open_envelope(envelope)[2] is message
    with pytest.raises(Refused) as refusal:
        open_envelope(enveloped("cop/t/a/report/r9/object/other", message))
    assert refusal.value.reason == ("impostor" if isinstance(message, Report) else "fields")


# --- in fewer bytes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", ALL, ids=lambda message: type(message).__name__)
def test_the_shortest_form_reads_back_as_the_same_message(message: Message) -> None:
    payload = encode(message, shortest=True)
    assert decode(type(message), payload) == message
    assert len(payload) <= len(encode(message))


@pytest.mark.parametrize(
    ("number", "size"),
    [(0.0, 1), (-0.0, 1), (1.0, 1), (-7.0, 1), (300.0, 3), (0.5, 5), (float(np.float32(0.1)), 5), (0.1, 9), (1e12, 9)]
    + [(2.0**31, 5), (2.0**31 - 1, 5), (1248446200.25, 9), (1e300, 9), (math.inf, 9), (-1e-46, 9)],
)
def test_a_number_takes_as_few_bytes_as_hold_it(number: float, size: int) -> None:
    payload = pack_map({"a": [number], "b": {"c": (number, "text", b"bytes", None, True, 7)}}, shortest=True)
    assert msgpack.unpackb(payload)["a"] == [number]
    assert msgpack.unpackb(payload)["b"] == {"c": [number, "text", b"bytes", None, True, 7]}
    assert len(pack_map({"a": [number]}, shortest=True)) == len(pack_map({"a": [0]})) - 1 + size


def test_long_maps_and_arrays_have_longer_heads() -> None:
    fields = {f"f{i}": [float(j) for j in range(i)] for i in (0, 15, 16, 300)} | {f"g{i}": i for i in range(20)}
    assert msgpack.unpackb(pack_map(fields, shortest=True)) == {"version": 1, **fields}
