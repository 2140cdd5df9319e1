"""A team of one's own, as docs/tutorial.md says, on fewer ticks; the whole path of a newcomer is tests/long/test_newcomer.py."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

from tests.files import ROOT
from tests.snippets import block


def test_the_tutorial_s_own_team_runs_is_explained_and_swept(tmp_path: Path) -> None:
    commands = block("tutorial.md", ".venv/bin/blackboard up").commands
    (tmp_path / "my-team.toml").write_text(block("tutorial.md", "[team]").text)
    said = []
    for command in commands:
        shorter = command.replace("--at 20s", "--at 9").replace("1..4", "3..3")
        length = [] if " why " in command else ["--seconds", "2"]
        words = [sys.executable, "-m", "blackboard", *shlex.split(shorter)[1:], *length, "--json"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode in (0, 1), done.stderr  # 1: so short a run need not PASS
        said.append(json.loads(done.stdout))
    card, _, sweep = said
    assert set(card["scores"]["robots"]["by_name"]) == {"ada", "bea", "cyd"}
    assert card["scores"]["objects"]["by_name"].keys() == {"box"}
    joint, opinions = (one["hashes"] for one in sweep["combinations"])
    assert joint == {"3": card["hash"]}  # the scenario's own seed and fusion
    assert opinions.keys() == {"3"}
    assert opinions != joint
