"""Intake: what is handed over, counted, refused, logged once and kept for later."""

import logging

import msgpack
import pytest

from blackboard.errors import Refused
from blackboard.process.intake import (
    MAX_AGES,
    MAX_EARLY,
    MAX_EARLY_BYTES,
    MAX_WARNINGS,
    STATUS_PERIOD,
    WAIT,
    Intake,
    TooEarly,
)
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status
from blackboard.wire.types import Message

NOW = 10.0  # Unix seconds


def status(process: str, size: int = 0) -> Envelope:
    """A status, with `size` times 4 kB in a field that nobody knows."""
    said = {"version": 1, "process": process, "kind": "robot", "tick": 1, "time": 0.0, "more": ["x" * 4000] * size}
    return Envelope(keys.STATUS.key(team="t", sub_team="a", process=process), msgpack.packb(said))


def echo(parts: dict[str, str], message: Message) -> list[Envelope]:
    return [Envelope(f"re/{parts['process']}")]


def too_early(parts: dict[str, str], message: Message) -> list[Envelope]:
    raise TooEarly


def refuse(parts: dict[str, str], message: Message) -> list[Envelope]:
    raise Refused("grid", "another one")


def test_a_message_is_handed_over_and_counted() -> None:
    intake = Intake()
    assert intake.on_envelope(status("r1"), echo, NOW) == [Envelope("re/r1")]
    assert (intake.counters, intake.refused) == ({"heard": 1}, {})


@pytest.mark.parametrize("kind", [Kind.DELETE, Kind.ALIVE, Kind.GONE])
def test_what_is_no_message_is_not_opened(kind: Kind) -> None:
    intake = Intake()
    assert intake.on_envelope(Envelope("x", b"", kind), refuse, NOW) == []
    assert (intake.counters, intake.refused) == ({}, {})


def test_what_is_refused_is_counted_by_reason_whoever_refuses_it() -> None:
    intake = Intake()
    assert intake.on_envelope(Envelope(status("r1").key, b"\xc1"), echo, NOW) == []
    assert intake.on_envelope(status("r1"), refuse, NOW) == intake.on_envelope(status("r2"), refuse, NOW) == []
    assert (intake.counters, intake.refused) == ({}, {"not-msgpack": 1, "grid": 2})


def test_a_refusal_is_logged_once_per_source_and_reason(caplog: pytest.LogCaptureFixture) -> None:
    intake = Intake()
    with caplog.at_level(logging.WARNING):
        for name in ("r1", "r2", "r1"):
            intake.on_envelope(status(name), refuse, NOW)
        intake.on_envelope(Envelope(status("r1").key, b""), echo, NOW)
    assert len(caplog.messages) == 3
    assert "/r1" in caplog.messages[0]
    assert "grid: another one" in caplog.messages[0]


def test_refusals_that_are_logged_are_bounded(caplog: pytest.LogCaptureFixture) -> None:
    intake = Intake()
    with caplog.at_level(logging.WARNING):
        for i in range(MAX_WARNINGS + 10):
            intake.on_envelope(Envelope(f"{'x' * 300}{i}" if i == 0 else f"x/{i}"), echo, NOW)
    assert len(caplog.messages) == MAX_WARNINGS
    assert len(caplog.messages[0]) < 500
    assert intake.refused == {"wild-key": MAX_WARNINGS + 10}


def test_what_came_too_early_comes_again_in_order_the_newest_per_key() -> None:
    intake = Intake()
    for name in ("r1", "r2", "r1"):
        assert intake.on_envelope(status(name), too_early, NOW) == []
    assert intake.counters == {}
    assert intake.retry(echo) == [Envelope("re/r2"), Envelope("re/r1")]
    assert intake.retry(echo) == []
    assert intake.counters == {"heard": 2}


def test_what_is_still_too_early_is_kept() -> None:
    intake = Intake()
    intake.on_envelope(status("r1"), too_early, NOW)
    assert intake.retry(too_early) == []
    assert intake.retry(echo) == [Envelope("re/r1")]


def not_yet(parts: dict[str, str], message: Message) -> list[Envelope]:
    raise TooEarly(Refused("unregistered", "no token"))


