"""A tape of processes that die: everything is on it, and a recorder that is killed leaves all but its last second."""

import os
import signal
from contextlib import suppress
from pathlib import Path

from blackboard.tape.file import read
from blackboard.wire.envelope import Kind
from tests.commands import blackboard
from tests.present import present
from tests.processes import children, program, wait_until


def child(pid: int, named: str) -> int | None:
    """A child whose command line names something."""
    for started in children(pid):
        with suppress(FileNotFoundError, ProcessLookupError):
            if named in Path(f"/proc/{started}/cmdline").read_text().split("\0"):
                return started
    return None


def restarted(pid: int, named: str) -> None:
    """Kill a child, and wait until the launcher has started it again."""
    victim = present(child(pid, named))
    os.kill(victim, signal.SIGKILL)
    wait_until(lambda: child(pid, named) not in (None, victim), "it is started again")


def test_what_died_is_on_the_tape_and_a_killed_recorder_leaves_all_but_a_second(tmp_path: Path) -> None:
    tape, saved = tmp_path / "x.mcap", tmp_path / "y.mcap"
    with program(
        "-m", "blackboard", "demo", "--robots", "3", "--realtime", "--seconds", "60", "--json", "--record", str(tape)
    ) as run:
        pid = run.running.pid
        wait_until(lambda: child(pid, "sim_world"), "the world runs")
        wait_until(lambda: tape.stat().st_size > 50_000, "something is recorded")
        restarted(pid, "r3")
        restarted(pid, "board-b")
        size = tape.stat().st_size
        wait_until(lambda: tape.stat().st_size > size + 100_000, "more is recorded")
        recorder = present(child(pid, "record"))
        os.kill(recorder, signal.SIGKILL)
        wait_until(lambda: child(pid, "record") is None, "the recorder is gone")
        run.running.send_signal(signal.SIGINT)
        run.ends()
    assert "breaks off" in blackboard("replay", str(tape)).stderr
    assert blackboard("tape", "recover", str(tape), str(saved)).returncode == 0
    again = blackboard("replay", str(saved))
    assert again.returncode == 0, again.stdout
    assert "as recorded, to the bit" in again.stdout
    assert len([e for _, e in read(saved) if e.kind is Kind.GONE and "board-b" in e.key]) == 1
