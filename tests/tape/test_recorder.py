"""The recorder: it listens to everything of one team, and what the link counts is on the tape."""

import io
from pathlib import Path

from blackboard.tape.file import TapeAbout, TapeWriter, look_through
from blackboard.tape.recorder import FLUSH, Recorder
from blackboard.wire.envelope import Envelope, Kind


def test_it_keeps_everything_and_flushes_once_a_second(tmp_path: Path) -> None:
    file, path = io.BytesIO(), tmp_path / "x.mcap"
    recorder = Recorder("t", TapeWriter(file, {"team": "t"}))
    assert (recorder.listens, recorder.watches, recorder.tokens, recorder.done) == (
        ("cop/t/**",),
        ("cop/t/**",),
        (),
        False,
    )
    assert recorder.wake_at(10.0) == 0.0  # at once: who waits for the tape sees that it listens
    recorder.record_link_counters({"received": 5, "dropped": 2})
    envelopes = [Envelope("cop/t/x", b"1"), Envelope("cop/t/a/member/r1", kind=Kind.ALIVE)]
    assert [recorder.receive(envelope, 10.0) for envelope in envelopes] == [[], []]
    assert recorder.wake(10.5) == []
    assert recorder.wake_at(10.6) == 10.5 + FLUSH
    recorder.receive(Envelope("cop/t/x", b"lost with a kill -9"), 10.6)
    path.write_bytes(file.getvalue())  # as a kill -9 leaves it
    about, broken = TapeAbout(), list[int]()
    assert [envelope for _, envelope in look_through(path, about, broken)] == envelopes
    assert (about.link["received"], about.link["dropped"]) == (5, 2)
