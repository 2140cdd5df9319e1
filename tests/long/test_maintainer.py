"""CONTRIBUTING.md as a maintainer follows it, in a copy of the sources: a rule, a localizer and a message more, and what is made anew."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.files import ROOT
from tests.snippets import Block, block, blocks

pytestmark = pytest.mark.timeout(600)
PAGE = "CONTRIBUTING.md"
COPIED = ("blackboard", "robot_agent", "sim_world", "tests", "docs", "examples", "README.md", PAGE, "pyproject.toml")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources, with all that the page adds in its blocks of code."""
    where = tmp_path_factory.mktemp("copy")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, where / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, where / name)
    for code in blocks(PAGE):
        if code.language == "python":
            put(where, code)
    change(where, "blackboard/opinion/rules.py", r"(OWN = \{.*?)\}\n", r'\1    "halfway": "averages",\n}\n')
    change(where, "tests/opinion/test_laws.py", r"^(IDEMPOTENT = \{)", r'\1"halfway", ')  # "the sets of the laws"
    # "its name goes into `MODELS`"
    change(where, "blackboard/wire/messages.py", r"(MODELS: .*?)\)\n", r"\1, Battery)\n")
    example = (
        '    "battery": ({"team": "t", "sub_team": "a", "robot": "r1"}, Battery(robot="r1", time=0.6, seconds=60.0)),\n'
    )
    change(where, "tests/wire/messages.py", r"(EXAMPLES: .*?\n)\}\n", rf"\1{example}}}\n")
    change(where, "tests/wire/messages.py", r"(import \(\n)(    Clock)", r"\1    Battery,\n\2")
    for name, maker in (("messages", ["blackboard.run.messages"]), ("scenario", ["blackboard", "scenario"])):
        (where / "docs" / f"{name}.md").write_text(said(where, "-m", *maker), encoding="utf-8")
    return where


def put(where: Path, added: Block) -> None:
    """Add a block to the file that its first line names: `# FILE, at the end`, or `# FILE, before LINE`."""
    place = re.fullmatch(r"# (\S+), (at the end|before (.+))", added.first)
    assert place, added.first
    code = added.text.partition("\n")[2]
    file = where / place[1]
    text = file.read_text(encoding="utf-8")
    if place[3] is None:
        file.write_text(f"{text}\n\n{code}", encoding="utf-8")
        return
    assert text.count(f"\n{place[3]}") == 1
    file.write_text(text.replace(f"\n{place[3]}", f"\n{code}\n\n{place[3]}"), encoding="utf-8")


def change(where: Path, name: str, pattern: str, new: str) -> None:
    """Replace the one place of a file that a pattern finds."""
    file = where / name
    text, count = re.subn(pattern, new, file.read_text(encoding="utf-8"), count=1, flags=re.DOTALL | re.MULTILINE)
    assert count == 1, f"{name}: {pattern}"
    file.write_text(text, encoding="utf-8")


def said(where: Path, *arguments: str) -> str:
    """What Python says with these arguments and the sources of a folder; it must end with status 0."""
    environment = {**os.environ, "PYTHONPATH": str(where), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=where, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_what_the_page_adds_passes_the_tests_that_it_names(copy: Path) -> None:
    """The first one is `Run one test` of the page."""
    named = [command.split()[1:] for block in blocks(PAGE) for command in block.commands if " pytest " in command]
    assert len(named) == 4
    for arguments in named:
        assert re.search(r"^[1-9]\d* passed", said(copy, *arguments), re.MULTILINE)


def test_the_new_rule_and_localizer_and_message_are_there(copy: Path) -> None:
    code = (
        "from blackboard import POOLS; from robot_agent.localizers import known_localizers; from blackboard.wire.keys import parse;"
        "print('halfway' in POOLS, 'centre' in known_localizers(), parse('cop/t/a/battery/r1')[0].message)"
    )
    assert said(copy, "-c", code).split() == ["True", "True", "Battery"]
    assert "halfway" in (copy / "docs" / "scenario.md").read_text(encoding="utf-8")


def test_the_golden_tape_is_made_and_its_hash_told_as_the_page_says(copy: Path) -> None:
    (record,) = (c for c in block(PAGE, "blackboard scenario > docs/scenario.md     ").commands if "--record" in c)
    tape = copy / record.split()[-1]
    tape.unlink()
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    run = [sys.executable, "-m", *record.split()]
    assert subprocess.run(run, cwd=copy, env=environment, capture_output=True, check=False).returncode in (0, 1)
    assert tape.is_file()
    again = json.loads(said(copy, "-m", "blackboard", "replay", str(tape), "--json"))
    assert re.fullmatch(r"[0-9a-f]{64}", again["hash"])
