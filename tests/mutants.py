"""`make mutants`: do the tests notice when one operator, comparison or constant of a pure room is changed?

Cosmic Ray finds the places, makes the changes and runs the tests; here is only what it has no option for: a random sample of
all places that a seed repeats, the tests that concern a file, and copies of the project to work in, so that the working tree
is never touched. The survivors that were looked at stand in docs/notes/mutants.md, each with the reason why it is harmless.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import permutations
from multiprocessing import Queue, get_context
from pathlib import Path
from typing import Any

import cosmic_ray.plugins
import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.operators.operator import Operator
from cosmic_ray.work_item import MutationSpec, TestOutcome

from blackboard.run.progress import progress
from tests.files import ROOT

KNOWN = ROOT / "docs" / "notes" / "mutants.md"
COPIED = ("blackboard", "robot_agent", "sim_world", "tests", "docs", "examples", "benchmarks")

#: The files that are changed (patterns), and the tests that concern them, those that notice most first.
ROOMS: dict[str, tuple[str, ...]] = {
    "blackboard/opinion/*.py": ("tests/opinion", "tests/board"),
    "blackboard/wire/[!m_]*.py": ("tests/wire",),
    "blackboard/board/*.py": ("tests/board", "tests/flow"),
    "blackboard/process/*.py": ("tests/process", "tests/board", "tests/flow"),
    "blackboard/judge/*.py": ("tests/judge", "tests/tape"),
    "blackboard/net/bus.py": ("tests/net/test_network.py", "tests/flow"),
    "blackboard/net/scheduler.py": ("tests/net/test_scheduler.py", "tests/flow"),
    "robot_agent/[!_]*.py": ("tests/robot_agent", "tests/flow"),
    "sim_world/[!_]*.py": ("tests/sim_world", "tests/flow"),
    "sim_world/mrclam/*.py": ("tests/sim_world",),
}

#: Changes that give code which still runs. `a << b` for `a + b` would only be an error that every test notices.
ARITHMETIC = {"Add": ("Sub",), "Sub": ("Add",), "Mul": ("Div", "Add"), "Div": ("Mul",), "Pow": ("Mul", "Div"), "Mod": ("Add",),
              "FloorDiv": ("Mul",), "BitOr": ("BitAnd", "BitXor"), "BitAnd": ("BitOr",), "BitXor": ("BitOr",)}  # fmt: skip
ORDER = ("Lt", "LtE", "Gt", "GtE")
CHANGES = {
    *(f"ReplaceBinaryOperator_{a}_{b}" for a, others in ARITHMETIC.items() for b in others),
    *(f"ReplaceComparisonOperator_{a}_{b}" for a, b in [*permutations(ORDER, 2), ("Eq", "NotEq"), ("NotEq", "Eq")]),
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    *("ReplaceUnaryOperator_Delete_Not", "ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Invert"),
    *("ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd", "AddNot"),
    *("NumberReplacer", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "ZeroIterationForLoop"),
}
#: Those of them that hold settings (tests of scenarios check these), are tests themselves, or read the clock and wait (seen by
#: system tests).
LEFT_OUT = (
    "blackboard/opinion/laws.py",
    "robot_agent/config.py",
    "blackboard/process/clock.py",
    "blackboard/process/loop.py",
)
SLOWER = 10.0  # times as long as without a change: then the tests hang, which is noticed


class ReplaceMembership(Operator):  # type: ignore[misc]
    """`in` and `not in`, which Cosmic Ray leaves alone."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        if node.type == "comparison" and _words(node.children[1]) in ("in", "not in"):
            yield node.children[1].start_pos, node.children[1].end_pos

    def mutate(self, node: Any, index: int) -> Any:
        other = "in" if _words(node.children[1]) == "not in" else "not in"
        node.children[1] = parso.parse(f" {other}")
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


def _words(node: Any) -> str:
    return " ".join(node.get_code().split())


cosmic_ray.plugins.OPERATOR_PROVIDERS["here"] = {"ReplaceMembership": ReplaceMembership}
NAMES = [name for name in cosmic_ray.plugins.operator_names() if name.split("/")[1] in CHANGES | {"ReplaceMembership"}]


