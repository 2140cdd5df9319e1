"""The comparison of rules: all of them fuse the same cases, and error, log score, coverage, entropy and time are compared. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from blackboard.config import BoardSection
from blackboard.judge.intervals import FEWEST, Estimate
from blackboard.lab.cases import Case, Run
from blackboard.lab.estimates import COLUMNS, RuleScores, estimates
from blackboard.opinion.averages import ChannelFilter
from blackboard.opinion.belief import Belief
from blackboard.opinion.cooperative import Coalition, Cooperative
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import POOLS, fuse
from blackboard.opinion.robust import Clique
from blackboard.opinion.rules import Pooled, Rule, read_rule
from blackboard.opinion.scores import LEVELS
from blackboard.process.columns import columns

Timer = Callable[[], float]  # seconds
#: What is compared: a rule, or a whole [board] table with its rules for each subject.
Contender = Rule | BoardSection

#: The paper's own parameters (Sec. V).
PAPER = Cooperative(k=2.0, gamma=0.5)
#: What a board does where nothing else is set.
DEFAULT = Coalition()
DEFAULT_NAME = "coalition"
#: The name of a scenario's own [board] table.
OWN_BOARD = "[board]"
#: The name of the centralised filter (`blackboard.lab.ideal`): a bound, which is never starred.
IDEAL = "ideal"
#: A row's name -> the `fusion` of the whole team's run whose agreed beliefs it judges.
AGREED = {"agreed, opinions": "opinions", "agreed, joint": "joint"}


def contenders(grid: Grid, board: BoardSection | None = None) -> dict[str, Contender]:
    """Every rule of POOLS with its defaults, plug-ins included, variants that users ask for, and a scenario's own [board]."""
    variants: dict[str, dict[str, Rule]] = {
        "cooperative": {"cooperative v_ref=.5": replace(PAPER, reference_cell=0.5 * grid.cell)},  # half a cell
        "coalition": {"coalition gamma=0.5": Coalition(gamma=0.5), "coalition product": Coalition(independence=1.0)},
        "clique": {"clique+coalition": Clique(inner=Coalition())},
    }
    contenders: dict[str, Contender] = {}
    for name in POOLS:
        contenders |= {name: read_rule({"rule": name}), **variants.get(name, {})}
    return contenders if board is None else {**contenders, OWN_BOARD: board}


def judge(runs: Sequence[tuple[int, Run]], rules: Mapping[str, Contender], timer: Timer) -> dict[str, RuleScores]:
    """The scores of each rule over numbered runs; a case is one fusion."""
    scores = {name: RuleScores(in_force=rule.in_force()) for name, rule in rules.items()}
    for number, run in runs:
        for case in run:
            for name, rule in rules.items():
                began = timer()
                pooled = fused(case, rule)
                seconds = timer() - began
                belief = Belief(case.grid, pooled.p)
                scores[name].add(number, belief, case.truth, seconds, pooled.outcome != "pooled")
    return scores


@dataclass(frozen=True, eq=False)
class Other:
    """Beliefs that were not pooled from cases, by the time and the subject that a case asks for, and what they are."""

    beliefs: Mapping[tuple[float, str], Belief]
    in_force: dict[str, str | float]

    def judge(self, number: int, run: Run) -> RuleScores:
        """Their scores on the cases of run `number`."""
        scores = RuleScores(in_force=self.in_force)
        for case in run:
            scores.add(number, self.beliefs[case.asked], case.truth, None)
        return scores


def by_kind(run: Run) -> dict[str, Run]:
    """The cases about robots and those about objects, by what is added to the name of their situation."""
    kinds = sorted({case.subject.split("/")[0] for case in run}, reverse=True)
    return {f", {kind}s": [case for case in run if case.subject.startswith(f"{kind}/")] for kind in kinds}


def merged(parts: Sequence[dict[str, RuleScores]]) -> dict[str, RuleScores]:
    """The scores of several calls of `judge`, at least one, together."""
    first, *others = parts
    for part in others:
        first = {name: scores.merge(part[name]) for name, scores in first.items()}
    return first


