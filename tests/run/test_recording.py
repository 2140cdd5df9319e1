"""The recorder of a run: the team waits until it listens, and goes on without it."""

import asyncio
import sys
from pathlib import Path

import pytest

from blackboard.config import Scenario
from blackboard.errors import RunFailed
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import process_table
from blackboard.run.recording import recording
from blackboard.run.supervisor import ProcessRow, Supervisor

#: A recorder that ends in order when it is told to; one that ends when the file `go` is there.
LISTENS = """
import signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
open(sys.argv[1], "w").write("x")
signal.sigwait([signal.SIGTERM])
open(sys.argv[1], "a").write("end")
"""
GIVES_UP = """
import pathlib, sys, threading
tape = pathlib.Path(sys.argv[1])
tape.write_text("x")
while not tape.with_name("go").exists():
    threading.Event().wait(0.01)
"""
QUIET: list[str] = []
pytestmark = pytest.mark.system


def run(tape: Path | None, code: str, ready_seconds: float = 30.0) -> str:
    """Record with a stand-in while a team runs that is done at once: what is missing on the tape."""

    async def team() -> str:
        row = None if tape is None else ProcessRow("recorder", (sys.executable, "-c", code, str(tape)))
        async with (
            Supervisor(lambda name, line: QUIET.append(line)) as supervisor,
            recording(supervisor, row, tape, ready_seconds) as recorded,
        ):
            assert tape is None or tape.stat().st_size > 0
        return recorded.trouble

    return asyncio.run(team())


def test_the_table_has_a_recorder_where_one_is_asked_for() -> None:
    scenario = Scenario({"team": {"name": "t"}})
    assert process_table(scenario, "s.json", LinkConfig(), "tcp/127.0.0.1:1").recorder is None
    row = process_table(scenario, "s.json", LinkConfig(), "tcp/127.0.0.1:1", None, Path("x.mcap")).recorder
    assert row is not None
    command = "-m blackboard record x.mcap --team t --scenario s.json --connect tcp/127.0.0.1:1"
    assert " ".join(row.arguments[1:]) == command


def test_the_team_starts_once_it_listens_and_it_is_stopped_in_order(tmp_path: Path) -> None:
    assert run(None, "") == ""
    assert run(tmp_path / "x.mcap", LISTENS) == ""
    assert (tmp_path / "x.mcap").read_text() == "xend"


def test_one_that_never_listens_is_a_failed_run(tmp_path: Path) -> None:
    with pytest.raises(RunFailed, match="the recorder ended with status 1"):
        run(tmp_path / "x.mcap", "raise SystemExit(1)")
    with pytest.raises(RunFailed, match="does not listen after 0.01 s"):
        run(tmp_path / "y.mcap", "import signal; signal.pause()", 0.01)


def test_the_team_goes_on_without_one_that_ends(tmp_path: Path) -> None:
    tape = tmp_path / "x"

    async def team() -> str:
        row = ProcessRow("recorder", (sys.executable, "-c", GIVES_UP, str(tape)))
        async with (
            Supervisor(lambda name, line: QUIET.append(line)) as supervisor,
            recording(supervisor, row, tape, 30.0) as recorded,
        ):
            (tmp_path / "go").touch()
            await asyncio.wait(
                [task for task in asyncio.all_tasks() if task is not asyncio.current_task()], timeout=30.0
            )
        return recorded.trouble

    assert asyncio.run(team()).startswith(f"the recorder ended before the run with status 0; {tape} has what came")


def test_what_a_recorder_could_not_write_is_what_it_said_last(tmp_path: Path) -> None:
    could_not = LISTENS + "print('error: 5 of 9 messages are missing', file=sys.stderr); sys.exit(1)"
    assert run(tmp_path / "x.mcap", could_not) == "5 of 9 messages are missing"
    assert run(tmp_path / "y.mcap", LISTENS + "sys.exit(3)").startswith("the recorder ended with status 3; ")


def test_a_tape_that_is_there_before_the_recorder_is_known_is_no_reason_to_leave_it_running(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_text("from the last run")
    assert "did not end" not in run(tmp_path / "x.mcap", "import signal; signal.pause()")
