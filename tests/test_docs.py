"""The pages as a whole: every page has its place in the site, every link its target, and every command line is one."""

import re
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from cyclopts import App

import blackboard.__main__
import robot_agent.__main__
import sim_world.__main__
from tests.files import ROOT
from tests.snippets import MADE

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(p for p in (ROOT / "docs").glob("**/*.md") if p.name not in MADE),
]
APPS: dict[str, App] = {
    "blackboard": blackboard.__main__.app,
    "robot-agent": robot_agent.__main__.app,
    "sim-world": sim_world.__main__.app,
}
OURS = ("blackboard", "robot_agent", "sim_world", "tests", "examples", "benchmarks")
COMMAND = re.compile(
    r"^    (?:[a-z][\w-]*\$ +)?(?:\.venv/bin/)?((?:blackboard|robot-agent|sim-world) .+)$", re.MULTILINE
)


def lines() -> list[tuple[str, str]]:
    """Page and command line of every line of code that is a command of ours, without its comment; what goes on is joined."""
    long_lines = []
    for page in PAGES:
        text = re.sub(r" *\\\n +", " ", page.read_text(encoding="utf-8"))
        for line in COMMAND.findall(text):
            long_lines.append((page.name, re.split(r"\s+#|\s+[>|&]", line)[0].strip()))
    return long_lines


@pytest.mark.parametrize(("page", "line"), lines(), ids=lambda value: value)
def test_every_command_line_is_one(page: str, line: str) -> None:
    """Its flags are known and its values have their types; whether it does what it says is for the tests of single pages."""
    program, *words = shlex.split(line)
    APPS[program].parse_args(words, exit_on_error=False, print_error=False)


def test_there_are_command_lines_on_most_pages() -> None:
    assert len(lines()) > 60
    assert len({page for page, _ in lines()}) >= 8


def test_every_page_has_its_place_in_the_site() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    trees = re.findall(r"^:::\{toctree\}\n(?::[^\n]*\n)*\n(.*?)^:::$", index, re.MULTILINE | re.DOTALL)
    listed = [name for tree in trees for name in tree.split()]
    site, made = ROOT / "docs", {name.removesuffix(".md") for name in MADE}
    pages = {str(path.relative_to(site).with_suffix("")) for path in site.glob("**/*.md")} - {"index", *made}
    assert sorted(set(listed) - made) == sorted(pages)
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("module", ["board.lead", "process.team_clock", "process.rounds", "process.reactions"])
def test_a_module_with_a_table_prints_it(module: str) -> None:
    """As docs/conf.py takes it for the page of tables."""
    name = f"blackboard.{module}"
    done = subprocess.run([sys.executable, "-m", name], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip() == import_module(name).text().rstrip()
    assert name in (ROOT / "docs" / "conf.py").read_text(encoding="utf-8")


def test_every_file_that_a_page_names_is_there() -> None:
    """Of Python, as `tests/files.py`, `board/lead.py` or `limits.py`."""
    known = [f"/{file.relative_to(ROOT)}" for part in OURS for file in (ROOT / part).glob("**/*.py")]
    named = {name for page in PAGES for name in re.findall(r"`([\w/]+\.py)\b", page.read_text(encoding="utf-8"))}
    assert len(named) > 30
    assert [name for name in sorted(named) if not any(file.endswith(f"/{name}") for file in known)] == []


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links, as GitHub and myst do it."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_has_its_target(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        assert file.exists() or file.name in MADE, target
        if anchor and file.suffix == ".md":
            assert anchor in anchors(file), target
