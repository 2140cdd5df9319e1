"""Who may import whom: the list of docs/design.md. `python -m tests.rooms` prints what breaks it.

The sources are read, not run. An import inside a function, or for types alone, is one that is made later; what a module loads when it
is imported follows from the others. tests/test_rooms.py holds the sources to the list, and a fresh interpreter to what it says.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.files import ROOT, page

PACKAGES = ("blackboard", "robot_agent", "sim_world")
#: Every module may import the standard library and these; of the standard library not what reads a clock or draws at random.
FREE = {*sys.stdlib_module_names, "numpy"} - {"time", "datetime", "random", "secrets", "uuid"}


@dataclass(frozen=True)
class Room:
    """Some modules with one purpose, and what they may import besides each other: rooms, and libraries.

    `modules` are its module or package, as `wire`, or several, with those below them that are in no other room. A library that
    only some modules may name has their names, as `zenoh@link,settings`. `later` is imported only when it is asked for.
    """

    modules: str
    imports: str = ""
    later: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(full(name) for name in self.modules.split())

    def allows(self, target: str, late: bool, module: str) -> bool:
        """Whether a module of this room may import another room (its first name) or a library."""
        for word in f"{self.imports} {self.later if late else ''}".replace("shared", SHARED).split():
            name, _, only = word.partition("@")
            if target in (name, full(name)) and (not only or module.rpartition(".")[2] in only.split(",")):
                return True
        return False


ROW = re.compile(r"^\| (`[^|]*) \| ([^|]*) \| ([^|]*) \|$", re.MULTILINE)


def listed(text: str) -> tuple[Room, ...]:
    """The rooms of the table of docs/design.md, from the bottom to the top: a room imports only rooms that stand above it."""
    rooms = []
    for names, _, imported in ROW.findall(text):
        modules = re.sub("[`,]", "", names).replace("/ ", " ").rstrip("/").replace("/", ".")
        now, _, later = imported.partition("(")
        rooms.append(Room(modules, now.strip(" -"), later.rstrip(")")))
    return tuple(rooms)


ROOMS = listed(page("design.md"))
#: What machines and services may import: neither a clock nor a network.
SHARED = re.findall(r"^shared: ([a-z ]+)\.", page("design.md"), re.MULTILINE)[0]

#: What a room may not import, and one module does, to run a whole team in one process: module -> module.
EXCEPTIONS = {
    ("blackboard.client.robot", "robot_agent.driven"),  # a program's own robot, loaded when it joins
    ("blackboard.commands", "robot_agent.config"),  # every section is validated before anything starts
    ("blackboard.lab.ideal", "robot_agent.gaussian.ideal"),
    ("blackboard.lab.ideal", "sim_world.sensors"),
    ("blackboard.lab.team", "robot_agent.team"),
    ("blackboard.lab.team", "sim_world.service"),
    ("blackboard.lab.team", "sim_world.sources"),
    ("blackboard.lab.team_cases", "robot_agent.team"),
    ("blackboard.lab.team_cases", "sim_world.sources"),
    ("blackboard.lab.team_joint", "robot_agent.team"),
}


class Import(NamedTuple):
    """A line of a module that imports a module of the project, or a library."""

    module: str
    target: str
    late: bool
    line: int


def full(name: str) -> str:
    """The dotted name of a module or package of the list."""
    return name if name.partition(".")[0] in PACKAGES else f"blackboard.{name}"


def sources(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


@cache
def modules() -> Mapping[str, Path]:
    """Every module of the packages."""

    def name(path: Path) -> str:
        parts = path.relative_to(ROOT).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    return {name(path): path for path in sources(*PACKAGES)}


@cache
def room_of(module: str) -> Room | None:
    """The room of a module: that of the longest name that fits. Below the plain package `blackboard` nothing is in its room."""
    fits = [
        (len(name), room)
        for room in ROOMS
        for name in room.names
        if module == name or (module.startswith(f"{name}.") and name != "blackboard")
    ]
    return max(fits, key=lambda fit: fit[0])[1] if fits else None


@cache
def imports(module: str) -> tuple[Import, ...]:
    """What a module imports of the project, and of libraries that are not free."""
    made = set[Import]()
    for name, late, line in _imported(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        target = name
        while target and target not in modules():
            target = target.rpartition(".")[0]
        target = target or name.split(".")[0]
        if target != module and target not in FREE:
            made.add(Import(module, target, late, line))
    return tuple(sorted(made, key=lambda imported: (imported.line, imported.target)))


def _imported(node: ast.AST, late: bool = False) -> Iterator[tuple[str, bool, int]]:
    """Every module, or name in one, that is imported below a node; whether later than the module itself; and the line."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from ((alias.name, late, child.lineno) for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module:
            yield from ((f"{child.module}.{alias.name}", late, child.lineno) for alias in child.names)
        inside = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        types = isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING")
        yield from _imported(child, late or inside or types)


