"""Tapes of real processes: recorded in real time and with deaths, killed, replayed to the bit, and played into a network."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from blackboard.net.link import Link
from blackboard.tape.file import read
from blackboard.wire.envelope import Kind
from tests.processes import Letters, children, program, wait_until
from tests.system.test_demo import blackboard

GOLDEN = Path(__file__).parents[1] / "tape" / "golden.mcap"


def child(pid: int, named: str) -> int | None:
    """A child whose command line names something."""
    for one in children(pid):
        with suppress(FileNotFoundError, ProcessLookupError):
            if named in Path(f"/proc/{one}/cmdline").read_text().split("\0"):
                return one
    return None


def restarted(pid: int, named: str) -> None:
    """Kill a child, and wait until the launcher has started it again."""
    victim = child(pid, named)
    assert victim is not None
    os.kill(victim, signal.SIGKILL)
    wait_until(lambda: child(pid, named) not in (None, victim), "it is started again")


def test_a_recorded_run_is_replayed_to_the_bit_in_lockstep_and_in_real_time(tmp_path: Path) -> None:
    for pace, more in (("lockstep", ()), ("realtime", ("--realtime",))):
        tape = tmp_path / f"{pace}.mcap"
        card = json.loads(
            blackboard("demo", "--robots", "3", "--seconds", "3", "--record", str(tape), "--json", *more).stdout
        )
        again = blackboard("replay", str(tape), "--json")
        found = json.loads(again.stdout)
        assert again.returncode == 0, again.stderr
        assert (found["mode"], found["ticks"]) == (pace, 15)
        assert found.keys() == card.keys()
        if pace == "lockstep":
            assert found["hash"] == card["hash"]


def test_what_died_is_on_the_tape_and_a_killed_recorder_leaves_all_but_a_second(tmp_path: Path) -> None:
    tape, saved = tmp_path / "x.mcap", tmp_path / "y.mcap"
    with program("-m", "blackboard", "demo", "--realtime", "--seconds", "60", "--json", "--record", str(tape)) as run:
        pid = run.running.pid
        wait_until(lambda: child(pid, "sim_world"), "the world runs")
        wait_until(lambda: tape.stat().st_size > 100_000, "something is recorded")
        restarted(pid, "r3")
        restarted(pid, "board-b")
        size = tape.stat().st_size
        wait_until(lambda: tape.stat().st_size > size + 200_000, "more is recorded")
        recorder = child(pid, "record")
        assert recorder is not None
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


def test_a_tape_is_played_into_a_network(endpoint: str, connect: Callable[[str], Link]) -> None:
    listener = connect("listener")
    listener.subscribe("cop/demo/**")
    played = blackboard("replay", str(GOLDEN), "--speed", "4", "--only", "world", "-e", endpoint)
    assert played.returncode == 0, played.stderr
    Letters(listener).until(*[e for _, e in read(GOLDEN) if "/world/" in e.key and e.kind is Kind.PUT])
