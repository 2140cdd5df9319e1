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

from blackboard.errors import UserError

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
        raise UserError(f"{file}: pictures are written as .svg or .png; choose one of these endings")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(STYLE):
            figure.savefig(file, metadata=metadata)
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror}); choose another place") from error


def comparison(found: Mapping[str, Any]) -> Figure:
    """The lab's table: for each situation the rules' 95 % coverage, log score and median error, with intervals."""
    columns = {"coverage_95": "95 % coverage", "log_score": "log score [nats]", "median": "median error"}
    rules, situations = list(found["rules"]), found["trials"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.4 + 2.6 * len(situations), 1.2 + 0.62 * len(rules)), layout="constrained")
        axes = figure.subplots(len(columns), len(situations), squeeze=False, sharey=True, sharex="row")
        for row, (column, label) in zip(axes, columns.items(), strict=True):
            for axis, (situation, results) in zip(row, situations.items(), strict=True):
                for place, rule in enumerate(rules):
                    if rule not in results["rules"]:  # a scenario's own [board] takes part in its team's run only
                        continue
                    e = results["rules"][rule][column]
                    default, best = rule == found["default"], rule in results["best"][column]
                    if e["low"] is not None:  # of too few runs there is no interval
                        axis.plot(
                            [e["low"], e["high"]],
                            [place, place],
                            color=VERMILION if default else BLUE,
                            lw=3 if default else 1.5,
                        )
                    axis.plot(
                        e["value"], place, marker="*" if best else "o", ms=10 if best else 5,
                        color=VERMILION if default else BLUE,
                    )  # fmt: skip
                if column == "coverage_95":
                    axis.axvline(0.95, color=BLACK, ls=":", lw=1)
                    axis.set_title(situation)
                axis.set_xlabel(label)
        axes[0][0].set_yticks(np.arange(len(rules)), rules)
        axes[0][0].invert_yaxis()
        figure.suptitle(f"all rules on the same opinions; thick: the default ({found['default']}); star: best")
        return figure


# --- the paper's figures ---------------------------------------------------------------------------------------------

#: Rule -> (colour, line style, marker).
LINES = {
    "alone": (BLACK, ":", "s"),
    "linear": (SKY, "-.", "^"),
    "logarithmic": (GREEN, "--", "v"),
    "cooperative": (VERMILION, "-", "o"),
    "cooperative, reference cell": (PURPLE, "--", "D"),
    "coalition": (BLUE, "-.", "P"),
    "coalition, independent": (SKY, "-", "X"),
}


def paper(found: Mapping[str, Any]) -> dict[str, Figure]:
    """Figs. 1 to 7 by their file names, from `blackboard.lab.paper.numbers`."""
    with mpl.rc_context(STYLE):
        figures = {f"fig{n}": _beliefs(found[f"fig{n}"]) for n in (1, 2, 4, 5)}
        figures |= {
            "fig3": _ratios(found["fig3"]),
            "fig6": _over_time(found["fig6"]),
            "fig7": _over_size(found["fig7"]),
        }
    return dict(sorted(figures.items()))


def _figure(rows: int, columns: int, title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(1 + 3.6 * columns, 1 + 2.4 * rows), layout="constrained")
    figure.suptitle(title)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _line(axis: Any, rule: str, x: Any, y: Any, marks: bool = True, label: str | None = None) -> None:
    colour, style, marker = LINES[rule]
    axis.plot(x, y, color=colour, ls=style, marker=marker if marks else None, ms=4, lw=1.6, label=label or rule)


def _beliefs(data: Mapping[str, Any]) -> Figure:
    """Opinions on a line (grey) and what each rule makes of them."""
    figure, ((*axes,),) = _figure(1, len(data["cases"]), data["title"])
    for axis, (name, case) in zip(axes, data["cases"].items(), strict=True):
        for p in case["opinions"]:
            axis.plot(case["x"], p, color="#999999", lw=1)
        for rule, fused in case["fused"].items():
            _line(axis, rule, case["x"], fused["p"], False, f"{rule}, H = {fused['entropy']:.3f}")
        axis.set_title(name)
        axis.set_xlabel("place [units]")
        axis.legend(fontsize=7)
    axes[0].set_ylabel("probability of a cell")
    return figure


def _ratios(data: Mapping[str, Any]) -> Figure:
    figure, ((axis,),) = _figure(1, 1, data["title"])
    for rule, ratios in data["ratios"].items():
        _line(axis, rule, range(1, len(ratios) + 1), ratios)
    axis.axhline(1.0, color=BLACK, lw=1)
    axis.set_xlabel("place of the robot")
    axis.set_ylabel("entropy / best sensor's")
    axis.legend(fontsize=7)
    return figure


METRICS = {"entropy": "entropy [nats]", "log_score": "log score [nats]", "coverage_95": "95 % coverage"}


def _over_time(data: Mapping[str, Any]) -> Figure:
    """Fig. 6: each metric over time for each grid."""
    figure, axes = _figure(len(METRICS), len(data["grids"]), data["title"])
    for column, (size, by_rule) in zip(axes.T, data["grids"].items(), strict=True):
        for axis, (metric, label) in zip(column, METRICS.items(), strict=True):
            for rule, values in by_rule.items():
                _line(axis, rule, data["time"], values[metric])
            axis.set_ylabel(label)
        column[0].set_title(f"{size} x {size} cells")
        column[-1].set_xlabel("time [s]")
        column[-1].axhline(0.95, color=BLACK, lw=1)
    axes[0][0].legend(fontsize=7)
    return figure


def _over_size(data: Mapping[str, Any]) -> Figure:
    """Fig. 7: each metric over the size of the team for each grid, with its spread over the seeds."""
    metrics = {"ratio": "entropy / original entropy", **{m: METRICS[m] for m in ("log_score", "coverage_95")}}
    figure, axes = _figure(len(metrics), len(data["grids"]), data["title"])
    for column, (size, by_rule) in zip(axes.T, data["grids"].items(), strict=True):
        for axis, (metric, label) in zip(column, metrics.items(), strict=True):
            for rule, values in by_rule.items():
                _line(axis, rule, data["robots"], values[metric])
                low, high = (values[f"{metric}_{end}"] for end in ("low", "high"))
                axis.fill_between(data["robots"], low, high, color=LINES[rule][0], alpha=0.15, lw=0)
            axis.set_ylabel(label)
        column[0].set_title(f"{size} x {size} cells")
        column[-1].set_xlabel("robots that cooperate")
        column[-1].axhline(0.95, color=BLACK, lw=1)
    axes[0][0].legend(fontsize=7)
    return figure
