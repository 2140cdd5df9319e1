"""A small tape of every kind of envelope, as bytes and as a file."""

import io
from pathlib import Path

from blackboard.tape.file import TapeWriter
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from tests.wire.messages import CLOCK, REPORT

ENVELOPES = [
    (1e9 + 0.25, Envelope("cop/t/world/alive", kind=Kind.ALIVE)),
    (1e9 + 0.5, Envelope("cop/t/world/clock", encode(CLOCK))),
    (1e9 + 0.5, Envelope("cop/t/a/report/r1/object/ball", encode(REPORT))),
    (1e9 + 0.75, Envelope("cop/t/a/report/r1/object/ball", b"\xff nonsense is kept too")),
    (1e9 + 1.0, Envelope("cop/t/a/report/r1/object/ball", kind=Kind.DELETE)),
    (1e9 + 1.25, Envelope("cop/t/world/alive", kind=Kind.GONE)),
]


def written(
    envelopes: list[tuple[float, Envelope]] = ENVELOPES, *, flush_each: bool = False, close: bool = True
) -> bytes:
    file = io.BytesIO()
    writer = TapeWriter(file, {"team": "t", "scenario": '{"name": "x"}'})
    for at, envelope in envelopes:
        writer.write(at, envelope)
        if flush_each:
            writer.flush()
    if close:
        writer.close()
    return file.getvalue()


def saved(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
