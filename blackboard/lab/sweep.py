"""The runs of a sweep, on all cores, and the file that keeps those that are finished.

Each run is a whole team (boards, exchange, feedback) in one process (`blackboard.lab.team`), in lockstep, with the result of the
processes of `blackboard up`, to the bit.
"""

import json
import resource
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.lab import parallel
from blackboard.lab.sweep_plan import Planned
from blackboard.lab.team import InProcessTeam
from blackboard.run.door import version
from blackboard.run.logs import quiet

Finished = dict[str, Any]  # a line of the file of finished runs


def run_one(key: str, scenario: Scenario) -> Finished:
    """Run a whole team in this process: its name, and its scorecard with the CPU seconds that it took."""
    before = _cpu_seconds()
    with quiet():
        card = InProcessTeam(scenario).run()
    return {"key": key, "version": version(), "card": {**card, "cpu_s": round(_cpu_seconds() - before, 3)}}


def run_all(
    planned: Sequence[Planned],
    done: dict[str, Finished],
    keep: Callable[[Finished], None],
    show: Callable[[int, int], None] | None,
) -> list[dict[str, Any]]:
    """The scorecards of all runs in their order, of which only those that are not done are made."""
    todo = {one.key: one.scenario for one in planned if one.key not in done}
    already = len(planned) - len(todo)
    moving = None if show is None else lambda count, _: show(already + count, len(planned))
    for finished in parallel.run_jobs(run_one, list(todo.items()), moving, keep) if todo else []:
        done[finished["key"]] = finished
    return [done[one.key]["card"] for one in planned]


@contextmanager
def kept_runs(file: Path | None) -> Iterator[tuple[dict[str, Finished], Callable[[Finished], None]]]:
    """The runs that a file holds, by their keys, and a function that adds one. UserError: it is no such file, or cannot be written."""
    if file is None:
        yield {}, lambda finished: None
        return
    try:
        whole = file.read_text(encoding="utf-8") if file.exists() else ""
        lines = whole.splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):  # the sweep was killed while it wrote
            lines = lines[:-1]
            file.write_text("".join(lines), encoding="utf-8")
        kept = [json.loads(line) for line in lines]
        done = {one["key"]: one for one in kept if one["version"] == version() and "cpu_s" in one["card"]}
        stream = file.open("a", encoding="utf-8")
    except OSError as error:
        raise UserError(f"--runs {file}: cannot be used ({error.strerror}); choose another place") from error
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f"--runs {file}: not a file of finished runs ({error}); choose another one") from error
    with stream:

        def keep(finished: Finished) -> None:
            stream.write(json.dumps(finished) + "\n")
            stream.flush()

        yield done, keep


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
