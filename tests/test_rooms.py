"""Who may import whom: one allow-list of rooms, held against the sources and against what a fresh interpreter loads.

The sources show every import, also one inside a function. A fresh interpreter that imports a room lists what came with it, so a
re-export cannot hide anything. The same list stands in pyproject.toml for import-linter, which draws the chain where one is broken.
Long, because the list and every law over it stand side by side.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("blackboard", "robot_agent", "sim_world")

ERRORS, PLUGINS, CONFIG = "blackboard.errors", "blackboard.plugins", "blackboard.config"
OPINION, WIRE, PROCESS = "blackboard.opinion", "blackboard.wire", "blackboard.process"
CLOCK, LOOP = "blackboard.process.clock", "blackboard.process.loop"
BOARD, NET, RUN, LAB = "blackboard.board", "blackboard.net", "blackboard.run", "blackboard.lab"
STATE, SOURCE, JUDGE = "blackboard.state", "blackboard.view.source", "blackboard.judge"
VIEW, WEB, TUI = "blackboard.view", "blackboard.view.web", "blackboard.view.tui"
TAPE, BRIDGES, ROS = "blackboard.tape", "blackboard.bridges", "blackboard.bridges.ros"
ACCESS = "blackboard.access"
FAULTS, CHAOS = "blackboard.faults", "blackboard.chaos"
CLIENT = "blackboard.client"
TABLES, COMMANDS = "blackboard.tables", "blackboard.commands"
SHARED = {
    ERRORS,
    PLUGINS,
    CONFIG,
    TABLES,
    FAULTS,
    OPINION,
    WIRE,
    PROCESS,
}  # for machines and services; neither a clock nor a network

#: Room -> the rooms that it may import besides itself. A door is a room of its own; so are the clock and the loop that reads it.
ALLOWED: dict[str, set[str]] = {
    ERRORS: set(),
    PLUGINS: {ERRORS},
    OPINION: {ERRORS, PLUGINS},
    WIRE: {ERRORS, OPINION},
    TABLES: {ERRORS},
    CONFIG: {ERRORS, OPINION, WIRE, TABLES},
    FAULTS: {ERRORS, CONFIG, WIRE},
    PROCESS: {ERRORS, WIRE},
    CLOCK: set(),
    LOOP: {PROCESS, CLOCK, WIRE},
    BOARD: SHARED,
    ACCESS: {ERRORS, WIRE, CONFIG, CLOCK},
    NET: {ERRORS, WIRE, CLOCK, ACCESS, PROCESS},
    RUN: {*SHARED, ACCESS, NET, CLOCK, LOOP, STATE, "blackboard"},
    JUDGE: SHARED,
    TAPE: {*SHARED, JUDGE, BOARD, NET, "sim_world"},
    LAB: {*SHARED, JUDGE, BOARD, NET, RUN, CLOCK, "robot_agent", "sim_world"},
    CLIENT: {*SHARED, BOARD, NET, CLOCK, LOOP},
    STATE: SHARED,
    VIEW: {*SHARED, STATE, BOARD},
    WEB: {*SHARED, STATE, VIEW},
    TUI: {*SHARED, STATE, VIEW},
    BRIDGES: {*SHARED, STATE, VIEW},
    ROS: {*SHARED, STATE, VIEW, CLIENT},
    CHAOS: {*SHARED, JUDGE, NET, RUN},
    "blackboard": {ERRORS, OPINION},
    "robot_agent": SHARED,
    "sim_world": {*SHARED, JUDGE},
    "blackboard.__main__": {RUN},
    COMMANDS: {*SHARED, JUDGE, BOARD, TAPE, LAB, RUN, "robot_agent", "sim_world"},
    "blackboard.lab.__main__": {*SHARED, JUDGE, LAB, RUN},
    SOURCE: {*SHARED, STATE, VIEW, TAPE, NET, RUN, CLOCK},
    "blackboard.view.__main__": {*SHARED, STATE, VIEW, SOURCE, WEB, TUI, NET, RUN, CLOCK},
    "blackboard.client.__main__": {*SHARED, CLIENT, NET, RUN, CLOCK, LOOP},
    "blackboard.bridges.__main__": {*SHARED, BRIDGES, ROS, STATE, VIEW, SOURCE, CLIENT, NET, RUN, CLOCK, LOOP},
    "blackboard.chaos.__main__": {*SHARED, CHAOS, RUN},
    "blackboard.tape.__main__": {*SHARED, JUDGE, TAPE, NET, RUN, CLOCK},
    "robot_agent.__main__": {*SHARED, RUN, "robot_agent"},
    "sim_world.__main__": {*SHARED, JUDGE, RUN, "sim_world"},
}

#: Libraries -> the rooms that may load them; everybody may load the standard library, numpy, and what is not named here.
LIBRARIES = {
    "pydantic": set(ALLOWED) - {ERRORS, PLUGINS, OPINION, CLOCK, "blackboard"},
    "msgpack": set(ALLOWED) - {ERRORS, PLUGINS, OPINION, CONFIG, CLOCK, "blackboard"},
    "zenoh": {
        NET,
        CLIENT,
        ROS,
        RUN,
        LAB,
        SOURCE,
        "blackboard.__main__",
        COMMANDS,
        "blackboard.lab.__main__",
        "blackboard.view.__main__",
        "blackboard.tape.__main__",
        "blackboard.client.__main__",
        "blackboard.bridges.__main__",
        CHAOS,
        "blackboard.chaos.__main__",
        "robot_agent.__main__",
        "sim_world.__main__",
    },
    "matplotlib": {LAB},
    "starlette": {WEB},
    "uvicorn": {WEB},
    "websockets": {WEB},
    "textual": {TUI},
    "foxglove": set[str](),
    "rerun": set[str](),
    "rosbags": {ROS},
    "xxhash": {ROS},
    "pyarrow": set[str](),
    "mcap": {TAPE, "blackboard.tape.__main__"},
    "cryptography": {ACCESS},
    "scipy": set[str](),
}


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(name: str) -> str | None:
    """The room of a module, or of a name in it: the longest that fits. The plain package `blackboard` is a room by itself."""
    fits = [
        r for r in ALLOWED if name == r or (name.startswith(r + ".") and (r != "blackboard" or name.count(".") == 1))
    ]
    return max(fits, key=len, default=None)


def modules_of(a_room: str) -> tuple[str, ...]:
    return tuple(name for path in sources(*PACKAGES) if room(name := module(path)) == a_room)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> Iterator[str]:
    """Every module, or name of a module, that a file imports, wherever in the file."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def loaded_by(a_room: str) -> frozenset[str]:
    """What a fresh interpreter has loaded after importing every module of a room."""
    code = "import sys\n" + "".join(f"import {name}\n" for name in modules_of(a_room)) + "print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return frozenset(done.stdout.split())


