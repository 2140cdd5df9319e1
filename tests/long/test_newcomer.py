"""The newcomer's path: README.md, docs/tutorial.md and docs/hosts.md from a clone on, their commands one after the other in the clone itself.

What docs/tutorial.md says runs with the wheel in an empty environment elsewhere. Only its tape and its sweep are shorter: `make demo` in
the clone is the same run at its full length.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from blackboard.judge.card import NOT_AGAIN
from blackboard.run.launch import free_port
from tests import processes
from tests.files import ROOT
from tests.processes import Program, wait_until
from tests.snippets import block, blocks

pytestmark = pytest.mark.timeout(2400)


def environment() -> dict[str, str]:
    """Ours, without what would lead a program to our own sources or environment."""
    ours = ("PYTHONPATH", "VIRTUAL_ENV", "VENV", "MAKEFLAGS", "MAKELEVEL", "BLACKBOARD_PARENT")
    return {key: value for key, value in os.environ.items() if key not in ours}


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that git knows or would add, as they are now, in a folder of their own."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("needs git, and a clone of its own")
    where = tmp_path_factory.mktemp("clone")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file():
            (where / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, where / name)
    return where


def shell(clone: Path, command: str, statuses: Sequence[int] = (0,)) -> str:
    """What a command line says on standard output."""
    done = subprocess.run(
        f"exec {command}", shell=True, cwd=clone, env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode in statuses, f"{command}: {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout


@contextmanager
def started(clone: Path, command: str) -> Iterator[Program]:
    """A command line that runs until it is stopped by Ctrl-C."""
    with processes.command("/bin/sh", "-c", f"exec {command}", cwd=clone, environment=environment()) as program:
        yield program
        program.running.send_signal(signal.SIGINT)
        program.ends()


def page(program: Program) -> str:
    """The HTML of the live page that a program serves; its address is in the program's log."""
    address = r"http://127\.0\.0\.1:\d+/"
    wait_until(
        lambda: re.search(address, program.out + program.err), lambda: f"it tells an address: {program.err}", 60.0
    )
    match = re.search(address, program.out + program.err)
    assert match
    with urllib.request.urlopen(match[0], timeout=30) as answer:
        text: str = answer.read().decode()
    return text


@pytest.fixture(scope="module")
def made(clone: Path) -> tuple[Path, str]:
    """The clone after its first `make demo`, and what that said."""
    demo, test = block("README.md", "make demo").commands
    assert (demo, test) == ("make demo", "make test")
    return clone, shell(clone, demo)


def may_differ(said: str) -> float:
    """By how much a number may differ after a run that said so: a slow host may end a wait, and then a run is another one."""
    return 0.1 if NOT_AGAIN in said else 0.005


def assert_told(shown: str, said: str, off: float) -> None:
    """What a page shows is what was printed; numbers may be `off`."""
    number = r"-?\d+\.\d+"
    assert re.sub(number, "#", shown) == re.sub(number, "#", said)
    pairs = zip(re.findall(number, shown), re.findall(number, said), strict=True)
    assert [(a, b) for a, b in pairs if abs(float(a) - float(b)) > off] == []


def test_make_demo_in_a_clone(made: tuple[Path, str]) -> None:
    """README.md's first command ends with a PASS, and with the columns and rows that the page shows."""
    _, said = made
    assert "\nPASS" in said
    head, *rows = block("README.md", " " * 20).text.splitlines()
    assert head.split() in [line.split() for line in said.splitlines()]
    for row in rows:
        shown = re.search(rf"^{' '.join(row.split()[:2])} +\d+ .*", said, re.MULTILINE)
        assert shown
        assert_told(" ".join(row.split()), " ".join(shown[0].split()[: len(row.split())]), may_differ(said))


def follow_the_tutorial(where: Path) -> None:
    """Its commands one after the other in a folder whose `.venv` has the package with the extras of the page."""
    for code in blocks("tutorial.md"):
        if code.language == "toml":
            (where / "my-team.toml").write_text(code.text)
        for command in code.commands if code.language == "shell" else ():
            if command == "make demo" or "pip install" in command:
                continue  # the fixtures do it
            if " view " in command:
                with started(where, f"{command} --port {free_port()}") as viewer:
                    assert "<title>" in page(viewer)
            elif " sweep " in command:
                shell(where, f"{command} --seconds 5", (0, 1))  # 1: so short a run need not PASS
            else:
                recorded = " demo --record" in command
                said = shell(where, f"{command} --seconds 21", (0, 1)) if recorded else shell(where, command)
                if recorded:
                    off = may_differ(said)
                if " why robot/r1 " in command:
                    shown = block("tutorial.md", "robot/r1 is believed").text
                    assert_told(shown, "".join(said.splitlines(keepends=True)[:2]), off)
                assert said or "--out" in command, command
    assert (where / "run.csv").stat().st_size > 10_000


def test_the_tutorial_from_its_first_to_its_last_line(clone: Path, tmp_path: Path) -> None:
    """With the wheel in an empty environment, in a folder that has nothing of the repository. What README.md names is among its commands."""
    _, install, *_ = block("tutorial.md", "make demo").commands
    readme, record, why = block("README.md", ".venv/bin/pip install -e '.[record").commands
    assert install == readme
    (extras,) = re.findall(r"-e '\.(\[.+\])'$", install)
    shell(tmp_path, f"{sys.executable} -m venv .venv")
    shell(tmp_path, f".venv/bin/pip wheel --quiet --no-deps --wheel-dir dist {clone}")
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    shell(tmp_path, f".venv/bin/pip install --quiet '{wheel}{extras}'")
    assert shell(tmp_path, ".venv/bin/python -c 'import blackboard; print(blackboard.__file__)'").startswith(
        str(tmp_path)
    )
    assert {record, why} < {command for code in blocks("tutorial.md") for command in code.commands}
    follow_the_tutorial(tmp_path)


def test_what_it_believes_and_why(made: tuple[Path, str]) -> None:
    clone, _ = made
    install, record, why = block("README.md", ".venv/bin/pip install -e '.[record").commands
    view = ".venv/bin/blackboard view run.mcap"
    assert f"`{view}`" in (clone / "README.md").read_text()
    shell(clone, install)
    with started(clone, ".venv/bin/blackboard demo --view --realtime --seconds 300") as demo:  # docs/tutorial.md
        assert "<title>" in page(demo)
    (clone / "run.mcap").unlink(missing_ok=True)
    shell(clone, f"{record} --seconds 2", (0, 1))  # 1: so short a run need not PASS
    with started(clone, f"{view} --port {free_port()}") as viewer:
        assert "<title>" in page(viewer)
    assert shell(clone, why.replace(" 20s", " 1s")).startswith("robot/r1 is believed to be at (")


def test_each_process_by_hand(made: tuple[Path, str]) -> None:
    """Router, boards, robots, each as docs/hosts.md starts it: each says that it is ready. The world then runs to its end."""
    clone, _ = made
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    world = "sim-world team.toml -e tcp/base:7447"
    assert f"`{world}`" in (clone / "docs/hosts.md").read_text()

    def here(command: str) -> str:
        places = {"tcp/0.0.0.0:7447": endpoint, "tcp/base:7447": endpoint, "team.toml": "demo"}
        for there, place in places.items():
            command = command.replace(there, place)
        return f".venv/bin/{command}"

    with ExitStack() as running:
        for command in block("hosts.md", "base$    blackboard router").commands:
            running.enter_context(started(clone, here(command))).says("ready")
        running.enter_context(started(clone, here(world))).says("ready")
