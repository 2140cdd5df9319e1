"""docs/research.md as a researcher follows it: its commands one after the other, on a smaller team and for a shorter time."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from blackboard.judge.samples import read_series
from tests.files import ROOT
from tests.snippets import block

PAGE = re.sub(r" *\\\n +", " ", (ROOT / "docs" / "research.md").read_text(encoding="utf-8"))
COMMANDS = re.findall(r"^    blackboard (.+)$", PAGE, re.MULTILINE)


def draw(where: Path) -> None:
    """Run the page's lines of Python there, and compare what they compute with the table that they read."""
    code = block("research.md", "import pandas").text + "\nprint(held['agreed'], robots['error'].mean())\n"
    settings = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=where, env=settings, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    rows = [sample for sample in read_series(where / "run.csv") if sample.subject.startswith("robot/")]
    agreed = [sample.region < 0.95 for sample in rows if sample.level == "agreed"]
    held, error = map(float, done.stdout.split())
    assert held == pytest.approx(sum(agreed) / len(agreed))
    assert error == pytest.approx(sum(sample.error for sample in rows) / len(rows))
    assert "mean error, cells" in (where / "error.svg").read_text()


def test_every_command_of_the_page_does_what_it_says(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra `plot`")
    pytest.importorskip("pandas", reason="the page's figure is made with pandas")
    assert [command.split()[0] for command in COMMANDS] == ["demo", "sweep"]
    for command in COMMANDS:
        shorter = command.replace("--seconds 20", "--seconds 1 --robots 2").replace("1..20", "1..2")
        assert shorter.count("--robots") == 1
        line = [sys.executable, "-m", "blackboard", *shlex.split(shorter)]
        done = subprocess.run(
            line, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
        )
        assert done.returncode in (0, 1), done.stderr  # 1: so short a run need not PASS
        assert "RMSE" in done.stdout
    assert {sample.robot for sample in read_series(tmp_path / "run.csv")} == {"r1", "r2"}
    assert len((tmp_path / "sweep.jsonl").read_text().splitlines()) == 2 * 4
    assert (tmp_path / "sweep.csv").read_text().startswith("board_rule,world_vision_gain,seed,group,level")
    draw(tmp_path)
    drawn = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert drawn == {f"{name}.{ending}" for name in ("over-time", "trajectories", "sweep") for ending in ("svg", "png")}
