"""Who may import whom: the sources against the one list (docs/design.md), and the list against a fresh interpreter."""

import ast
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests import rooms
from tests.files import ROOT, page
from tests.rooms import PACKAGES, ROOMS, broken, chain, full, imports, loaded_by, may_load, modules, room_of, sources

WORDS = {word.partition("@")[0] for room in ROOMS for word in f"{room.imports} {room.later}".split()}
LIBRARIES = WORDS - sys.stdlib_module_names - {"rich"}  # which cyclopts loads


def test_nothing_breaks_the_list() -> None:
    assert broken() == []


def test_exceptions_are_few_and_only_between_a_team_and_its_parts() -> None:
    assert len(rooms.EXCEPTIONS) <= 12
    assert {(room.split(".")[0], other.split(".")[0]) for room, other in rooms.EXCEPTIONS} == {
        ("blackboard", "robot_agent"),
        ("blackboard", "sim_world"),
    }


def test_every_room_has_modules() -> None:
    assert [
        name for room in ROOMS for name in room.names if not any(room_of(module) is room for module in modules())
    ] == []


def test_the_page_has_every_room() -> None:
    """A row that is no row would be left out, and what it allows with it."""
    head, _, *rows = [line for line in page("design.md").splitlines() if line.startswith("|")]
    assert head == "| room | what it holds | imports |"
    assert len(rows) == len(ROOMS) > 40


@pytest.mark.parametrize(
    "room",
    [
        "blackboard",
        "opinion",
        "judge",
        "tape",
        "view",
        "commands",
        "robot_agent.__main__",
        "sim_world.__main__",
        "__main__",
    ],
)
def test_a_fresh_interpreter_loads_what_the_list_says(room: str) -> None:
    """So no name that is only looked up at run time, and no package that imports its modules, loads anything else."""
    loaded = loaded_by(room)
    # An empty package is loaded with what is in it.
    names = {
        owner.names[0] for name in loaded & modules().keys() if imports(name) and (owner := room_of(name)) is not None
    }
    names |= {name.partition(".")[0] for name in loaded} & LIBRARIES
    more = names - may_load(room) - {"blackboard"}
    assert {name: chain(full(room), [name], late=False) for name in more} == {}


MACHINES = ("robot_agent", "sim_world", "board", "judge", "opinion", "wire", "process", "state", "view")


@pytest.mark.parametrize("room", MACHINES)
def test_no_machine_loads_a_clock_or_a_network(room: str) -> None:
    assert not may_load(room) & {"blackboard.process.clock", "blackboard.process.loop", "blackboard.net", "zenoh"}


@pytest.mark.parametrize(("name", "other"), [("robot_agent", "sim_world"), ("sim_world", "robot_agent")])
def test_a_robot_and_a_world_never_load_each_other_or_a_board(name: str, other: str) -> None:
    assert not (may_load(name) | may_load(f"{name}.__main__")) & {other, "blackboard.board"}


def test_a_health_check_and_a_link_load_neither_arrays_nor_models() -> None:
    """Containers ask every few seconds, and NumPy and pydantic cost a third of a second of a core each time."""
    code = "import sys, blackboard.__main__, blackboard.run.health\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"numpy", "pydantic", "asyncio", "rich"} & set(done.stdout.split())


# --- whether the search finds anything --------------------------------------------------------------------------------


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], None]]:
    """A function that writes a module of a project of its own, of which the list is held to be true."""
    monkeypatch.setattr(rooms, "ROOT", tmp_path)
    monkeypatch.setattr(rooms, "EXCEPTIONS", set())

    def write(file: str, content: str) -> None:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(content)
        forget()

    def forget() -> None:
        modules.cache_clear()
        rooms.imports.cache_clear()

    forget()
    yield write
    forget()


def faults() -> list[str]:
    """What breaks the list, but for what it allows to no purpose."""
    return [fault for fault in broken() if not fault.endswith("does not")]


@pytest.mark.parametrize(
    ("file", "line", "fault"),
    [
        (
            "board/x.py",
            "import blackboard.net.link",
            "blackboard/board/x.py:2 imports blackboard.net.link, which board may not",
        ),
        (
            "board/x.py",
            "def f():\n    from blackboard.net import link",
            "blackboard/board/x.py:3 imports blackboard.net.link",
        ),
        (
            "view/__main__.py",
            "import blackboard.tape.file",
            "imports blackboard.tape.file, which view.__main__ may not",
        ),
        ("view/source.py", "from blackboard.tape.file import x", "which view.source may not when it is loaded"),
        ("wire/codec.py", "import msgpack", "blackboard/wire/codec.py:2 imports msgpack, which wire may not"),
        ("process/x.py", "import time", "blackboard/process/x.py:2 imports time, which process may not"),
        ("process/x.py", "import scipy.linalg", "imports scipy, which process may not"),
        ("judge/x.py", "from sim_world.world import World", "imports sim_world.world, which judge may not"),
        ("nowhere/x.py", "", "blackboard.nowhere.x is in no room"),
    ],
)
def test_an_import_that_is_not_allowed_is_named_with_its_place(
    written: Callable[[str, str], None], file: str, line: str, fault: str
) -> None:
    for other in ("blackboard/net/link.py", "blackboard/tape/file.py", "sim_world/world.py"):
        written(other, "")
    written(f"blackboard/{file}", f"import math, numpy\n{line}\n")
    assert fault in faults()[0]


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("board/x.py", "import blackboard.wire.raw, blackboard.board.y"),
        ("wire/raw.py", "import msgpack"),
        ("view/source.py", "def f():\n    from blackboard.tape import file"),
        ("process/clock.py", "import time"),
    ],
)
def test_what_is_allowed_is_not(written: Callable[[str, str], None], file: str, line: str) -> None:
    for other in ("blackboard/tape/file.py", "blackboard/board/y.py", "blackboard/wire/raw.py"):
        written(other, "")
    written(f"blackboard/{file}", f"{line}\n")
    assert faults() == []


def test_a_circle_is_shown_once_also_where_a_function_closes_it(written: Callable[[str, str], None]) -> None:
    written("blackboard/wire/a.py", "from blackboard.wire import b\n")
    written("blackboard/wire/b.py", "import blackboard.wire.c\n")
    written("blackboard/wire/c.py", "def f():\n    from blackboard.wire.a import x\n")
    written("blackboard/wire/d.py", "import blackboard.wire.a\n")
    circle = "blackboard.wire.a -> blackboard.wire.b -> blackboard.wire.c -> blackboard.wire.a"
    assert faults() == [circle]


# --- what the tests may not do ----------------------------------------------------------------------------------------


def test_nothing_sleeps() -> None:
    sleepers = []
    for path in sources(*PACKAGES, "tests", "examples", "benchmarks"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        named = {
            ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr == "sleep"
        }
        named |= {
            f"{node.module}.{alias.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        asleep = {"time.sleep"} | ({"asyncio.sleep"} if path.is_relative_to(ROOT / "tests") else set())
        if named & asleep:
            sleepers.append(path)
    assert sleepers == []
