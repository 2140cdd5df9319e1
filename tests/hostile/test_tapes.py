"""Tapes that somebody made to stop whoever looks at them: each is read in a time and memory of its size, or is one line."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from mcap.writer import IndexType, Writer

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.tape.content import Tape
from blackboard.tape.file import ABOUT, FORMAT, PROFILE, TapeAbout, copy, look_through, read
from blackboard.tape.whatif import WAKES, what_if
from blackboard.wire.envelope import Envelope
from tests.commands import Ran
from tests.tape.teams import READERS, SMALL, recorded_run

SECOND = 10**9  # nanoseconds


def tape_of(path: Path, messages: Sequence[tuple[int, str, bytes]], scenario: str = "{}", chunk: int = 1 << 16) -> Path:
    """A tape of messages (nanoseconds, key, payload), written by the library alone, without the index that would make it larger."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk, index_types=IndexType.NONE)
        writer.start(PROFILE, "somebody")
        writer.add_metadata(ABOUT, {"format": FORMAT, "team": SMALL.team.name, "scenario": scenario})
        channels = {
            key: writer.register_channel(key, "msgpack", 0) for key in dict.fromkeys(key for _, key, _ in messages)
        }
        for at, key, payload in messages:
            writer.add_message(channels[key], log_time=at, data=payload, publish_time=at)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Tape:
    return recorded_run(tmp_path_factory.mktemp("tape") / "x.mcap", SMALL)[1]


def puts(tape: Tape) -> list[tuple[int, str, bytes]]:
    return [(round(at * SECOND), envelope.key, envelope.payload) for at, envelope in tape.envelopes if envelope.payload]


@pytest.mark.parametrize("depth", [300, 900, 100_000])
@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_a_scenario_that_is_nested_deeply_is_none(tmp_path: Path, honest: Tape, command: list[str], depth: int) -> None:
    nested = '{"name": "x", "board": {"subjects": ' + '{"a": ' * depth + "1" + "}" * depth + "}}"
    said = Ran(*command, str(tape_of(tmp_path / "x.mcap", puts(honest), nested)))
    assert said.status in (0, 1, 2)
    assert said.err.count("\n") <= 1, said.err
    if command[0] in ("status", "why") or command == ["tape", "info"]:
        assert (said.status, said.err) == (0, "")


@pytest.mark.parametrize("name", ["x.json", "x.toml"])
def test_a_scenario_file_that_is_nested_deeply_is_one_line(tmp_path: Path, name: str) -> None:
    for depth in (300, 100_000):
        file = tmp_path / name
        file.write_text(
            ('{"name": ' if name == "x.json" else "name = ") + "[" * depth + "]" * depth + "}" * (name == "x.json")
        )
        said = Ran("up", str(file))
        assert said.status == 2
        assert said.err.count("\n") == 1


@pytest.mark.parametrize("command", [*READERS, ["tape", "recover"], ["tape", "cut"]], ids=" ".join)
def test_times_beyond_all_calendars_are_a_broken_place(tmp_path: Path, honest: Tape, command: list[str]) -> None:
    messages = [*puts(honest), (2**64 - 1, "cop/t/x", b""), (2**63, "cop/t/x", b"")]
    tape = tape_of(tmp_path / "x.mcap", messages, json.dumps(SMALL.tables))
    more = [str(tmp_path / "y.mcap")] if command[-1] in ("recover", "cut") else []
    said = Ran(*command, str(tape), *more)
    if command[-1] == "recover":
        assert said.status == 0
        assert len(list(read(tmp_path / "y.mcap"))) == len(messages) - 2
    else:
        assert said.status == 2
        assert "recover" in said.err


def test_a_few_bytes_that_unpack_to_millions_of_messages_are_not_read(tmp_path: Path) -> None:
    tape = tape_of(tmp_path / "x.mcap", [(SECOND, "cop/t/x", b"")] * 300_000, chunk=1 << 24)
    size = tape.stat().st_size
    assert size < 20_000
    with pytest.raises(UserError, match="holds more than a tape of this size"):
        list(read(tape))
    broken: list[int] = []
    assert copy(tape, tmp_path / "y.mcap", broken=broken) < 2 * size
    assert sum(broken) > size / 2


def test_a_few_bytes_that_unpack_to_much_memory_are_not_read(tmp_path: Path) -> None:
    tape = tape_of(tmp_path / "x.mcap", [(SECOND * i, "cop/t/x", bytes(1 << 20)) for i in range(300)], chunk=1 << 25)
    size = tape.stat().st_size
    assert size < 50_000
    with pytest.raises(UserError, match="holds more than a tape of this size"):
        list(read(tape))
    broken: list[int] = []
    kept = sum(len(envelope.payload) for _, envelope in look_through(tape, TapeAbout(), broken))
    assert kept < (1 << 26) + (1 << 25)


def test_a_tape_of_what_says_the_same_again_and_again_is_read(tmp_path: Path) -> None:
    """As dense as a real one can be: empty messages on few keys, each a millisecond after the last."""
    messages = [(SECOND + 1_000_000 * number, f"cop/t/x{number % 3}", b"") for number in range(30_000)]
    assert len(list(read(tape_of(tmp_path / "x.mcap", messages)))) == len(messages)


def apart(tape: Tape, seconds: float) -> list[tuple[float, Envelope]]:
    """The envelopes of a tape without its world, further apart."""
    of_others = [envelope for envelope in tape.envelopes if "/world/" not in envelope[1].key]
    return [(at + seconds * number, envelope) for number, (at, envelope) in enumerate(of_others)]


def wakes(envelopes: list[tuple[float, Envelope]], scenario: Scenario) -> int:
    """How often the boards of a tape are woken in a replay without r3."""
    return what_if(Tape(scenario, envelopes, TapeAbout()), scenario, ["r3"]).counters["woken"]


@pytest.mark.parametrize("seconds", [0.0, 1.0, 1e6])
@pytest.mark.parametrize("period", [0.5, 1e-6])
def test_boards_that_are_due_all_the_time_or_through_long_silences_do_not_stop_a_replay(
    monkeypatch: pytest.MonkeyPatch, honest: Tape, seconds: float, period: float
) -> None:
    monkeypatch.setattr("blackboard.tape.whatif.WAKES_AT_FIRST", 100)
    scenario = SMALL.changed("board", period=period, patience=1e12)
    envelopes = apart(honest, seconds)
    assert wakes(envelopes, scenario) <= 100 + WAKES * len(envelopes)
    halves = honest.envelopes[: len(honest.envelopes) // 2]  # in the middle of a tick in lockstep
    assert wakes(halves, scenario) <= 100 + WAKES * len(halves)


def test_a_real_tape_wakes_its_boards_less_than_once_for_each_message(honest: Tape) -> None:
    for envelopes in (honest.envelopes, apart(honest, 0.05)):
        assert 0 < wakes(envelopes, SMALL) < len(envelopes)


def test_what_is_looked_through_is_bounded_by_its_bytes(tmp_path: Path, honest: Tape) -> None:
    whole = tape_of(tmp_path / "x.mcap", puts(honest), json.dumps(SMALL.tables))
    assert len(list(look_through(whole, TapeAbout()))) == len(puts(honest))
