"""Two runs of the boards on the same samples: how much error and log score changed, with intervals. Pure.

Samples that follow each other are alike, so an interval over samples would be too narrow. The run is cut into BLOCKS pieces of time
of the same length, whose means are taken as independent (the method of batch means, e.g. Law, Simulation Modeling and Analysis).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np

from sim_world.referee import GROUPS
from sim_world.series import Sample

BLOCKS = 10
STUDENT = 2.262  # two-sided 95 %, 9 degrees of freedom
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
            rows[group, other.level].append((other.tick, _error(other) - _error(one), other.log_score - one.log_score))
    return {group: {level: _told(rows[group, level]) for level in LEVELS if (group, level) in rows} for group in GROUPS}


def _told(rows: list[tuple[int, float, float]]) -> Table:
    ticks, errors, scores = (np.array(column, float) for column in zip(*rows, strict=True))
    block = np.minimum(BLOCKS - 1, (ticks - ticks.min()) * BLOCKS // (np.ptp(ticks) + 1)).astype(int)
    return {"n": len(rows), "error": _interval(errors, block), "log_score": _interval(scores, block)}


def _interval(values: np.ndarray, block: np.ndarray) -> Table:
    mean = float(values.mean())
    counts = np.bincount(block, minlength=BLOCKS)
    if not counts.all():
        return {"value": mean, "low": None, "high": None}
    means = np.bincount(block, values, minlength=BLOCKS) / counts
    half = STUDENT * float(means.std(ddof=1)) / math.sqrt(BLOCKS)
    return {"value": mean, "low": mean - half, "high": mean + half}


def _name(sample: Sample) -> Name:
    return sample.tick, sample.robot, sample.sub_team, sample.subject, sample.level


def _error(sample: Sample) -> float:
    return math.hypot(sample.mean_x - sample.truth_x, sample.mean_y - sample.truth_y)


def text(table: Table, unit: str) -> str:
    """The table in lines."""
    lines = [f"`what if` less `unchanged`, on the same samples (95 % intervals from {BLOCKS} blocks of time):"]
    for group, levels in table.items():
        for level, it in levels.items():
            lines.append(
                f"  {group} {level}: error {_span(it['error'])} {unit}, log score {_span(it['log_score'])} nats (n {it['n']})"
            )
    return "\n".join(lines)


def _span(it: Table) -> str:
    if it["low"] is None:
        return f"{it['value']:+.3f} (too short for an interval)"
    return f"{it['value']:+.3f} [{it['low']:+.3f}, {it['high']:+.3f}]"
