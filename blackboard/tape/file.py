"""Tapes as MCAP files, written and read. The only place that names mcap (https://mcap.dev/spec).

Each key is a channel of its own, with the key as its topic. A message lies there verbatim (encoding "msgpack", schema named
`cop.v1.Report`, ...). What happens to a key beside messages, `alive` and `gone` of a token and `delete`, is a second channel of the
same topic (encoding "json", schema `cop.v1.Event`). The recorder's own counters are on `LINK`. Times are Unix time at the recorder.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

from blackboard.errors import UserError, extra, writing
from blackboard.tables import parse
from blackboard.tape.backlog import Backlog
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.raw import MAX_BYTES, VERSION

with extra("record", "a tape"):
    import zstandard
    from mcap.opcode import Opcode
    from mcap.records import Channel, Chunk, Header, McapRecord, Message, Metadata
    from mcap.stream_reader import StreamReader, breakup_chunk
    from mcap.writer import Writer

PROFILE = "cop-blackboard"
FORMAT = "1"  # of the tape: another one is refused
LINK = "tape/link"  # channel of the recorder's link counters, as JSON, once a second
ABOUT = "blackboard"  # the metadata record that says what is recorded
MAGIC = b"\x89MCAP0\r\n"
CHUNK = 1 << 16  # bytes: with a flush a second, a kill -9 loses a second at most
MAX_RECORD = 1 << 26  # bytes of a record, and of a chunk unpacked
LATEST = 1 << 63  # nanoseconds, in the year 2262: a later message is taken for a broken place
#: What a part of a file may hold, so that it needs no more time and memory than a file of its size: bytes and messages for each
#: byte of the file until then, and some at the beginning. Empty messages that follow each other take 5 bytes each.
UNPACKED, MESSAGES, AT_FIRST = 200, 1, 4096
MAX_KEYS = 4096  # channels on a tape; messages on further keys are counted and left out


@dataclass
class TapeAbout:
    """What a tape says about itself, and what a look through it finds."""

    metadata: dict[str, str] = field(default_factory=dict)
    link: dict[str, int] = field(default_factory=dict)  # the recorder's newest counters

    @property
    def scenario(self) -> dict[str, Any] | None:
        """The tables of the scenario; None where the recorder was not told."""
        text = self.metadata.get("scenario", "")
        try:
            tables = parse(text, json.loads) if text else None
        except ValueError:
            return None
        return tables if isinstance(tables, dict) else None


class TapeWriter:
    """Writes a tape; `flush` makes safe what was written until now.

    While the disk is full nothing is raised: what it does not take waits in memory, as far as a `Backlog` goes, and what comes
    then is counted as `no_room`. `missing` says at any time how many messages the file lacks.
    """

    def __init__(self, file: BinaryIO, metadata: Mapping[str, str]) -> None:
        """`file` is unbuffered, as `create` opens it."""
        self._out = Backlog(file)
        self._writer = Writer(self._out, chunk_size=CHUNK)  # type: ignore[arg-type]
        self._channels: dict[tuple[str, bool], tuple[int, int]] = {}  # key and whether a PUT -> channel, messages
        self._schemas: dict[str, int] = {}
        self.skipped = {"too_large": 0, "too_many_keys": 0, "no_room": 0}
        self._writer.start(PROFILE, f"blackboard {metadata.get('package', '')}")
        self._writer.add_metadata(ABOUT, {"format": FORMAT, **metadata})

    @property
    def messages(self) -> int:
        """Messages and events that were taken, without those that were skipped."""
        return self._out.count

    @property
    def kept(self) -> int:
        """How many messages and events are in the file."""
        return self._out.kept

    @property
    def missing(self) -> int:
        """Messages and events that the disk did not take, or not yet."""
        return self._out.count - self._out.kept + self.skipped["no_room"]

    @property
    def trouble(self) -> str:
        """Why the disk takes nothing just now; empty while it does."""
        return self._out.trouble

    def write(self, at: float, envelope: Envelope) -> None:
        """Add an envelope that arrived at a Unix time; one beyond the wire's limit of bytes is counted instead."""
        if self._out.is_full:
            self.skipped["no_room"] += 1
            return
        put = envelope.kind is Kind.PUT
        if put and len(envelope.payload) > MAX_BYTES:
            self.skipped["too_large"] += 1
            return
        payload = envelope.payload if put else json.dumps({"event": envelope.kind.value}).encode()
        self._add(at, envelope.key, put, payload)

    def note(self, at: float, counters: Mapping[str, int]) -> None:
        """Add the link's counters, and how much was left out."""
        if self._out.is_full:
            return
        self._add(at, LINK, False, json.dumps({**counters, **self.skipped}).encode())

    def flush(self) -> None:
        """Hand all that was written to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def check(self, path: Path) -> None:
        """UserError: the disk on which the tape lies takes nothing more."""
        if self.trouble:
            raise UserError(f"{path}: cannot be written ({self.trouble}); choose another place")

    def close(self) -> None:
        """Write the index; the file stays open. Where the disk is full, the file ends without it, as after a kill -9."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _add(self, at: float, key: str, put: bool, payload: bytes) -> None:
        entry = self._channels.get((key, put))
        if entry is None:
            if len(self._channels) >= MAX_KEYS and key != LINK:
                self.skipped["too_many_keys"] += 1
                return
            entry = self._register(key, put), 0
        channel, count = entry
        self._channels[key, put] = channel, count + 1
        self._out.count += key != LINK
        time = round(at * 1e9)
        self._writer.add_message(channel, log_time=time, publish_time=time, data=payload, sequence=count)

    def _register(self, key: str, put: bool) -> int:
        if put:
            known = keys.parse(key)
            schema = "" if known is None or known[0].message == "token" else f"cop.v{VERSION}.{known[0].message}"
        else:
            schema = f"cop.v{VERSION}.{'Link' if key == LINK else 'Event'}"
        if schema and schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema, "", b"")
        return self._writer.register_channel(key, "msgpack" if put else "json", self._schemas.get(schema, 0))