def test_what_is_refused_for_now_is_counted_once_and_may_be_handled_later(caplog: pytest.LogCaptureFixture) -> None:
    intake = Intake()
    intake.on_envelope(status("r1"), not_yet, NOW)
    intake.retry(not_yet)
    assert intake.refused == {"unregistered": 1}
    assert intake.retry(echo) == [Envelope("re/r1")]
    intake.on_envelope(status("r1"), not_yet, NOW + WAIT)  # this one has only come
    assert not caplog.messages


def test_the_log_says_so_once_messages_have_waited_too_long_or_have_no_room(caplog: pytest.LogCaptureFixture) -> None:
    intake = Intake()
    for at in (NOW, NOW + WAIT / 2):
        intake.on_envelope(status("r1"), not_yet, at)
        intake.on_envelope(status("r2"), too_early, at)
    said = Status(process="b", kind="board", tick=1, time=0.0)
    intake.counted(said, NOW + WAIT - 0.1)
    assert not caplog.messages
    intake.counted(said, NOW + WAIT)
    intake.on_envelope(status("r1"), not_yet, NOW + WAIT)
    assert [line.split("(")[1] for line in caplog.messages] == [
        "unregistered: no token); counted, and not logged again for this source"
    ]
    for name in ["r3", *(f"x{i}" for i in range(MAX_EARLY))]:
        intake.on_envelope(status(name), not_yet, NOW + WAIT)
    assert [line.split(" (")[0] for line in caplog.messages[1:]] == ["refused cop/t/a/status/r3"]


def test_what_came_too_early_is_bounded_in_number() -> None:
    intake = Intake()
    for i in range(MAX_EARLY + 3):
        intake.on_envelope(status(f"r{i}"), too_early, NOW)
    assert intake.retry(echo)[0] == Envelope("re/r3")
    assert intake.counters == {"early_dropped": 3, "heard": MAX_EARLY}


def test_what_came_too_early_is_bounded_in_bytes() -> None:
    """Sixty large envelopes on keys of their own: what is kept stays below the bound, the oldest go and are counted."""
    intake = Intake()
    large = [status(f"r{i}", size=200) for i in range(60)]
    total = sum(len(envelope.payload) for envelope in large)
    assert total > 5 * MAX_EARLY_BYTES
    for envelope in [*large, *large[-3:]]:
        intake.on_envelope(envelope, too_early, NOW)
    kept = intake.retry(echo)
    assert 0 < len(kept) <= MAX_EARLY_BYTES // len(large[0].payload)
    assert kept[-1] == Envelope("re/r59")
    assert intake.counters["early_dropped"] == 60 - len(kept)
    for envelope in large[:2]:  # the room is free again
        intake.on_envelope(envelope, too_early, NOW)
    assert len(intake.retry(echo)) == 2


def test_the_newest_of_a_key_takes_the_room_of_the_one_before() -> None:
    intake = Intake()
    intake.on_envelope(status("r1"), too_early, NOW)
    for _ in range(20):
        intake.on_envelope(status("r2", size=200), too_early, NOW)
    assert intake.retry(echo) == [Envelope("re/r1"), Envelope("re/r2")]
    assert intake.counters == {"heard": 2}


def test_a_status_shows_all_counters_and_the_next_is_due_in_a_second() -> None:
    intake = Intake()
    intake.on_envelope(status("r1"), echo, NOW)
    intake.on_envelope(status("r1"), refuse, NOW)
    for sent in (3, 4):
        intake.record_link_counters({"sent": sent, "dropped": 0})
    said = intake.counted(Status(process="b", kind="board", tick=1, time=0.0), now=10.0)
    assert said.counters == {"heard": 1, "sent": 4, "dropped": 0}
    assert said.refused == {"grid": 1}
    assert intake.status_due == 10.0 + STATUS_PERIOD


def test_a_status_shows_how_long_ago_each_source_was_heard() -> None:
    intake = Intake()
    for at, source in enumerate(("r2", "r1", "r2")):
        intake.record_age(source, float(at))
    assert intake.counted(Status(process="b", kind="board", tick=1, time=0.0), now=10.0).ages == {"r1": 9.0, "r2": 8.0}
    for i in range(MAX_AGES):
        intake.record_age(f"x{i}", 20.0)
    ages = intake.counted(Status(process="b", kind="board", tick=1, time=0.0), now=20.0).ages
    assert len(ages) == MAX_AGES
    assert "r1" not in ages
