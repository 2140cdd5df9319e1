"""A disk that is full for a while, or for good: the tape keeps every whole record, and it is known how many messages are missing."""

import errno
import io
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import UserError
from blackboard.state.fold import Fold
from blackboard.tape.backlog import MOST
from blackboard.tape.file import TapeAbout, TapeWriter, copy, look_through
from blackboard.tape.recorder import Recorder
from blackboard.view.summary import summary, text
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock
from tests.tape.written import ENVELOPES, saved, written

SENT = [(1e9 + i, Envelope(f"cop/t/a/report/r{i % 7}/object/ball", bytes([i % 251]) * 300)) for i in range(400)]

NEW_RUN = Envelope(keys.CLOCK.key(team="t"), encode(Clock(run="x", tick=0, time=0.0, mode="realtime")))


class Disk(io.BytesIO):
    """An unbuffered file on a disk with some room: it takes a part of what does not fit, and nothing when it is full."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: object) -> int:
        part = bytes(data)[: self.room]  # type: ignore[call-overload]
        if not part and data:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= len(part)
        return super().write(part)


@given(rooms=st.lists(st.integers(0, 20_000), min_size=1, max_size=12), flush_every=st.integers(1, 60))
def test_whatever_room_there_is_the_tape_is_a_whole_beginning_and_its_length_is_known(
    tmp_path_factory: pytest.TempPathFactory, rooms: list[int], flush_every: int
) -> None:
    disk = Disk(2000)
    writer = TapeWriter(disk, {"team": "t"})
    for number, (at, envelope) in enumerate(SENT):
        writer.write(at, envelope)
        if number % flush_every == 0:
            writer.flush()
        if number % (len(SENT) // len(rooms)) == 0:
            disk.room += rooms[number * len(rooms) // len(SENT)]
    writer.close()
    path = saved(tmp_path_factory.getbasetemp() / "full.mcap", disk.getvalue())
    kept = list(look_through(path, TapeAbout(), broken=[]))
    assert kept == SENT[: len(kept)]
    assert (writer.kept, writer.missing) == (len(kept), len(SENT) - len(kept))


def test_a_disk_that_was_full_for_a_while_costs_nothing_where_the_rest_fits_into_memory(tmp_path: Path) -> None:
    disk = Disk(3000)
    writer = TapeWriter(disk, {"team": "t"})
    for at, envelope in SENT:
        writer.write(at, envelope)
        writer.flush()
    assert writer.trouble == "No space left on device"
    disk.room = 1 << 30
    writer.flush()
    assert (writer.trouble, writer.missing) == ("", 0)
    writer.close()
    assert list(look_through(saved(tmp_path / "x.mcap", disk.getvalue()), TapeAbout())) == SENT


def test_what_waits_for_room_is_bounded_and_what_came_too_late_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("blackboard.tape.backlog.MOST", 5000)
    assert MOST > 1 << 20
    disk = Disk(3000)
    writer = TapeWriter(disk, {"team": "t"})
    for at, envelope in SENT:
        writer.write(at, envelope)
        writer.note(at, {})
        writer.flush()
    disk.room = 1 << 30
    writer.flush()
    writer.write(*SENT[-1])
    writer.close()
    kept = list(look_through(saved(tmp_path / "x.mcap", disk.getvalue()), TapeAbout()))
    assert 0 < len(kept) < 100
    assert kept[:-1] == SENT[: len(kept) - 1]
    assert kept[-1] == SENT[-1]
    assert writer.skipped["no_room"] == writer.missing == len(SENT) + 1 - len(kept)


def test_a_recorder_on_a_full_disk_goes_on_and_logs_it_once(caplog: pytest.LogCaptureFixture) -> None:
    disk = Disk(2000)
    recorder = Recorder("t", TapeWriter(disk, {"team": "t"}))
    for number in range(200):
        recorder.receive(Envelope("cop/t/x", bytes(range(number, 256)) * 9), float(number))
        recorder.wake(float(number))
    assert [record.message for record in caplog.records] == [
        "the tape cannot be written: No space left on device; trying again"
    ]
    disk.room = 1 << 30
    recorder.wake(200.0)
    assert caplog.records[-1].message == "the tape is written again"
    assert len(caplog.records) == 2


def test_whoever_looks_on_has_an_alarm_of_a_full_disk_until_it_is_looked_at() -> None:
    disk, fold = Disk(1 << 20), Fold()
    recorder = Recorder("t", TapeWriter(disk, {"team": "t"}))

    def until(now: float) -> str:
        recorder.receive(SENT[int(now)][1], now)
        for envelope in recorder.wake(now):
            fold.hear_envelope(envelope, now)
        return text(summary(fold, now))

    assert until(1.0) == "no team is heard of here"
    disk.room = 0
    for now in range(2, 20):
        shown = until(float(now))
    assert "! recorder cannot write its tape (No space left on device), 18 messages are missing, for 17 s" in shown
    fold.hear_envelope(NEW_RUN, 19.0)
    disk.room = 1 << 20
    assert ", for 18 s; over since 0 s" in until(20.0)
    assert recorder.wake(21.0) == []
    assert [alarm["over"] for alarm in summary(fold, 500.0)["teams"][0]["alarms"]] == [480.0]


def test_a_copy_that_finds_no_room_is_one_line_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape = saved(tmp_path / "x.mcap", written(ENVELOPES * 50))
    real = Path.open

    def on_a_full_disk(path: Path, mode: str = "r", *more: object, **named: object) -> object:
        if path.name != "y.mcap":
            return real(path, mode, *more, **named)  # type: ignore[call-overload]
        path.touch()
        return Disk(700)

    monkeypatch.setattr(Path, "open", on_a_full_disk)
    with pytest.raises(UserError, match=r"y.mcap: cannot be written \(No space left on device\); choose another place"):
        copy(tape, tmp_path / "y.mcap")
    assert not (tmp_path / "y.mcap").exists()