def closure(a_room: str) -> set[str]:
    """The rooms that may be loaded with a room: those that it may import, and in turn theirs."""
    found, todo = set[str](), {a_room}
    while todo:
        found |= todo
        todo = {other for one in todo for other in ALLOWED[one]} - found
    packages = {one.rpartition(".")[0] for one in found}  # those that hold a room are imported with it
    return found | (packages & ALLOWED.keys())


def test_every_module_has_a_room() -> None:
    assert [path for path in sources(*PACKAGES) if room(module(path)) is None] == []
    assert all(modules_of(a_room) for a_room in ALLOWED)


@pytest.mark.parametrize("a_room", ALLOWED)
def test_a_room_imports_what_it_may(a_room: str) -> None:
    for path in sources(*PACKAGES):
        if room(module(path)) == a_room:
            rooms = {found for name in imports(path) if (found := room(name)) is not None}
            assert rooms <= ALLOWED[a_room] | {a_room}, path


@pytest.mark.parametrize("a_room", ALLOWED)
def test_a_room_loads_what_it_may(a_room: str) -> None:
    loaded = loaded_by(a_room)
    assert {found for name in loaded if (found := room(name)) is not None} <= closure(a_room) | closure("blackboard")
    tops = {name.split(".")[0] for name in loaded}
    assert {library for library in LIBRARIES if library in tops} <= {
        library for library, rooms in LIBRARIES.items() if a_room in rooms
    }


@pytest.mark.parametrize("a_room", ["robot_agent", "sim_world", BOARD, JUDGE, OPINION, WIRE, PROCESS, STATE, VIEW])
def test_no_machine_loads_a_clock(a_room: str) -> None:
    assert not loaded_by(a_room) & {CLOCK, LOOP}


@pytest.mark.parametrize(("name", "other"), [("robot_agent", "sim_world"), ("sim_world", "robot_agent")])
def test_a_robot_and_a_world_never_load_each_other_or_a_board(name: str, other: str) -> None:
    for a_room in (name, f"{name}.__main__"):
        assert not {m for m in loaded_by(a_room) if m == other or m.startswith((f"{other}.", BOARD))}


