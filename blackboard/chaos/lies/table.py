"""What each lie costs against the same seed without it, as rows, as a table, and beside what is asked for. Pure."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from blackboard.chaos.lies.catalogue import Lie
from blackboard.chaos.lies.trial import Trial, guests_of, honest, liars_of, span
from blackboard.config import Scenario
from blackboard.judge.samples import Sample, held_by, rms_error
from blackboard.process.columns import cell, columns, markdown_table

GAP = 2.0  # seconds without its name in a status after which a robot is no longer named
#: What is asked for of the rows of one liar, in the mean and of each; of objects and of several liars it is the same in every fusion.
ROBOTS = {"joint": (1.10, 1.25), "opinions": (1.15, 1.35)}
OBJECTS, COVERAGE, COLLUSION, GUESTS, INNOCENT, SLOWER = 1.25, 0.90, 1.35, 1.15, 5.0, 2.0

Row = dict[str, Any]


def row(scenario: Scenario, seed: int, lie: Lie, calm: Trial, trial: Trial) -> Row:
    """What a lie did in a run: errors as ratios to the calm run, from its beginning to the end of the run; times in seconds."""
    liars = liars_of(scenario, lie.liars)
    robots = set(scenario.team.robots) - set(liars)
    begin, end = span(scenario, lie)
    before, after = honest(calm.samples, robots, begin), honest(trial.samples, robots, begin)
    false = [_longest(times) for name, times in trial.named.items() if name in robots]
    named = [trial.named.get(liar, []) for liar in (*liars, *guests_of(lie.guests))]
    return {
        "lie": lie.name,
        "seed": seed,
        "liars": lie.liars,
        "guests": lie.guests,
        "robots": _ratio(_of(after, "robot/"), _of(before, "robot/")),
        "objects": _ratio(_of(after, "object/"), _of(before, "object/")),
        "log_score": _mean(sample.log_score for sample in after) - _mean(sample.log_score for sample in before),
        "coverage": float(held_by(_of(after, "robot/"), 95).mean()) if _of(after, "robot/") else None,
        "told": len(after) / max(1, len(before)),  # of the samples of the calm run
        "named": max(times[0] for times in named) - begin if all(named) else None,  # after its beginning
        "cleared": _cleared(named, end, scenario.time.seconds),  # after its end
        "innocent": max(false, default=0.0),  # longest that an honest robot was named
        "slower": trial.seconds / calm.seconds,  # processor time
    }


def _of(samples: Sequence[Sample], kind: str) -> list[Sample]:
    return [sample for sample in samples if sample.subject.startswith(kind)]


def _ratio(after: Sequence[Sample], before: Sequence[Sample]) -> float | None:
    return rms_error(after) / rms_error(before) if after and before else None


def _mean(values: Any) -> float:
    return float(np.mean([*values] or [0.0]))


def _longest(times: Sequence[float]) -> float:
    """The longest that a robot was named without a gap."""
    longest, since = 0.0, times[0]
    for earlier, later in pairwise(times):
        since = since if later - earlier < GAP else later
        longest = max(longest, later - since)
    return longest


def _cleared(named: Sequence[Sequence[float]], end: float, last: float) -> float | None:
    """Seconds after the end of a lie until nobody was named for it any more; None: never named, or still named."""
    newest = max((times[-1] for times in named if times), default=None)
    return None if newest is None or newest > last - GAP else max(0.0, newest - end)


# --- the table --------------------------------------------------------------------------------------------------------

COLUMNS = ("lie", "robots", "worst", "objects", "log score", "95 %", "told", "named", "cleared", "innocent", "slower")


def text(table: Mapping[str, Any]) -> str:
    """The table as Markdown: of each lie the mean over its seeds, and the worst of the robots' ratios; then what is asked for."""
    lines: list[Sequence[str]] = [COLUMNS]
    for name in dict.fromkeys(row["lie"] for row in table["rows"]):
        rows = [row for row in table["rows"] if row["lie"] == name]
        cells = (
            name,
            cell(mean(rows, "robots"), "{:.2f}"),
            cell(worst(rows, "robots"), "{:.2f}"),
            cell(mean(rows, "objects"), "{:.2f}"),
            cell(mean(rows, "log_score"), "{:+.2f}"),
            cell(mean(rows, "coverage"), "{:.2f}"),
            cell(mean(rows, "told"), "{:.2f}"),
            *(cell(_all(rows, column), "{:.1f} s") for column in ("named", "cleared")),
            cell(worst(rows, "innocent"), "{:.1f} s"),
            cell(mean(rows, "slower"), "{:.1f}"),
        )
        lines.append(cells)
    asked = columns([("yes" if holds else "NO", what) for holds, what in table["asked"]])
    return "\n".join([*markdown_table(lines), "", *asked, "", table["what"]])


def mean(rows: Sequence[Row], column: str) -> float | None:
    values = [row[column] for row in rows if row[column] is not None]
    return float(np.mean(values)) if values else None


def worst(rows: Sequence[Row], column: str) -> float | None:
    """The largest number of a column."""
    return max((row[column] for row in rows if row[column] is not None), default=None)


def _all(rows: Sequence[Row], column: str) -> float | None:
    """The mean of a column that every row has."""
    return mean(rows, column) if all(row[column] is not None for row in rows) else None


def asked(rows: Sequence[Row], fusion: str) -> list[tuple[bool, str]]:
    """Whether each thing that is asked for holds, and what was found."""
    one = [row for row in rows if (row["liars"], row["guests"]) == (1, 0)]
    groups = [
        ("two that collude, robots", [row for row in rows if row["liars"] > 1], COLLUSION),
        ("guests, robots", [row for row in rows if row["guests"]], GUESTS),
    ]
    checks: list[tuple[bool, str]] = []
    if one:
        in_the_mean, of_any = ROBOTS[fusion]
        checks += [
            _at_most("one liar, robots, mean", in_the_mean, mean(one, "robots")),
            _at_most("one liar, robots, worst", of_any, *_worst(one, "robots")),
            _at_most("one liar, objects, mean", OBJECTS, mean(one, "objects")),
        ]
        lowest = min(one, key=lambda row: row["coverage"] or 0.0)
        share = lowest["coverage"] or 0.0
        text = (
            f"one liar, 95 % regions hold at least {COVERAGE:.2f}: {share:.2f} ({lowest['lie']}, seed {lowest['seed']})"
        )
        checks.append((share >= COVERAGE, text))
    checks += [_at_most(f"{name}, mean", most, mean(some, "robots")) for name, some, most in groups if some]
    checks.append(_at_most("an honest robot is named, seconds", INNOCENT, *_worst(rows, "innocent")))
    return [*checks, _at_most("slower", SLOWER, *_worst(rows, "slower"))]


def _worst(rows: Sequence[Row], column: str) -> tuple[float | None, str]:
    row = max(rows, key=lambda row: row[column] or 0.0)
    return row[column], f" ({row['lie']}, seed {row['seed']})"


def _at_most(what: str, most: float, value: float | None, where: str = "") -> tuple[bool, str]:
    holds = value is not None and value <= most
    return holds, f"{what}, at most {most:g}: {cell(value, '{:.2f}')}{where}"
