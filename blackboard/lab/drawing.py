"""The laboratory's pictures: matplotlib (the extra `plot`), the same bytes for the same numbers.

Colours are Okabe and Ito's, which colour-blind readers can tell apart, and every line has a style or marker of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from blackboard.errors import Mistake

BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
STYLE: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so that every machine draws the same
    "font.size": 9,
    "svg.hashsalt": "cop-blackboard",
    "svg.fonttype": "path",
    "figure.dpi": 120,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def save(figure: Figure, file: Path) -> None:
    """Write a figure, byte for byte the same each time; the name's ending says how: .svg or .png."""
    metadata: dict[str, None] = {".svg": {"Date": None, "Creator": None}, ".png": {"Software": None}}.get(
        file.suffix, {}
    )
    if not metadata:
        raise Mistake(f"{file}: pictures are written as .svg or .png; choose one of these endings")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(STYLE):
            figure.savefig(file, metadata=metadata)
    except OSError as error:
        raise Mistake(f"{file}: cannot be written ({error.strerror}); choose another place") from error


def contest(found: Mapping[str, Any]) -> Figure:
    """The lab's table: for each trial the rules' 95 % coverage, log score and median error, with intervals."""
    columns = {"coverage_95": "95 % coverage", "log_score": "log score [nats]", "median": "median error"}
    rules, trials = list(found["rules"]), found["trials"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.4 + 2.6 * len(trials), 1.2 + 0.62 * len(rules)), layout="constrained")
        axes = figure.subplots(len(columns), len(trials), squeeze=False, sharey=True, sharex="row")
        for row, (column, label) in zip(axes, columns.items(), strict=True):
            for axis, (trial, told) in zip(row, trials.items(), strict=True):
                for place, rule in enumerate(rules):
                    e = told["rules"][rule][column]
                    ours, best = rule == found["default"], rule in told["best"][column]
                    axis.plot(
                        [e["low"], e["high"]], [place, place], color=VERMILION if ours else BLUE, lw=3 if ours else 1.5
                    )
                    axis.plot(
                        e["value"], place, marker="*" if best else "o", ms=10 if best else 5,
                        color=VERMILION if ours else BLUE,
                    )  # fmt: skip
                if column == "coverage_95":
                    axis.axvline(0.95, color=BLACK, ls=":", lw=1)
                    axis.set_title(trial)
                axis.set_xlabel(label)
        axes[0][0].set_yticks(np.arange(len(rules)), rules)
        axes[0][0].invert_yaxis()
        figure.suptitle(f"all rules on the same opinions; thick: the default ({found['default']}); star: best")
        return figure