def read(path: str | Path) -> Iterator[tuple[float, Envelope]]:
    """All envelopes of a tape with the Unix times of their arrival at the recorder, in order of arrival.

    UserError: no tape, or one that is broken; what is whole before that place came first.
    """
    return look_through(Path(path), TapeAbout())


def look_through(path: Path, about: TapeAbout, broken: list[int] | None = None) -> Iterator[tuple[float, Envelope]]:
    """As `read`; `about` is filled while the tape goes by, its metadata before the first envelope.

    With `broken` nothing is raised for what is broken: the bytes of each such place are appended to it, and the rest is read.
    """
    channels: dict[int, Channel] = {}
    for record in _records(path, broken):
        if isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata) and record.name == ABOUT:
            about.metadata = record.metadata
            if record.metadata.get("format") != FORMAT:
                raise UserError(
                    f"{path}: a tape of format {record.metadata.get('format')!r:.20}; this version reads {FORMAT}"
                )
        elif isinstance(record, Message) and record.log_time >= LATEST:
            _note_broken(path, f"a message of {record.log_time / 1e9:.0f} s Unix time", len(record.data), broken)
        elif isinstance(record, Message) and record.channel_id in channels:  # else its channel was in what is broken
            channel = channels[record.channel_id]
            envelope = _envelope(channel, record.data)
            if channel.topic == LINK:
                about.link = _counters(record.data)
            elif envelope is not None:
                yield record.log_time / 1e9, envelope


def copy(
    path: Path,
    out: Path,
    change: Callable[[Iterator[tuple[float, Envelope]]], Iterator[tuple[float, Envelope]]] = lambda envelopes: (
        envelopes
    ),
    broken: list[int] | None = None,
) -> int:
    """Write what `change` makes of the envelopes of a tape into a new tape, and return how many. `broken` as in `look_through`.

    UserError: as in `read`, or the new tape cannot be made; then there is none.
    """
    about = TapeAbout()
    envelopes = look_through(path, about, broken)
    first = next(envelopes, None)  # the metadata come before it
    everything = envelopes if first is None else chain([first], envelopes)
    with create(out) as file:
        writer = TapeWriter(file, {name: text for name, text in about.metadata.items() if name != "format"})
        try:
            for at, envelope in change(everything):
                writer.write(at, envelope)
                writer.check(out)
            writer.close()
            writer.check(out)
        except UserError:
            out.unlink()
            raise
        return writer.messages


def check_new(path: Path) -> None:
    """Check before a run that its tape can be made. UserError: it is there already, or its folder is not."""
    if path.exists():
        raise UserError(f"{path}: is there already, and a tape is never overwritten; choose another name")
    if not path.parent.is_dir():
        raise UserError(f"{path}: there is no folder {path.parent}; make it, or choose another place")


