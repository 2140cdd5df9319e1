"""Tapes of real processes: recorded in lockstep and in real time, replayed to the bit, and played into a network."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from blackboard.net.link import Link
from blackboard.tape.file import read
from blackboard.wire.envelope import Kind
from tests.commands import blackboard
from tests.files import GOLDEN
from tests.processes import Letters

#: Runs a command of the blackboard in this interpreter, with the arguments that follow.
RUN_COMMAND = "from blackboard.__main__ import main; main()"


@pytest.mark.long
def test_a_recorded_run_is_replayed_to_the_bit_in_lockstep_and_in_real_time(tmp_path: Path) -> None:
    for pace, more in (("lockstep", ()), ("realtime", ("--realtime",))):
        tape = tmp_path / f"{pace}.mcap"
        card = json.loads(
            blackboard("demo", "--robots", "2", "--seconds", "3", "--record", str(tape), "--json", *more).stdout
        )
        again = blackboard("replay", str(tape), "--json")
        report = json.loads(again.stdout)
        assert again.returncode == 0, again.stderr
        assert (report["mode"], report["ticks"]) == (pace, 15)
        assert report.keys() == card.keys()
        if pace == "lockstep":
            assert report["hash"] == card["hash"]


def with_little_room(size: int, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command where no file may become larger than so many bytes, as on a full disk, in a folder.

    Beyond it the system takes a part of a write, then nothing. Python must not write what it compiles: it does not notice that.
    """
    code = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size})); {RUN_COMMAND}"
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )


def test_a_run_whose_tape_found_no_room_shows_its_scorecard_and_says_last_what_is_missing(tmp_path: Path) -> None:
    tape, whole = tmp_path / "x.mcap", tmp_path / "y.mcap"
    run = ("demo", "--robots", "2", "--seconds", "3", "--record", str(tape), "--json")
    done = with_little_room(40_000, tmp_path, *run)
    assert (done.returncode, json.loads(done.stdout)["ticks"]) == (1, 15)
    last = done.stderr.splitlines()[-1]
    counts = re.fullmatch(rf"error: {tape}: (\d+) of (\d+) messages are missing, because the disk was full .*", last)
    assert counts is not None, done.stderr
    assert blackboard("tape", "recover", str(tape), str(whole)).returncode == 0
    assert len(list(read(whole))) == int(counts[2]) - int(counts[1]) > 0


def test_a_disk_that_is_full_from_the_beginning_is_one_line(tmp_path: Path) -> None:
    done = with_little_room(100, tmp_path, "record", "x.mcap", "--team", "t")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: x.mcap: cannot be written (File too large); choose another place\n"


def test_a_tape_is_played_into_a_network(endpoint: str, connect: Callable[[str], Link]) -> None:
    listener = connect("listener")
    listener.subscribe("cop/demo/**")
    played = blackboard("replay", str(GOLDEN), "--speed", "4", "--only", "world", "-e", endpoint)
    assert played.returncode == 0, played.stderr
    Letters(listener).until(*[e for _, e in read(GOLDEN) if "/world/" in e.key and e.kind is Kind.PUT])
