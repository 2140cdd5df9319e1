"""Tapes as files: what was written is read, a broken place is one line or is stepped over, foreign bytes are refused."""

import io
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from blackboard.errors import UserError
from blackboard.tape.file import MAX_KEYS, TapeAbout, TapeWriter, copy, create, look_through, read
from blackboard.wire.envelope import Envelope
from blackboard.wire.raw import MAX_BYTES
from tests.tape.written import ENVELOPES, saved, written


def test_what_was_written_is_read_in_its_order(tmp_path: Path) -> None:
    about = TapeAbout()
    assert list(look_through(saved(tmp_path / "x.mcap", written()), about)) == ENVELOPES
    assert (about.metadata["team"], about.scenario) == ("t", {"name": "x"})


def test_mcap_tools_see_keys_encodings_and_schemas(tmp_path: Path) -> None:
    reader = make_reader(io.BytesIO(written()))
    channels = {(c.topic, c.message_encoding, s.name) for s, c, _ in reader.iter_messages() if s is not None}
    assert channels == {
        ("cop/t/world/alive", "json", "cop.v1.Event"),
        ("cop/t/world/clock", "msgpack", "cop.v1.Clock"),
        ("cop/t/a/report/r1/object/ball", "msgpack", "cop.v1.Report"),
        ("cop/t/a/report/r1/object/ball", "json", "cop.v1.Event"),
    }
    assert [m.log_time for _, _, m in reader.iter_messages()][:2] == [
        1_000_000_000_250_000_000,
        1_000_000_000_500_000_000,
    ]


@pytest.mark.parametrize("cut", [40, 2000, -1])
def test_a_tape_that_breaks_off_is_one_line_and_recovered_to_its_last_flush(tmp_path: Path, cut: int) -> None:
    content = written(flush_each=True, close=False)
    path = saved(tmp_path / "x.mcap", content[:cut])
    with pytest.raises(UserError, match=r"x.mcap, byte \d+: breaks off; `blackboard tape recover"):
        list(read(path))
    broken: list[int] = []
    count = copy(path, tmp_path / "y.mcap", broken=broken)
    assert list(read(tmp_path / "y.mcap")) == ENVELOPES[:count]
    assert sum(broken) < cut % len(content)
    assert count >= (5 if cut == -1 else 0)


def test_what_was_flushed_survives_a_kill(tmp_path: Path) -> None:
    broken: list[int] = []
    path = saved(tmp_path / "x.mcap", written(flush_each=True, close=False))
    assert list(look_through(path, TapeAbout(), broken)) == ENVELOPES


def test_a_broken_chunk_is_stepped_over(tmp_path: Path) -> None:
    content = bytearray(written(flush_each=True))
    at = content.index(b"zstd", len(content) // 4) + 40
    content[at : at + 8] = bytes(8)
    path = saved(tmp_path / "x.mcap", bytes(content))
    with pytest.raises(UserError, match="broken"):
        list(read(path))
    broken: list[int] = []
    kept = list(look_through(path, TapeAbout(), broken))
    assert len(broken) == 1
    assert kept
    assert all(each in ENVELOPES for each in kept)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP0\r\n"])
def test_what_is_no_tape_is_one_line(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(UserError, match="x.mcap, byte"):
        list(read(saved(tmp_path / "x.mcap", content)))


def test_a_missing_tape_and_one_of_somebody_else_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        list(read(tmp_path / "none.mcap"))
    file = io.BytesIO()
    writer = Writer(file)
    writer.start("ros2", "x")
    writer.finish()
    with pytest.raises(UserError, match="profile 'ros2'"):
        list(read(saved(tmp_path / "x.mcap", file.getvalue())))
    other = written().replace(b"\x06\x00\x00\x00format\x01\x00\x00\x001", b"\x06\x00\x00\x00format\x01\x00\x00\x009")
    with pytest.raises(UserError, match="format '9'"):
        list(read(saved(tmp_path / "x.mcap", other)))


@given(data=st.data())
def test_any_bytes_are_read_or_one_line(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    content = bytearray(written(flush_each=True))
    for at in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=8)):
        content[at] = data.draw(st.integers(0, 255))
    path = saved(
        tmp_path_factory.getbasetemp() / "fuzz.mcap", bytes(content[: data.draw(st.integers(0, len(content)))])
    )
    for broken in (None, list[int]()):
        try:
            list(look_through(path, TapeAbout(), broken))
        except UserError as error:
            assert "\n" not in str(error)


def test_a_tape_is_never_overwritten(tmp_path: Path) -> None:
    path = saved(tmp_path / "x.mcap", b"precious")
    with pytest.raises(UserError, match="never overwritten"), create(path):
        pass
    with pytest.raises(UserError, match="there is no folder"), create(tmp_path / "no" / "x.mcap"):
        pass
    assert path.read_bytes() == b"precious"


def test_what_is_too_large_and_keys_without_end_are_counted() -> None:
    writer = TapeWriter(io.BytesIO(), {})
    writer.write(1.0, Envelope("k", bytes(MAX_BYTES + 1)))
    for number in range(MAX_KEYS + 2):
        writer.write(1.0, Envelope(f"k/{number}", b""))
    assert writer.skipped == {"too_large": 1, "too_many_keys": 2, "no_room": 0}
