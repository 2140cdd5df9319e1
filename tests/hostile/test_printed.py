"""What commands print: of texts from outside nothing but printable characters reaches a terminal, and no line is forged."""

import asyncio
import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from blackboard.errors import RunFailed, UserError
from blackboard.run import door
from blackboard.run.flags import OutputFlags
from blackboard.run.progress import progress
from blackboard.tape.file import TapeWriter, create
from blackboard.view.feed import TapeFeed
from blackboard.wire.envelope import Envelope, Kind
from tests.commands import Ran
from tests.hostile.poison import HARMFUL, PIECES, Poison
from tests.tape.teams import READERS, SMALL, recorded_run
from tests.view.links import Recording, put_in_place

NASTY = st.text(st.sampled_from(HARMFUL) | st.characters(), max_size=30)
CLEAN = "no name"  # takes the same places as the others
SHORT = "forged\n\r\x1b[2J\x7f\x9b\u202e\u2028"


@given(text=NASTY)
@example(text=SHORT)
def test_whatever_a_command_writes_is_printable(text: str) -> None:
    app = door.new_app("writes")

    @app.default
    def write() -> None:
        print(text)
        sys.stdout.write(text)
        sys.stdout.writelines([text, text])
        sys.stderr.write(text)
        logging.getLogger("x").warning("%s", text, extra={"fields": {text: text}})
        with progress(text) as show:
            assert show is not None
            show(1, 1)

    said = Ran(app=app)
    assert said.is_printable
    assert said.status == 0


@example(text=SHORT, kind=UserError)
@given(text=NASTY, kind=st.sampled_from([UserError, RunFailed, RuntimeError]))
def test_whatever_ends_a_command_is_one_printable_line(text: str, kind: type[Exception]) -> None:
    app = door.new_app("fails")

    @app.default
    def fail() -> None:
        raise kind(text)

    if kind is RuntimeError:  # a fault of the program: its traceback
        with pytest.raises(RuntimeError):
            Ran(app=app)
        return
    said = Ran(app=app)
    assert said.is_printable
    assert said.err.count("\n") == 1
    assert said.status == (2 if kind is UserError else 1)


@given(text=NASTY)
@example(text=SHORT)
def test_a_result_is_the_same_json_and_its_text_has_no_more_lines(text: str) -> None:
    app = door.new_app("shows")
    result = {text: [text, {"x": text}], "y": 1}

    @app.default
    def show(*, output: OutputFlags = OutputFlags()) -> None:
        output.show(result, lambda table: "\n".join(f"{name} {value}" for name, value in table.items()))

    said = Ran("--json", app=app)
    assert said.is_printable
    assert json.loads(said.out) == result
    assert Ran(app=app).out.count("\n") == len(result)


# --- tapes ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tapes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A tape, and the same with each piece of what is harmful in every free text: of its messages, and of what it says of itself."""
    folder = tmp_path_factory.mktemp("tapes")
    _, tape = recorded_run(folder / "clean.mcap", SMALL)
    paths = []
    for number, text in enumerate([CLEAN, *PIECES]):
        poison = Poison(text)
        paths.append(folder / f"{number}.mcap")
        with create(paths[-1]) as file:
            known = {"team": SMALL.team.name, "scenario": json.dumps({**SMALL.tables, "name": text})}
            writer = TapeWriter(file, known | {f"x{text}": text})
            for at, envelope in tape.envelopes:
                writer.write(at, poison.envelope(envelope))
            writer.close()
    return paths


@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_what_is_told_of_a_tape_is_printable_and_has_no_forged_lines(tapes: list[Path], command: list[str]) -> None:
    clean, *others = tapes
    expected = Ran(*command, str(clean))
    assert expected.status in (0, 1), expected.err
    assert len(expected.out.splitlines()) > 5
    for tape in others:
        said = Ran(*command, str(tape))
        assert said.is_printable
        assert said.status == expected.status, said.err
        if command[-1] != "table":  # a line break in a cell of CSV is no end of its row
            assert said.out.count("\n") == expected.out.count("\n"), f"{tape}\n{said.out}"
    # the texts were there
    if command[0] in ("status", "tape"):
        assert "\\u00" in Ran(*command, str(others[0])).out


# --- teams that run ---------------------------------------------------------------------------------------------------------


@contextmanager
def on_a_link(monkeypatch: pytest.MonkeyPatch, text: str, more: list[Envelope]) -> Iterator[None]:
    """Commands meet a link that tells more, then a run with a text in all its messages."""
    poison = Poison(text)

    class Poisoned(Recording):
        def __init__(self, *_: Any, **__: Any) -> None:
            super().__init__()
            self.left = more + [poison.envelope(envelope) for envelope in self.left]

    with monkeypatch.context() as patched:
        put_in_place(patched, Poisoned)
        yield


@pytest.mark.parametrize(
    "command",
    [
        ["status", "--seconds", "5"], ["why", "robot/r1", "--team", "t", "--seconds", "20"], ["echo", "**", "--count", "100"],
        ["hz", "**", "--seconds", "5"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_what_is_told_of_a_running_team_is_printable(monkeypatch: pytest.MonkeyPatch, command: list[str]) -> None:
    lines = []
    for text in (CLEAN, *PIECES, SHORT):
        foreign = [Envelope(f"cop/t/a/{text}", b"\xc1"), Envelope(f"cop/t/board/{text}", kind=Kind.ALIVE)]
        with on_a_link(monkeypatch, text, foreign):
            said = Ran(*command)
        assert said.is_printable
        assert said.status == 0, said.err
        lines.append(said.out.count("\n"))
    assert len(set(lines)) == 1


def test_what_the_terminal_shows_is_printable(tapes: list[Path]) -> None:
    pytest.importorskip("textual", reason="no textual: pip install '.[tui]'")
    from textual.widgets import Static

    from blackboard.tape.file import read
    from blackboard.view.tui.top import Top

    async def look(tape: Path) -> list[str]:
        feed = TapeFeed(read(tape))
        while not feed.done:
            feed.hear_envelopes(feed.receive())
        top = Top(feed, SMALL.team.name)
        async with top.run_test(size=(160, 50)) as pilot:
            while not top.query("#head"):
                await pilot.pause()
            top.with_why = True
            top.draw()
            await pilot.pause()
            return [
                str(top.query_one(f"#{name}", Static).render())
                for name in ("head", "processes", "subjects", "events", "why")
            ]

    expected = asyncio.run(look(tapes[0]))
    for tape in tapes[1:]:
        printed = asyncio.run(look(tape))
        assert all(line.isprintable() for text in printed for line in text.split("\n"))
        assert [text.count("\n") for text in printed] == [text.count("\n") for text in expected]
