"""The contest of rules: all of them on the same cases, with everything that they say about themselves judged. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from blackboard.config import RuleSection
from blackboard.errors import OpinionError
from blackboard.fusion import in_force, pool
from blackboard.lab.cases import Case, Run
from blackboard.lab.tally import COLUMNS, Estimate, Tally, estimates
from blackboard.opinion.averages import channel_filter_pool, linear_pool
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.scores import LEVELS

Timer = Callable[[], float]  # seconds

#: The paper's own parameters (Sec. V).
PAPER = RuleSection(rule="cooperative", k=2.0, gamma=0.5)
#: What a board does where nothing else is set.
DEFAULT = RuleSection()

#: Every rule of POOLS, and variants that users ask for. The reference cell is given in cells.
CONTENDERS: dict[str, RuleSection] = {
    "linear": RuleSection(rule="linear"),
    "logarithmic": RuleSection(rule="logarithmic"),
    "geometric": RuleSection(rule="geometric"),
    "chernoff": RuleSection(rule="chernoff"),
    "hoelder a=0.5": RuleSection(rule="hoelder"),
    "harmonic": RuleSection(rule="harmonic"),
    "cooperative": PAPER,
    "cooperative v_ref=.5": RuleSection(rule="cooperative", k=2.0, gamma=0.5, reference_cell=0.5),
    "calibrated": RuleSection(rule="calibrated", k=2.0, gamma=0.5),
    "coalition gamma=0.5": RuleSection(gamma=0.5),
    "coalition": DEFAULT,
    "coalition product": RuleSection(independence=1.0),
    "median-log": RuleSection(rule="median-log"),
    "geometric-median": RuleSection(rule="geometric-median"),
    "clique+logarithmic": RuleSection(rule="clique"),
    "clique+coalition": RuleSection(rule="clique", inner="coalition"),
    "channel-filter": RuleSection(rule="channel-filter"),
}
THE_DEFAULT = "coalition"


def judge(runs: Sequence[tuple[int, Run]], rules: Mapping[str, RuleSection], timer: Timer) -> dict[str, Tally]:
    """A tally for each rule over numbered runs; a case is one fusion."""
    tallies = {name: Tally() for name in rules}
    for number, run in runs:
        for case in run:
            for name, rule in rules.items():
                began = timer()
                p, failed = fused(case, rule)
                tallies[name].add(number, Belief(case.grid, p), case.truth, timer() - began, failed)
    return tallies


def merged(parts: Sequence[dict[str, Tally]]) -> dict[str, Tally]:
    """The tallies of several calls of `judge`, at least one, together."""
    first, *others = parts
    for part in others:
        first = {name: tally.merge(part[name]) for name, tally in first.items()}
    return first


def fused(case: Case, rule: RuleSection) -> tuple[Array, bool]:
    """What a board with this rule makes of a case, and whether a veto left no cell, so that it is the linear pool."""
    try:
        if rule.rule == "channel-filter":
            return channel_filter_pool(case.opinions, common=case.common), False
        return pool(case.opinions, case.grid, rule), False
    except OpinionError:
        return linear_pool(case.opinions), True


def contenders(grid: Grid) -> dict[str, RuleSection]:
    """CONTENDERS for a grid: their reference cells in its unit."""
    edges = {n: r.reference_cell * grid.cell for n, r in CONTENDERS.items() if r.reference_cell is not None}
    return {
        name: rule.model_copy(update={"reference_cell": edges[name]}) if name in edges else rule
        for name, rule in CONTENDERS.items()
    }


# --- the table -------------------------------------------------------------------------------------------------------

#: Columns for which less, or more, is better; of the others (coverage) the nearest to what it claims is.
LESS = ("rmse", "median", "ms")
HONEST = 0.9  # 95 % coverage that a rule needs for its entropy to count as sharpness


def report(trials: Mapping[str, dict[str, Tally]], chance: np.random.Generator) -> dict[str, Any]:
    """Everything that the lab found, as JSON: trial -> rule -> column -> value and interval, and the best per column."""
    found: dict[str, Any] = {}
    for trial, tallies in trials.items():
        rows = {name: estimates(tally, chance) for name, tally in tallies.items()}
        found[trial] = {
            "runs": len(set(tallies[THE_DEFAULT].runs)),
            "cases": len(tallies[THE_DEFAULT].runs),
            "rules": {
                name: {
                    **{c: {"value": e.value, "low": e.low, "high": e.high} for c, e in row.items()},
                    "failed": tallies[name].failed,
                }
                for name, row in rows.items()
            },
            "best": {column: _best(column, rows) for column in COLUMNS},
        }
    rules = {name: {"rule": rule.rule, **in_force(rule)} for name, rule in CONTENDERS.items()}
    return {"default": THE_DEFAULT, "rules": rules, "trials": found}


def _best(column: str, rows: Mapping[str, Mapping[str, Estimate]]) -> list[str]:
    """The best of a column; several where they are equal to the digits that are shown."""

    def loss(row: Mapping[str, Estimate]) -> float:
        value = row[column].value
        if column == "log_score":
            return -value
        if column.startswith("coverage_"):
            return abs(value - int(column.removeprefix("coverage_")) / 100)
        if column == "entropy" and row["coverage_95"].value < HONEST:
            return float("inf")
        return value

    losses = {name: round(loss(row), 3) for name, row in rows.items()}
    least = min(losses.values())
    return [name for name, value in losses.items() if value == least < float("inf")]


def text(found: Mapping[str, Any]) -> str:
    """The same for people: half the width of the 95 % interval after the number, a star at the best of each column."""
    heads = ("RMSE", "median", "log score", *(f"{level} %" for level in LEVELS), "entropy", "ms")
    lines = list(_told(found, heads))
    lines.append(
        "* best of its column: least error and time, highest log score, coverage nearest to what it claims, least"
    )
    lines.append(
        f"entropy of those whose 95 % regions hold the truth in {100 * HONEST:.0f} %. > the default of a board."
    )
    return "\n".join(lines)


def _told(found: Mapping[str, Any], heads: Sequence[str]) -> Iterator[str]:
    for trial, told in found["trials"].items():
        yield f"{trial}: {told['runs']} runs, {told['cases']} fusions"
        yield " " * 22 + "".join(f"{head:>14}" for head in heads)
        for name, row in told["rules"].items():
            cells = (_cell(column, row[column], name in told["best"][column]) for column in COLUMNS)
            failed = f"  {row['failed']} vetoed" if row["failed"] else ""
            yield f"{'> ' if name == found['default'] else '  '}{name:20}" + "".join(cells) + failed
        yield ""


def _cell(column: str, estimate: Mapping[str, float], best: bool) -> str:
    half = (estimate["high"] - estimate["low"]) / 2
    places = 3 if column.startswith("coverage") else 2
    return f"{'*' if best else ''}{estimate['value']:.{places}f} ±{half:.{places}f}".rjust(14)
