"""Two runs of the boards on the same samples: how much error and log score changed, with intervals. Pure.

The run is cut into BLOCKS pieces of time of the same length, which are taken as independent (`intervals.mean_of_blocks`).
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from blackboard.judge.intervals import Estimate, mean_of_blocks, shown
from blackboard.judge.samples import GROUPS, Sample

BLOCKS = 10
LEVELS = ("consensus", "agreed")  # what boards make

Table = dict[str, Any]
Name = tuple[int, str, str, str, str]  # tick, robot, sub-team, subject, level


def paired(ones: Iterable[Sample], others: Iterable[Sample]) -> Table:
    """How much higher mean error (unit) and mean log score (nats) of the others are, on the samples that both have.

    Group -> level -> {"n", "error", "log_score"}, the latter two as {"value", "low", "high"}; low and high are None where not every
    block has samples.
    """
    known = {_name(sample): sample for sample in ones}
    rows: dict[tuple[str, str], list[tuple[int, float, float]]] = defaultdict(list)
    for other in others:
        one = known.get(_name(other))
        group = next((group for group, prefix in GROUPS.items() if other.subject.startswith(prefix)), None)
        if one is not None and group is not None and other.level in LEVELS:
            rows[group, other.level].append((other.tick, other.error - one.error, other.log_score - one.log_score))
    return {
        group: {level: _estimates(rows[group, level]) for level in LEVELS if (group, level) in rows} for group in GROUPS
    }


def _estimates(rows: list[tuple[int, float, float]]) -> Table:
    ticks, errors, scores = (np.array(column, float) for column in zip(*rows, strict=True))
    block = np.minimum(BLOCKS - 1, (ticks - ticks.min()) * BLOCKS // (np.ptp(ticks) + 1)).astype(int)
    return {"n": len(rows), "error": _interval(errors, block), "log_score": _interval(scores, block)}


def _interval(values: np.ndarray, block: np.ndarray) -> Table:
    counts = np.bincount(block, minlength=BLOCKS)
    if not counts.all():
        return asdict(Estimate(float(values.mean())))
    return asdict(mean_of_blocks(np.bincount(block, values, minlength=BLOCKS), counts))


def _name(sample: Sample) -> Name:
    return sample.tick, sample.robot, sample.sub_team, sample.subject, sample.level


def text(table: Table, unit: str) -> str:
    lines = [f"`what if` less `unchanged`, on the same samples (95 % intervals from {BLOCKS} blocks of time):"]
    for group, levels in table.items():
        for level, difference in levels.items():
            error, score = (
                shown(difference[name], sign="+", without=" (too short for an interval)")
                for name in ("error", "log_score")
            )
            lines.append(f"  {group} {level}: error {error} {unit}, log score {score} nats (n {difference['n']})")
    return "\n".join(lines)
