"""The commands of docs/tutorial.md that look at a tape, run on the golden one: shorter, so its tick 9 and its robot r1 stand for others."""

import re
import shlex
from pathlib import Path

import pytest

from tests.commands import call
from tests.files import GOLDEN, page

NOT_HERE = ("demo", "view")  # start processes, or end only when they are stopped: tests/long/test_newcomer.py


def commands() -> list[str]:
    """What follows `.venv/bin/blackboard` on lines of code about this tape."""
    lines = re.findall(r"^    \.venv/bin/blackboard ([^#\n]+)", page("tutorial.md"), re.MULTILINE)
    return [line.strip() for line in lines if "run.mcap" in line and line.split()[0] not in NOT_HERE]


@pytest.mark.parametrize("command", commands())
def test_a_command_of_the_tutorial_does_what_it_says(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.mcap").write_bytes(GOLDEN.read_bytes())
    shorter = re.sub(r"--at \d+s?", "--at 9", command).replace("object/ball", "robot/r1")
    status = call(*shlex.split(shorter))
    # 1 on a processor that rounds in another way than the golden tape's
    assert status == 0 or command == "replay run.mcap"
    said = capsys.readouterr().out
    assert said or (tmp_path / "run.csv").stat().st_size > 1000


def test_the_tutorial_has_commands() -> None:
    assert {command.split()[0] for command in commands()} == {"status", "why", "replay", "tape"}
