"""Who may load whom: a fresh interpreter imports a room and tells what it got; a re-export cannot fool it."""

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
BOARDS = {"blackboard.board", "blackboard.fusion", "blackboard.provenance", "blackboard.service"}


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(name: str) -> tuple[str, ...]:
    """The modules of a package, its door left out."""
    found = (module(path) for path in sources(name.replace(".", "/")) if path.name != "__main__.py")
    return tuple(found)


@cache
def loaded_by(*modules: str) -> frozenset[str]:
    """What a fresh interpreter has loaded after importing these modules, one after the other."""
    code = "import sys\n" + "".join(f"import {name}\n" for name in modules) + "print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return frozenset(done.stdout.split())


def inside(names: frozenset[str], *packages: str) -> set[str]:
    return {name for name in names if any(name == p or name.startswith(p + ".") for p in packages)}


@pytest.mark.parametrize("name", ["blackboard", "blackboard.opinion"])
def test_the_mathematics_loads_numpy_and_nothing_of_the_network(name: str) -> None:
    loaded = loaded_by(name) if name == "blackboard" else loaded_by(*room(name))
    assert not inside(loaded, "zenoh", "pydantic", "msgpack", "scipy", "matplotlib", "structlog", "cyclopts")
    assert inside(loaded, "blackboard") <= {"blackboard", "blackboard.errors", *room("blackboard.opinion")}


def test_the_wire_is_bytes() -> None:
    loaded = loaded_by(*room("blackboard.wire"))
    allowed = {"blackboard", "blackboard.errors", *room("blackboard.wire"), *room("blackboard.opinion")}
    assert not inside(loaded, "zenoh")
    assert inside(loaded, "blackboard") <= allowed


@pytest.mark.parametrize(("name", "other"), [("robot_agent", "sim_world"), ("sim_world", "robot_agent")])
def test_a_robot_and_a_world_share_the_wire_only(name: str, other: str) -> None:
    loaded = loaded_by(*room(name))
    assert not inside(loaded, "zenoh", other)
    assert not loaded & BOARDS


@pytest.mark.parametrize("name", sorted(BOARDS))
def test_a_board_knows_no_network(name: str) -> None:
    assert not inside(loaded_by(name), "zenoh", "robot_agent", "sim_world")


@pytest.mark.parametrize("package", PACKAGES)
def test_a_door_loads_its_own_package_only(package: str) -> None:
    loaded = loaded_by(f"{package}.__main__")
    assert not inside(loaded, *{"robot_agent", "sim_world"} - {package})
    if package != "blackboard":
        assert not loaded & BOARDS


# --- what is named where ---------------------------------------------------------------------------------------------


def names(path: Path) -> Iterator[str]:
    """Every module imported and every dotted name used in a file: `zenoh`, `time.sleep`, `np.random.default_rng`."""
    aliases = {"np": "numpy"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
            aliases |= {alias.asname: alias.name for alias in node.names if alias.asname}
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Attribute):
            head, *tail = ast.unparse(node).split(".")
            yield ".".join([aliases.get(head, head), *tail])


def users(banned: tuple[str, ...], *folders: str) -> set[str]:
    """The files that name something banned, or a part of it."""
    return {
        str(path.relative_to(ROOT))
        for path in sources(*folders)
        if any(name == ban or name.startswith(ban + ".") for name in names(path) for ban in banned)
    }


CLOCKS = ("time.time", "time.monotonic", "time.perf_counter", "datetime.datetime.now", "datetime.datetime.utcnow")
CHANCE = ("random", "secrets", "uuid", "numpy.random.default_rng", "numpy.random.seed", "numpy.random.RandomState")
DOORS = {*(f"{package}/__main__.py" for package in PACKAGES), "blackboard/lab/__main__.py"}


@pytest.mark.parametrize(
    ("banned", "only"),
    [
        (("zenoh",), {"blackboard/link.py"}),
        (("msgpack",), {"blackboard/wire/codec.py"}),
        (CLOCKS, {"blackboard/clock.py"}),
        (CHANCE, DOORS),
        (("blackboard.link",), DOORS | {"blackboard/door.py", "blackboard/launch.py"}),
    ],
    ids=["zenoh", "msgpack", "clocks", "chance", "Link"],
)
def test_it_is_named_in_one_place(banned: tuple[str, ...], only: set[str]) -> None:
    found = users(banned, *PACKAGES)
    assert found, "nothing names it: the search is broken"
    assert found <= only


def test_nothing_sleeps() -> None:
    assert users(("time.sleep",), *PACKAGES, "tests", "examples", "benchmarks") == set()
    assert users(("asyncio.sleep",), "tests") == set()
