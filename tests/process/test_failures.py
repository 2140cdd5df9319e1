"""Exceptions that are survived: counted, logged once, and never as more than one line."""

import logging

import pytest

from blackboard.process import failures
from blackboard.process.failures import Failures
from blackboard.process.intake import Intake
from blackboard.process.printable import quoted
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.types import Message
from tests.wire.messages import STATUS


def test_a_failure_is_counted_and_logged_once_per_source_and_kind(caplog: pytest.LogCaptureFixture) -> None:
    counted = Failures()
    with caplog.at_level(logging.DEBUG):
        for source, error in [
            ("a", ValueError("x")),
            ("a", ValueError("y")),
            ("a", KeyError("z")),
            ("b", KeyError("z")),
        ]:
            with counted.survive(source):
                raise error
    assert counted.counters == {"failed": 4}
    assert [r.getMessage().split(";")[0] for r in caplog.records if r.levelname == "ERROR"] == [
        "a: ValueError: x", "a: KeyError: 'z'", "b: KeyError: 'z'",
    ]  # fmt: skip
    assert all(r.exc_info for r in caplog.records if r.levelname == "DEBUG")


def test_what_is_remembered_as_logged_is_bounded(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(failures, "MAX_LOGGED", 2)
    counted = Failures()
    for i in range(5):
        with counted.survive(str(i)):
            raise ValueError
    assert (counted.counters["failed"], len(caplog.records)) == (5, 2)


def test_an_interrupt_is_not_survived() -> None:
    with pytest.raises(KeyboardInterrupt), Failures().survive("x"):
        raise KeyboardInterrupt


def test_a_text_from_outside_stays_one_line_that_a_terminal_may_show() -> None:
    assert quoted("cop/t\n12:00 forged\x1b[2J") == "cop/t\\n12:00 forged\\u001b[2J"
    assert quoted("ä/ö") == "ä/ö"
    assert quoted("x" * 201) == "x" * 200 + "..."


def test_a_handler_that_fails_costs_its_own_message_only() -> None:
    intake = Intake()

    def handle(parts: dict[str, str], message: Message) -> list[Envelope]:
        raise OverflowError("int too large")

    assert intake.on_envelope(Envelope("cop/t/a/status/r1", encode(STATUS)), handle, 0.0) == []
    assert intake.counters == {"failed": 1}


def test_a_forged_line_does_not_get_into_the_log(caplog: pytest.LogCaptureFixture) -> None:
    intake = Intake()
    intake.on_envelope(Envelope("cop/t/a\n12:00:00 [error] forged\x1b[2J", b""), lambda parts, message: [], 0.0)
    assert "\n" not in caplog.text.rstrip("\n")
    assert "\x1b" not in caplog.text