# --- what breaks the list ---------------------------------------------------------------------------------------------


def broken() -> list[str]:
    """A line for each import that the list does not allow, for what it allows to no purpose, and for each circle of imports."""
    order = {room: place for place, room in enumerate(ROOMS)}
    faults = [f"{room.modules} stands above {other.modules}, which it may import" for room, other in _upwards(order)]
    for module in modules():
        room = room_of(module)
        if room is None:
            faults.append(f"{module} is in no room")
            continue
        for imported in imports(module):
            target = _place(imported.target)
            allowed = target in room.names or room.allows(target, imported.late, module)
            if not allowed and (module, imported.target) not in EXCEPTIONS:
                faults.append(
                    f"{_where(imported)}, which {room.modules} may not"
                    + (" when it is loaded" if not imported.late else "")
                )
    return [*faults, *_idle(), *(" -> ".join(circle) for circle in circles())]


def _idle() -> Iterator[str]:
    """A line for each import that a room may make, and each exception, that no module makes; what is shared may be left alone."""
    made = [imported for module in modules() for imported in imports(module)]
    for room in ROOMS:
        for word in f"{room.imports} {room.later}".split():
            only = Room(room.modules, word)
            if word != "shared" and not any(
                room_of(imported.module) is room and only.allows(_place(imported.target), True, imported.module)
                for imported in made
            ):
                yield f"{room.modules} may import {word}, and does not"
    yield from (
        f"{module} may import {target}, and does not"
        for module, target in EXCEPTIONS - {(imported.module, imported.target) for imported in made}
    )


def _place(target: str) -> str:
    """The first name of the room of a module, or the library."""
    room = room_of(target) if target in modules() else None
    return room.names[0] if room else target


def _upwards(order: Mapping[Room, int]) -> Iterator[tuple[Room, Room]]:
    by_name = {name: room for room in ROOMS for name in room.names}
    for room in ROOMS:
        for word in f"{room.imports} {room.later}".replace("shared", SHARED).split():
            other = by_name.get(full(word.partition("@")[0]))
            if other is not None and order[other] > order[room]:
                yield room, other


def _where(imported: Import) -> str:
    return f"{modules()[imported.module].relative_to(ROOT)}:{imported.line} imports {imported.target}"


def circles() -> list[list[str]]:
    """A shortest circle of imports through each module that is in one, but for those that another circle shows already."""
    all_circles, visited = list[list[str]](), set[str]()
    for module in modules():
        way = None if module in visited else chain(module, {module})
        if way is not None:
            all_circles.append(way)
            visited |= set(way)
    return all_circles


def chain(module: str, targets: Iterable[str], late: bool = True) -> list[str] | None:
    """A shortest way of imports, at least one, from a module to one of some others; None where there is none."""
    wanted, ways, known = set(targets), [[module]], {module}
    while ways:
        way = ways.pop(0)
        for imported in imports(way[-1]):
            if imported.target in modules() and (late or not imported.late):
                if imported.target in wanted:
                    return [*way, imported.target]
                if imported.target not in known:
                    known.add(imported.target)
                    ways.append([*way, imported.target])
    return None


def loaded_by(room: str) -> frozenset[str]:
    """What a fresh interpreter has loaded after importing every module of a room."""
    names = [
        module for module in modules() if (room_found := room_of(module)) is not None and full(room) in room_found.names
    ]
    code = "import sys\n" + "".join(f"import {name}\n" for name in names) + "print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return frozenset(done.stdout.split())


def may_load(room: str) -> set[str]:
    """The first names of all rooms, and the libraries, that a room may load when it is imported: what it imports, and in turn they."""
    by_name, names, todo = {name: each for each in ROOMS for name in each.names}, set[str](), {full(room)}
    while todo:
        own = by_name[todo.pop()]
        names.add(own.names[0])
        words = {word.partition("@")[0] for word in own.imports.replace("shared", SHARED).split()}
        words |= {_place(other) for module, other in EXCEPTIONS if room_of(module) is own}
        names |= {word for word in words if full(word) not in by_name}
        todo |= {full(word) for word in words if full(word) in by_name} - names
    return names


if __name__ == "__main__":
    wrong = broken()
    print(*wrong, sep="\n", file=sys.stderr)
    sys.exit(1 if wrong else 0)
