"""The picture of a sweep: each run as a dot, the mean of each combination with its 95 % interval (extra `plot`)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from blackboard.judge.samples import GROUPS
from blackboard.lab.drawing import BLACK, STYLE, VERMILION, save_all
from blackboard.lab.sweep_plan import Planned
from blackboard.lab.sweep_report import Card, measure

COLUMNS = {"rmse": "RMSE [{unit}]", "log_score": "log score [nats]", "coverage_95": "in the 95 % region"}


def draw_sweep(table: Mapping[str, Any], planned: Sequence[Planned], cards: Sequence[Card], folder: Path) -> None:
    """Draw what was agreed in each combination into a folder, as sweep.svg and sweep.png."""
    with mpl.rc_context(STYLE):
        save_all({"sweep": comparison(table, planned, cards)}, folder)


def comparison(table: Mapping[str, Any], planned: Sequence[Planned], cards: Sequence[Card]) -> Figure:
    """A row for robots and one for objects, a column for each measure, a line of dots for each combination."""
    combinations = table["combinations"]
    height = 1.2 + 2 * (0.5 + 0.3 * len(combinations))
    figure = Figure(figsize=(3 + 2.6 * len(COLUMNS), height), layout="constrained")
    figure.suptitle(
        f"{table['scenario']}, seeds {_ranges(table['seeds'])} (dots): means of what is agreed, 95 % intervals"
    )
    axes = figure.subplots(len(GROUPS), len(COLUMNS), squeeze=False, sharey=True)
    for row, group in zip(axes, GROUPS, strict=True):
        row[0].set_ylabel(group)
        for axis, (name, title) in zip(row, COLUMNS.items(), strict=True):
            for one, card in zip(planned, cards, strict=True):
                axis.plot(measure(card, group, "agreed", name), one.combination, ".", color=BLACK, ms=5, zorder=3)
            for number, each in enumerate(combinations):
                at = each["scores"][group]["agreed"][name]
                if at["low"] is not None:
                    axis.plot([at["low"], at["high"]], [number, number], color=VERMILION, lw=2)
                if at["value"] is not None:
                    axis.plot(at["value"], number, "|", color=VERMILION, ms=10)
            if name == "coverage_95":
                axis.axvline(0.95, color=BLACK, lw=0.8)
            axis.set_title(title.format(unit=table["unit"]))
            axis.set_yticks(range(len(combinations)), [each["label"] for each in combinations])
            axis.set_ylim(len(combinations) - 0.5, -0.5)
    return figure


def _ranges(seeds: Sequence[int]) -> str:
    """Seeds as they are given: 1..4,9."""
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][-1] + 1:
            runs[-1].append(seed)
        else:
            runs.append([seed])
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}..{run[-1]}" for run in runs)