@contextmanager
def create(path: Path) -> Iterator[BinaryIO]:
    """A new file for a tape, unbuffered. UserError: it is there already, or cannot be made."""
    check_new(path)
    with writing(path):
        file = path.open("xb", buffering=0)
    with file:
        yield file


# --- reading ------------------------------------------------------------------------------------------------------------


def _records(path: Path, broken: list[int] | None) -> Iterator[McapRecord]:
    """The records of the data section, those in chunks too, one frame after the other; everything is bounded by `MAX_RECORD`."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise UserError(
            f"{path}: cannot be read ({error.strerror}); give a tape, as `blackboard record` writes it"
        ) from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise UserError(f"{path}, byte 0: no MCAP file; give a tape, as `blackboard record` writes it")
        opcode, unpacked, messages = None, 0, 0
        while opcode != Opcode.DATA_END:
            at = file.tell()
            head = file.read(9)
            length = int.from_bytes(head[1:], "little")
            content = file.read(length) if len(head) == 9 and length <= MAX_RECORD else b""
            if len(head) < 9 or len(content) < length:
                lost = len(head) + len(content) + len(file.read(MAX_RECORD))
                _note_broken(path, f"byte {at}: breaks off", lost, broken)
                return
            opcode = head[0]
            try:
                room = AT_FIRST + MESSAGES * file.tell() - messages
                records = _parse(opcode, head + content, MAX_RECORD + UNPACKED * file.tell() - unpacked, room)
            except Exception as error:  # whatever the library makes of hostile bytes
                _note_broken(path, f"byte {at}: broken ({error!r:.80})", len(head) + length, broken, error)
                continue
            for record in records:
                if isinstance(record, Message):
                    unpacked, messages = unpacked + len(record.data), messages + 1
                if isinstance(record, Header) and record.profile != PROFILE:
                    raise UserError(f"{path}: an MCAP file of profile {record.profile!r:.40}, not a tape of a team")
                yield record


def _note_broken(path: Path, what: str, lost: int, broken: list[int] | None, cause: Exception | None = None) -> None:
    """Append the bytes of a broken place. UserError: they are not asked for."""
    if broken is None:
        raise UserError(f"{path}, {what}; `blackboard tape recover {path}` saves what is whole") from cause
    broken.append(lost)


def _parse(opcode: int, record: bytes, most_bytes: int, most_messages: int) -> list[McapRecord]:
    """The record in a frame, or those in a chunk, if they are no more than that; none of kinds that are not needed."""
    if opcode not in (Opcode.HEADER, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA, Opcode.CHUNK):
        return []
    parsed = next(StreamReader(BytesIO(record), skip_magic=True, emit_chunks=True).records)
    if not isinstance(parsed, Chunk):
        return [parsed]
    if parsed.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(parsed.data).read(MAX_RECORD + 1)
    elif parsed.compression == "":
        data = parsed.data
    else:
        raise ValueError(f"compressed by {parsed.compression}")
    if len(data) > MAX_RECORD or len(data) != parsed.uncompressed_size:
        raise ValueError(f"a chunk of {len(data)} bytes that says {parsed.uncompressed_size}")
    if len(data) > most_bytes or _has_more_frames(data, most_messages):
        raise ValueError("holds more than a tape of this size")
    plain = Chunk("", data, parsed.message_end_time, parsed.message_start_time, parsed.uncompressed_crc, len(data))
    return breakup_chunk(plain, validate_crc=True)


def _has_more_frames(data: bytes, most: int) -> bool:
    """Whether a chunk's content has more frames than that; looks at no more of them."""
    at = 0
    for _ in range(most + 1):
        if at >= len(data):
            return False
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return True


def _envelope(channel: Channel, data: bytes) -> Envelope | None:
    if channel.message_encoding == "msgpack":
        return Envelope(channel.topic, data)
    try:
        event = json.loads(data)
        return Envelope(channel.topic, kind=Kind(event["event"])) if event["event"] != "put" else None
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _counters(data: bytes) -> dict[str, int]:
    try:
        counters = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return (
        {str(name): count for name, count in counters.items() if type(count) is int}
        if isinstance(counters, dict)
        else {}
    )