@dataclass(frozen=True)
class Verdict:
    """What the tests made of one change: the line before and after it, and whether they noticed."""

    path: str
    line: int
    before: str
    after: str
    noticed: bool
    how: str

    def __str__(self) -> str:
        """As a line of docs/notes/mutants.md begins."""
        return f"- `{self.path}`: `{self.before}` → `{self.after}`"


# --- the sample --------------------------------------------------------------------------------------------------------


def tests_of(path: str) -> tuple[str, ...]:
    return next((tests for pattern, tests in ROOMS.items() if fnmatch(path, pattern)), ())


def files(only: str) -> list[str]:
    """The files of the rooms whose path contains `only`, or one of several parts of paths with commas between them."""
    paths = sorted({str(path.relative_to(ROOT)) for pattern in ROOMS for path in ROOT.glob(pattern)} - set(LEFT_OUT))
    wanted = [path for path in paths if any(part in path for part in only.split(","))]
    return [path for path in wanted if not path.endswith("__init__.py")]


def changes(path: str) -> Iterator[MutationSpec]:
    """All changes of a file, but for annotations and decorators (`frozen=True`): they guard what is written, not what is run."""
    source = (ROOT / path).read_text(encoding="utf-8")
    guards = list(_guards(source))
    nodes = list(ast_nodes(get_ast(source)))
    for name in NAMES:
        operator = cosmic_ray.plugins.get_operator(name)()
        places = [(node, *place) for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, (node, start, end) in enumerate(places):
            star = node.type == "operator" and node.parent.type in ("parameters", "lambdef")  # f(*, a), no product
            if not star and not any(first <= start < last for first, last in guards):
                yield MutationSpec(path, name, occurrence, start, end)


def _guards(source: str) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Where annotations and decorators begin and end, as (line, column)."""
    for node in ast.walk(ast.parse(source)):
        parts = [
            getattr(node, "annotation", None),
            getattr(node, "returns", None),
            *getattr(node, "decorator_list", ()),
        ]
        for part in parts:
            if isinstance(part, ast.expr):
                yield (part.lineno, part.col_offset), (part.end_lineno or 0, part.end_col_offset or 0)


def sample(paths: Iterable[str], count: int, seed: int) -> tuple[list[MutationSpec], int]:
    """At most `count` places drawn from all, with one of the changes of each, and how many places there are."""
    places: dict[tuple[str, tuple[int, int], tuple[int, int]], list[MutationSpec]] = defaultdict(list)
    for path in paths:
        for change in changes(path):
            places[str(change.module_path), change.start_pos, change.end_pos].append(change)
    chance = random.Random(seed)
    drawn = chance.sample(sorted(places), min(count, len(places)))
    return [chance.choice(places[place]) for place in drawn], len(places)


# --- the tests -----------------------------------------------------------------------------------------------------------


def copy(parent: Path, number: int) -> Path:
    """A copy of the project to change files in."""
    target = parent / str(number)
    for name in COPIED:
        shutil.copytree(ROOT / name, target / name, ignore=shutil.ignore_patterns("__pycache__"))
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy2(path, target)
    return target


def command(tests: Iterable[str]) -> list[str]:
    return [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not system and not compose", *tests]


def seconds(where: Path, tests: tuple[str, ...]) -> float:
    """How long the tests take without a change; they must pass, or nothing can be told from their failing."""
    began = time.monotonic()
    done = subprocess.run(command(tests), cwd=where, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(tests)} fail without any change:\n{done.stdout}")
    return time.monotonic() - began


def begin(free: Queue[str]) -> None:
    """Each worker process takes a copy of its own."""
    os.chdir(free.get())


def judge(change: MutationSpec, limit: float) -> Verdict:
    """Make the change in this worker's copy, run the tests that concern it, and undo it."""
    path, line = str(change.module_path), change.start_pos[0]
    before = (ROOT / path).read_text(encoding="utf-8").splitlines()
    result = mutate_and_test([change], " ".join(f"'{part}'" for part in command(tests_of(path))), limit)
    if result.test_outcome is TestOutcome.INCOMPETENT or result.diff is None:
        raise SystemExit(f"{change}: {result.output}")
    lines = result.diff.splitlines()
    old = [text[1:].strip() for text in lines if text.startswith("-") and not text.startswith("---")]
    new = [text[1:].strip() for text in lines if text.startswith("+") and not text.startswith("+++")]
    noticed = result.test_outcome is TestOutcome.KILLED
    source = old[0] if old else before[line - 1].strip()
    return Verdict(path, line, source, " ".join(new), noticed, "hung" if result.output == "timeout" else "")


def main() -> int:
    """Judge a sample; 1 where the tests notice too few of the changes."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--count", type=int, default=120, help="how many places are changed")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many run side by side")
    parser.add_argument("--only", default="", help="parts of the paths of the files, with commas between them")
    parser.add_argument("--least", type=float, default=0.9, help="the share that must be noticed")
    asked = parser.parse_args()
    drawn, places = sample(files(asked.only), asked.count, asked.seed)
    if not drawn:
        raise SystemExit(f"no file of the rooms has {asked.only!r} in its path: {', '.join(files(''))}")
    print(f"{len(drawn)} of {places} places, seed {asked.seed}", flush=True)
    context = get_context("spawn")
    with tempfile.TemporaryDirectory() as parent:
        copies = [copy(Path(parent), number) for number in range(asked.jobs)]
        rooms = {tests_of(str(change.module_path)) for change in drawn}
        limits = dict[tuple[str, ...], float]()
        with progress("mutants: tests without a change") as show:
            for tests in sorted(rooms):
                limits[tests] = 30.0 + SLOWER * seconds(copies[0], tests)
                if show is not None:
                    show(len(limits), len(rooms))
        free: Queue[str] = context.Queue()
        for where in copies:
            free.put(str(where))
        with ProcessPoolExecutor(asked.jobs, context, begin, (free,)) as pool:
            judged = pool.map(judge, drawn, [limits[tests_of(str(change.module_path))] for change in drawn])
            verdicts: list[Verdict] = []
            with progress("mutants") as show:
                try:
                    for verdict in _shown(judged):
                        verdicts.append(verdict)
                        if show is not None:
                            show(len(verdicts), len(drawn))
                except KeyboardInterrupt:  # what was judged until now is reported
                    pool.shutdown(wait=False, cancel_futures=True)
    return report(verdicts, asked.least)


def _shown(verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
    for verdict in verdicts:
        word = ("noticed" if verdict.noticed else "SURVIVED") + (f" ({verdict.how})" if verdict.how else "")
        print(f"{word:9} {verdict.path}:{verdict.line}: {verdict.before} → {verdict.after}", flush=True)
        yield verdict


def report(verdicts: list[Verdict], least: float) -> int:
    """Print the sum and the survivors, first those that are not in the list."""
    known = KNOWN.read_text(encoding="utf-8") if KNOWN.exists() else ""
    survivors = sorted({str(verdict) for verdict in verdicts if not verdict.noticed})
    share = sum(verdict.noticed for verdict in verdicts) / max(1, len(verdicts))
    print(f"\nnoticed {100 * share:.1f} % of {len(verdicts)}; asked {100 * least:g} %")
    for title, lines in (
        ("survived, not in docs/notes/mutants.md", [line for line in survivors if line not in known]),
        ("survived, explained in docs/notes/mutants.md", [line for line in survivors if line in known]),
        ("in docs/notes/mutants.md, of lines that have changed since", outdated(known)),
    ):
        print(f"\n{title}: {len(lines)}", *lines, sep="\n")
    return int(share < least)


def outdated(known: str) -> list[str]:
    """The entries of docs/notes/mutants.md whose file or line is no more."""
    return [
        entry
        for entry, path, before in re.findall(r"^(- `([^`]+\.py)`: `([^`]+)` → `[^`]+`)", known, re.MULTILINE)
        if not (ROOT / path).is_file() or before not in (ROOT / path).read_text(encoding="utf-8")
    ]


if __name__ == "__main__":
    sys.exit(main())
