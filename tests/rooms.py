"""Who may import whom: the one list. `python -m tests.rooms` prints it as docs/design.md has it, and what breaks it.

The sources are read, not run. An import inside a function, or for types alone, is one that is made later; what a module loads when it
is imported follows from the others. tests/test_rooms.py holds the sources to the list, and a fresh interpreter to what it says.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple

from tests.files import ROOT

PACKAGES = ("blackboard", "robot_agent", "sim_world")
#: What machines and services may import: neither a clock nor a network.
SHARED = "errors tables config faults opinion wire process"
#: Every module may import the standard library and these; of the standard library not what reads a clock or draws at random.
FREE = {*sys.stdlib_module_names, "numpy"} - {"time", "datetime", "random", "secrets", "uuid"}


@dataclass(frozen=True)
class Room:
    """Some modules with one purpose, and what they may import besides each other: rooms, and libraries.

    `modules` are its module or package, as `wire`, or several, with those below them that are in no other room. A library that
    only some modules may name has their names, as `zenoh@link,settings`. `later` is imported only when it is asked for.
    """

    modules: str
    what: str
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


#: From the bottom to the top: a room imports only rooms that stand above it here, so there is no circle of rooms.
ROOMS = (
    Room("errors", "errors, divided by whose fault they are"),
    Room("plugins", "rules and localizers of installed packages, loaded by name", "errors"),
    Room(
        "opinion",
        "grids, beliefs, made of what people have (given), their regions, pooling rules with their story, POOLS, laws, scores, "
        "provenance, ageing, believed: records and votes; gaussian/: joint Gaussians of robots, their lasting errors and objects",
        "errors",
        "plugins@rules",
    ),
    Room("blackboard", "`import blackboard`: the pools", "", "errors opinion"),
    Room(
        "wire",
        "messages, topics, envelopes, beliefs as bytes, codec, raw: bounded maps; mistakes: what is wrong with a field, in words; "
        "opinions: of a message; falsified: what a liar reports",
        "errors opinion pydantic msgpack@raw",
    ),
    Room("tables", "scenario files as tables, not yet looked at", "errors"),
    Room("config", "scenarios, and the sections that every process may read", "errors opinion wire tables pydantic"),
    Room(
        "config.world config.protocols",
        "the [world] section: what is true, and what is asked for a PASS; protocols of a recording",
        "errors config wire pydantic",
    ),
    Room("faults", "what is wrong with some robots of a scenario", "errors config wire pydantic"),
    Room(
        "process",
        "service protocol, peer and listener, intake, failures, refusals, roster, roll call, team clock, rounds, offsets "
        "(of clocks), namesakes, printable (texts from outside), columns (tables as text)",
        "errors wire",
    ),
    Room("process.clock", "the only clock", "time datetime"),
    Room("process.loop", "the only endless loop", "process process.clock wire"),
    Room(
        "board",
        "learning, dissent, memory, fusion, entries, joint/, board; lead, clocks, participants, handover, reception, "
        "publisher (all pure), service",
        "shared",
    ),
    Room(
        "judge",
        "what is scored (pure): instant, traffic, attendance, referee, sums (tally, distances, calibration), "
        "intervals, unnamed things (gospa, tracks), causes, the card, samples and their files, paired",
        "shared config.world",
        "pyarrow@files",
    ),
    Room(
        "state",
        "one fold from envelopes to the state of the teams, for the launcher and for all who look on: processes, moments, "
        "what was told",
        "shared",
    ),
    Room(
        "access",
        "who may do what, from the topic table; denials: a router's log read (pure); certificates, their files, probe: why a "
        "session does not open",
        "errors config@directory,members wire process.clock@authority,identity cryptography@authority",
    ),
    Room(
        "net.bus net.inbox net.scheduler",
        "links in one process; services on them, in virtual time",
        "errors wire process",
    ),
    Room(
        "net",
        "link and settings, flood: whom to hear then, knock: what a router says to this process; outage: of its router; "
        "attached: a link that speaks to others than the team, too",
        "errors wire process.clock@knock,link access net.bus zenoh@link,settings,attached",
    ),
    Room(
        "client",
        "a team for other people's programs: member (a peer; pure), agreed, desk, why, membership, team, robot; ask: which team is "
        "there; share: what one team agrees on, told to another (pure)",
        "shared net@membership process.clock@membership process.loop@membership",
    ),
    Room(
        "run",
        "door, terminal (what is printed), logs, flags, overrides (`--set`), launch, supervisor, lifeline, health, progress, "
        "browser; gate: a router with keys; keys: `blackboard keys`; plan: `blackboard plan`; reference: docs/scenario.md",
        "shared net@door,gate,health,launch process.clock@door,gate,health,keys,launch,progress process.loop@door access@gate,keys "
        "state@launch blackboard@door cyclopts pydantic@reference",
        "rich@progress",
    ),
    Room(
        "robot_agent",
        "sensing, localizers, estimator, gaussian/ (its filter for a joint; or its own), agent, budget (what is said on a poor link), "
        "sightings (their worth), coarse and short (fewer bytes), faults (all pure), service, driven (by a program's calls), team (the service of a robot), config",
        "shared plugins@localizers pydantic@config",
    ),
    Room("robot_agent.__main__", "`robot-agent`", "shared robot_agent run cyclopts"),
    Room(
        "sim_world",
        "world, sensors, sources, mrclam/ and pyfg (recordings), detector, members, faults (all pure), service, scenarios/*.toml",
        "shared config.world judge",
    ),
    Room("sim_world.__main__", "`sim-world`", "shared judge sim_world run"),
    Room("client.__main__", "`blackboard share`", "shared client net run process.clock process.loop cyclopts"),
    Room(
        "tape",
        "a board's journal, recorder, tapes as files, replay, what if, judge, table, player",
        "shared config.world@judge judge board@replay,whatif net.bus mcap@file zstandard@file",
    ),
    Room(
        "tape.__main__", "`blackboard record | replay | tape`", "shared judge tape net.bus run process.clock cyclopts"
    ),
    Room("view", "feed, why, status, frames", "shared state board@why"),
    Room(
        "view.web",
        "the live page: server, connections, and the files of the browser",
        "shared state view starlette uvicorn",
    ),
    Room("view.tui", "the terminal", "shared state view rich textual"),
    Room(
        "view.source",
        "the team that a command looks at: a tape, or one that runs",
        "shared state view net run process.clock cyclopts",
        "tape",
    ),
    Room(
        "view.__main__",
        "`blackboard why | status | echo | hz | view | top`",
        "shared view view.source net run process.clock cyclopts",
        "view.web view.tui",
    ),
    Room("bridges", "teams and tapes for Rerun and Foxglove", "shared state view", "rerun@rerun foxglove@foxglove"),
    Room(
        "bridges.ros",
        "names of rmw_zenoh, messages, odometry (all pure), publisher, service",
        "shared state view client rosbags@convert xxhash@names",
    ),
    Room(
        "bridges.__main__",
        "`blackboard-rerun`, `blackboard tape export`, `blackboard ros`",
        "shared view.source bridges net run process.clock process.loop cyclopts",
        "client bridges.ros",
    ),
    Room(
        "calibrate",
        "what a team's sensors are like, by its own readings: a smoother over all robots (chain, model, fit), landmarks (pure)",
        "errors opinion wire process",
    ),
    Room(
        "lab",
        "rules compared, parameters chosen, figures, the bound, score, sweep; team: all services of a scenario in one process",
        "shared config.world@ideal,team_cases judge board@streams,team net.bus@team run@parallel,sweep,sweep_plan process.clock@parallel",
    ),
    Room(
        "lab.drawing lab.bench_drawing lab.run_drawing lab.sweep_drawing lab.calibrate_drawing",
        "pictures of all of these",
        "shared judge calibrate lab matplotlib",
    ),
    Room(
        "lab.__main__ lab.score lab.calibrate",
        "`blackboard lab | tune | figures | sweep | score | calibrate`",
        "shared config.world@score judge calibrate@calibrate tape@calibrate lab run cyclopts",
        "lab.drawing",
    ),
    Room(
        "chaos",
        "a team of processes under network trouble, by proxies; the soak; lies/: what a member may claim, and what it costs",
        "shared judge net@team run@team,trial lab@trial pydantic@changes",
    ),
    Room("chaos.__main__", "`blackboard chaos`, `make soak`", "shared chaos lab run cyclopts"),
    Room(
        "commands",
        "`blackboard demo | up | serve | router | scenario`",
        "shared run cyclopts",
        "config.world board judge tape lab.drawing",
    ),
    Room("__main__", "`blackboard`: all commands by name, each loaded when it is asked for", "run"),
)

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
    found = set[Import]()
    for name, late, line in _imported(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        target = name
        while target and target not in modules():
            target = target.rpartition(".")[0]
        target = target or name.split(".")[0]
        if target != module and target not in FREE:
            found.add(Import(module, target, late, line))
    return tuple(sorted(found, key=lambda one: (one.line, one.target)))


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
    found = [f"{room.modules} stands above {other.modules}, which it may import" for room, other in _upwards(order)]
    for module in modules():
        room = room_of(module)
        if room is None:
            found.append(f"{module} is in no room")
            continue
        for one in imports(module):
            target = _place(one.target)
            allowed = target in room.names or room.allows(target, one.late, module)
            if not allowed and (module, one.target) not in EXCEPTIONS:
                found.append(
                    f"{_where(one)}, which {room.modules} may not" + (" when it is loaded" if not one.late else "")
                )
    return [*found, *_idle(), *(" -> ".join(circle) for circle in circles())]


def _idle() -> Iterator[str]:
    """A line for each import that a room may make, and each exception, that no module makes; what is shared may be left alone."""
    made = [one for module in modules() for one in imports(module)]
    for room in ROOMS:
        for word in f"{room.imports} {room.later}".split():
            only = Room(room.modules, "", word)
            if word != "shared" and not any(
                room_of(one.module) is room and only.allows(_place(one.target), True, one.module) for one in made
            ):
                yield f"{room.modules} may import {word}, and does not"
    yield from (
        f"{one} may import {other}, and does not"
        for one, other in EXCEPTIONS - {(one.module, one.target) for one in made}
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


def _where(one: Import) -> str:
    return f"{modules()[one.module].relative_to(ROOT)}:{one.line} imports {one.target}"


def circles() -> list[list[str]]:
    """A shortest circle of imports through each module that is in one, but for those that another circle shows already."""
    found, seen = list[list[str]](), set[str]()
    for module in modules():
        way = None if module in seen else chain(module, {module})
        if way is not None:
            found.append(way)
            seen |= set(way)
    return found


def chain(module: str, targets: Iterable[str], late: bool = True) -> list[str] | None:
    """A shortest way of imports, at least one, from a module to one of some others; None where there is none."""
    wanted, ways, known = set(targets), [[module]], {module}
    while ways:
        way = ways.pop(0)
        for one in imports(way[-1]):
            if one.target in modules() and (late or not one.late):
                if one.target in wanted:
                    return [*way, one.target]
                if one.target not in known:
                    known.add(one.target)
                    ways.append([*way, one.target])
    return None


def loaded_by(room: str) -> frozenset[str]:
    """What a fresh interpreter has loaded after importing every module of a room."""
    names = [module for module in modules() if (found := room_of(module)) is not None and full(room) in found.names]
    code = "import sys\n" + "".join(f"import {name}\n" for name in names) + "print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return frozenset(done.stdout.split())


def may_load(room: str) -> set[str]:
    """The first names of all rooms, and the libraries, that a room may load when it is imported: what it imports, and in turn they."""
    by_name, found, todo = {name: one for one in ROOMS for name in one.names}, set[str](), {full(room)}
    while todo:
        one = by_name[todo.pop()]
        found.add(one.names[0])
        words = {word.partition("@")[0] for word in one.imports.replace("shared", SHARED).split()}
        words |= {_place(other) for module, other in EXCEPTIONS if room_of(module) is one}
        found |= {word for word in words if full(word) not in by_name}
        todo |= {full(word) for word in words if full(word) in by_name} - found
    return found


# --- the page ---------------------------------------------------------------------------------------------------------

WIDTHS = (21, 72, 64)  # of the columns of the page, in characters


def page() -> str:
    """The list as a table for people."""
    lines = [_line("room", "what it holds", "imports, besides itself, numpy and the standard library")]
    for room in ROOMS:
        later = f" ({room.later})" if room.later else ""
        name = ", ".join(_shown(name) for name in room.names)
        imported = "".join(word for word in f"{room.imports}{later}".replace("process.", "")).strip() or "-"
        cells = [wrap(text, width) for text, width in zip((name, room.what, imported), WIDTHS, strict=True)]
        for i in range(max(len(cell) for cell in cells)):
            lines.append(_line(*(cell[i] if i < len(cell) else "" for cell in cells)))
    return "\n".join([*lines, "", f"shared = {SHARED}; what stands in brackets is imported when it is asked for"])


def _line(*cells: str) -> str:
    return "  ".join(f"{cell:<{width}}" for cell, width in zip(cells, WIDTHS, strict=True)).rstrip()


def _shown(name: str) -> str:
    """A room as its folder, or as its module without an ending."""
    path = modules().get(name)
    short = name.removeprefix("blackboard.").replace(".", "/")
    return f"{short}/" if path is not None and path.name == "__init__.py" else short


if __name__ == "__main__":
    print(page())
    print(*broken(), sep="\n", file=sys.stderr)
    sys.exit(1 if broken() else 0)