def fused(case: Case, contender: Contender) -> Pooled:
    """What a board with this rule makes of a case; the channel filter gets what is common, which a board does not know."""
    rule = contender.of(case.subject) if isinstance(contender, BoardSection) else contender
    if isinstance(rule, ChannelFilter) and case.common is not None:
        return rule.pool(case.opinions, common=case.common)
    return fuse(rule, case.opinions, case.grid)


# --- the table -------------------------------------------------------------------------------------------------------

HONEST = 0.9  # 95 % coverage that a rule needs for its entropy to count as sharpness


def report(situations: Mapping[str, dict[str, RuleScores]], rng: np.random.Generator) -> dict[str, Any]:
    """All scores as JSON: situation (a trial, or a team) -> rule -> column -> value and interval, and the best of each column.

    The JSON calls all situations "trials".
    """
    table: dict[str, Any] = {}
    rules: dict[str, dict[str, str | float]] = {}
    for situation, scores in situations.items():
        rows = {name: estimates(of_rule, rng) for name, of_rule in scores.items()}
        rules |= {name: of_rule.in_force for name, of_rule in scores.items() if name not in rules}
        table[situation] = {
            "runs": len(set(scores[DEFAULT_NAME].runs)),
            "cases": len(scores[DEFAULT_NAME].runs),
            "rules": {
                name: {**{c: asdict(e) for c, e in row.items()}, "failed": scores[name].failed}
                for name, row in rows.items()
            },
            "best": {column: _best(column, rows) for column in COLUMNS},
        }
    return {"default": DEFAULT_NAME, "rules": rules, "trials": table}


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

    losses = {name: round(loss(row), 3) for name, row in rows.items() if name != IDEAL and column in row}
    least = min(losses.values())
    return [name for name, value in losses.items() if value == least < float("inf")]


def text(table: Mapping[str, Any]) -> str:
    """The report as text: half the width of the 95 % interval after the number, a star at the best of each column."""
    names = {name for result in table["trials"].values() for name in result["rules"]}
    heads = ("RMSE", "median", "log score", *(f"{level} %" for level in LEVELS), "entropy", "ms")
    lines = list(_lines(table, heads))
    lines.append(
        "* best of its column: least error and time, highest log score, coverage nearest to what it claims, least"
    )
    lines.append(
        f"entropy of those whose 95 % regions hold the truth in {100 * HONEST:.0f} %. > the default of a board."
    )
    if any(result["runs"] < FEWEST for result in table["trials"].values()):
        lines.append(f"- no interval: of fewer than {FEWEST} runs there is none worth the name.")
    if names & set(AGREED):
        lines.append("agreed: what the boards of a whole team agree on, with exchange and feedback, by [board] fusion.")
    if IDEAL in names:
        lines.append("ideal: one filter on all readings; in simulation, with the world's own noise, it is the bound.")
    return "\n".join(lines)


def _lines(cases: Mapping[str, Any], heads: Sequence[str]) -> Iterator[str]:
    for situation, result in cases["trials"].items():
        yield f"{situation}: {result['runs']} runs, {result['cases']} fusions"
        table: list[tuple[str, ...]] = [("", *heads, "")]
        for name, row in result["rules"].items():
            cells = (_cell(column, row.get(column), name in result["best"][column]) for column in COLUMNS)
            failed = f"{row['failed']} vetoed" if row["failed"] else ""
            table.append((f"{'> ' if name == cases['default'] else '  '}{name}", *cells, failed))
        yield from columns(table, numbers=range(1, 1 + len(heads)))
        yield ""


def _cell(column: str, estimate: Mapping[str, float | None] | None, best: bool) -> str:
    if estimate is None:
        return "-"
    low, high = estimate["low"], estimate["high"]
    places = 3 if column.startswith("coverage") else 2
    half = "    -" if low is None or high is None else f"±{(high - low) / 2:.{places}f}"
    return f"{'*' if best else ''}{estimate['value']:.{places}f} {half}"