def test_the_launchers_door_loads_robots_and_worlds_only_when_it_runs_them() -> None:
    assert not {m for m in loaded_by(COMMANDS) if m.startswith(("robot_agent", "sim_world"))}


def test_a_health_check_and_a_link_load_neither_arrays_nor_models() -> None:
    """Containers ask every few seconds, and NumPy and pydantic cost a third of a second of a core each time."""
    code = "import sys, blackboard.__main__, blackboard.run.health\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"numpy", "pydantic", "asyncio", "rich"} & set(done.stdout.split())


# --- what is named where ---------------------------------------------------------------------------------------------


@cache
def names(path: Path) -> frozenset[str]:
    """Every module imported and every dotted name used in a file: `zenoh`, `time.sleep`, `np.random.default_rng`."""
    nodes = list(ast.walk(parsed(path)))
    aliases = {"np": "numpy"}
    for node in nodes:
        if isinstance(node, ast.Import):
            aliases |= {alias.asname: alias.name for alias in node.names if alias.asname}
    used = (dotted(node, aliases) for node in nodes if isinstance(node, ast.Attribute))
    return frozenset([*imports(path), *(name for name in used if name)])


def dotted(node: ast.expr, aliases: dict[str, str]) -> str:
    """A name with the names of its attributes; empty for an attribute of what has no name, such as a call."""
    if isinstance(node, ast.Attribute):
        head = dotted(node.value, aliases)
        return head and f"{head}.{node.attr}"
    return aliases.get(node.id, node.id) if isinstance(node, ast.Name) else ""


def users(banned: tuple[str, ...], *folders: str) -> set[str]:
    """The files that name something banned, or a part of it."""
    return {
        str(path.relative_to(ROOT))
        for path in sources(*folders)
        if any(name == ban or name.startswith(ban + ".") for name in names(path) for ban in banned)
    }


CHANCE = ("random", "secrets", "uuid", "numpy.random.default_rng", "numpy.random.seed", "numpy.random.RandomState")
DOORS = {
    *(f"{package}/__main__.py" for package in PACKAGES),
    "blackboard/commands.py",
    "blackboard/lab/__main__.py",
    "blackboard/view/__main__.py",
    "blackboard/tape/__main__.py",
    "blackboard/bridges/__main__.py",
    "blackboard/chaos/__main__.py",
    "blackboard/client/__main__.py",
}


@pytest.mark.parametrize(
    ("banned", "only"),
    [
        (("zenoh",), {f"blackboard/net/{name}.py" for name in ("attached", "link", "settings")}),
        (("msgpack",), {"blackboard/wire/raw.py"}),
        (("mcap", "zstandard"), {"blackboard/tape/file.py"}),
        (("cryptography",), {"blackboard/access/authority.py"}),
        (CHANCE, DOORS | {"sim_world/sources.py"}),
        (
            ("blackboard.net.link",),
            DOORS
            | {
                f"blackboard/{n}.py"
                for n in (
                    "client/team",
                    "net/attached",
                    "run/door",
                    "run/gate",
                    "run/health",
                    "run/launch",
                    "chaos/team",
                    "view/source",
                )
            },
        ),
    ],
    ids=["zenoh", "msgpack", "mcap", "cryptography", "chance", "Link"],
)
def test_it_is_named_in_one_place(banned: tuple[str, ...], only: set[str]) -> None:
    found = users(banned, *PACKAGES)
    assert found, "nothing names it: the search is broken"
    assert found <= only


def test_the_clock_is_read_in_one_place() -> None:
    """Neither `time` nor `datetime` is imported elsewhere, under whatever name and with whichever function."""
    readers = {
        str(path.relative_to(ROOT))
        for path in sources(*PACKAGES)
        if {name.split(".")[0] for name in imports(path)} & {"time", "datetime"}
    }
    assert readers == {"blackboard/process/clock.py"}


def test_a_long_file_says_why() -> None:
    """More than 250 lines are for files that say so, and why, in their first lines."""
    silent = [
        str(path.relative_to(ROOT))
        for path in sources(*PACKAGES, "tests", "examples", "benchmarks")
        if len(lines := path.read_text(encoding="utf-8").splitlines()) > 250
        and "Long, because" not in "".join(lines[:8])
    ]
    assert silent == []


def test_nothing_sleeps() -> None:
    assert users(("time.sleep",), *PACKAGES, "tests", "examples", "benchmarks") == set()
    assert users(("asyncio.sleep",), "tests") == set()
