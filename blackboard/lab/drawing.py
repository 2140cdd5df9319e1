"""The laboratory's pictures: matplotlib (the extra `plot`), the same bytes for the same numbers.

Colours are Okabe and Ito's, which colour-blind readers can tell apart, and every line has a style or marker of its own.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from blackboard.errors import UserError, writing

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
GALLERY = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Figures</title>
<style>body { font: 15px system-ui, sans-serif; max-width: 1100px; margin: 24px auto }
img { width: 100% } figure { margin: 0 0 48px }</style>"""


def save(figure: Figure, file: Path) -> None:
    """Write a figure, byte for byte the same each time; the name's ending says how: .svg or .png."""
    title = {"Title": text} if (text := figure.get_suptitle()) else {}  # without one Matplotlib takes no key of it
    known: dict[str, dict[str, str | None]] = {
        ".svg": {"Date": None, "Creator": None, **title},
        ".png": {"Software": None},
    }
    metadata = known.get(file.suffix)
    if not metadata:
        raise UserError(f"{file}: pictures are written as .svg or .png; choose one of these endings")
    with writing(file), mpl.rc_context(STYLE):
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, metadata=metadata)


def save_all(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Write each figure by its name as SVG and as PNG into a folder: the files."""
    files = [(figure, folder / f"{name}{ending}") for name, figure in figures.items() for ending in (".svg", ".png")]
    for figure, file in files:
        save(figure, file)
    return [file for _, file in files]


def gallery(folder: Path) -> Path:
    """Write a page of all SVG pictures in a folder, each with its title: the page."""
    shown = []
    for file in sorted(folder.glob("*.svg")):
        match = re.search(r"<dc:title>(.*?)</dc:title>", file.read_text(encoding="utf-8"), re.DOTALL)
        title = f"{file.stem}: {match[1]}" if match else file.stem  # text of an XML file: escaped already
        if match and match[1].startswith("Fig. "):  # the title of a figure of the paper names it already
            title = match[1]
        shown.append(f'<figure><img src="{file.name}" alt="{title}"><figcaption>{title}</figcaption></figure>')
    page = folder / "index.html"
    with writing(page):
        page.write_text("\n".join([GALLERY, *shown]) + "\n", encoding="utf-8")
    return page


def comparison(table: Mapping[str, Any]) -> Figure:
    """The lab's table: for each situation the rules' 95 % coverage, log score and median error, with intervals."""
    columns = {"coverage_95": "95 % coverage", "log_score": "log score [nats]", "median": "median error"}
    rules, situations = list(table["rules"]), table["trials"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.4 + 2.6 * len(situations), 1.2 + 0.62 * len(rules)), layout="constrained")
        axes = figure.subplots(len(columns), len(situations), squeeze=False, sharey=True, sharex="row")
        for row, (column, label) in zip(axes, columns.items(), strict=True):
            for axis, (situation, results) in zip(row, situations.items(), strict=True):
                for place, rule in enumerate(rules):
                    if rule not in results["rules"]:  # a scenario's own [board] takes part in its team's run only
                        continue
                    e = results["rules"][rule][column]
                    colour, width = (VERMILION, 3) if rule == table["default"] else (BLUE, 1.5)
                    marker, size = ("*", 10) if rule in results["best"][column] else ("o", 5)
                    if e["low"] is not None:  # of too few runs there is no interval
                        axis.plot([e["low"], e["high"]], [place, place], color=colour, lw=width)
                    axis.plot(e["value"], place, marker=marker, ms=size, color=colour)
                if column == "coverage_95":
                    axis.axvline(0.95, color=BLACK, ls=":", lw=1)
                    axis.set_title(situation)
                axis.set_xlabel(label)
        axes[0][0].set_yticks(np.arange(len(rules)), rules)
        axes[0][0].invert_yaxis()
        figure.suptitle(f"all rules on the same opinions; thick: the default ({table['default']}); star: best")
        return figure


# --- the paper's figures ---------------------------------------------------------------------------------------------

#: Rule -> (the paper's name for it, or ours; colour, line style, marker).
LINES = {
    "alone": ("a robot alone", BLACK, ":", "s"),
    "linear": ("LOP", SKY, "-.", "^"),
    "logarithmic": ("LGP (w = 1)", GREEN, "--", "v"),
    "cooperative": ("COP as printed", VERMILION, "-", "o"),
    "cooperative, reference cell": ("COP, reference cell 1 unit", PURPLE, "--", "D"),
    "coalition": ("coalition, a board's default", BLUE, "-.", "P"),
    "coalition, independent": ("coalition, independence 1", SKY, "-", "X"),
    "joint": ("joint", GREEN, "-", "*"),
}
APART = 8.0  # units between the names of two opinions
BELOW: Any = "outside lower center"  # where a legend hides nothing


def paper(table: Mapping[str, Any]) -> dict[str, Figure]:
    """Some of Figs. 1 to 7 by their file names, from their numbers (`blackboard.lab.paper`)."""
    draw = {"fig3": _ratios, "fig6": _over_time, "fig7": _over_size}
    with mpl.rc_context(STYLE):
        return {name: draw.get(name, _beliefs)(data) for name, data in sorted(table.items())}


def _figure(rows: int, columns: int, title: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(max(6.5, 1 + 3.6 * columns), 1.4 + 2.4 * rows), layout="constrained")
    figure.suptitle(title)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _line(axis: Any, rule: str, x: Any, y: Any, every: int | None = 1, label: str = "") -> None:
    """A rule's line, with its marker at each of `every` points, or none."""
    name, colour, style, marker = LINES[rule]
    marked = {} if every is None else {"marker": marker, "markevery": every}
    axis.plot(x, y, color=colour, ls=style, ms=4, lw=1.6, label=name + label, **marked)


def _interval(axis: Any, rule: str, x: Any, values: Mapping[str, Any], metric: str) -> None:
    low, high = (values[f"{metric}_{end}"] for end in ("low", "high"))
    if None not in low:
        axis.fill_between(x, low, high, color=LINES[rule][1], alpha=0.15, lw=0)


def _beliefs(data: Mapping[str, Any]) -> Figure:
    """Opinions on a line (grey, each with its name) and what each rule makes of them."""
    figure, ((*axes,),) = _figure(1, len(data["cases"]), data["title"])
    for axis, (name, case) in zip(axes, data["cases"].items(), strict=True):
        for p in case["opinions"]:
            axis.plot(case["x"], p, color="#999999", lw=1)
        for rule, fused in case["fused"].items():
            _line(axis, rule, case["x"], fused["p"], None, f", H = {fused['entropy']:.3f}")
        _name_opinions(axis, case)
        axis.set_title(name)
        axis.set_xlabel("place [units]")
        axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.22))
    axes[0].set_ylabel("probability of a cell")
    return figure


def _name_opinions(axis: Any, case: Mapping[str, Any]) -> None:
    """The name of each opinion above all curves, with a thin line to its peak."""
    top = max(max(p) for p in [*case["opinions"], *(fused["p"] for fused in case["fused"].values())])
    peaks = [(case["x"][int(np.argmax(p))], max(p), i) for i, p in enumerate(case["opinions"])]
    order = sorted(peaks)
    places = np.array([x for x, _, _ in order], dtype=float)
    places = np.maximum.accumulate(places - APART * np.arange(len(order))) + APART * np.arange(len(order))
    places -= np.mean(places - [x for x, _, _ in order])
    for (x, height, i), place in zip(order, places, strict=True):
        axis.annotate(
            case["names"][i],
            (x, height),
            (place, 1.12 * top),
            ha="center",
            fontsize=8,
            color="#555555",
            arrowprops={"arrowstyle": "-", "color": "#bbbbbb", "lw": 0.6},
        )
    axis.set_ylim(top=1.22 * top)


def _ratios(data: Mapping[str, Any]) -> Figure:
    figure, ((axis,),) = _figure(1, 1, data["title"])
    for rule, ratios in data["ratios"].items():
        _line(axis, rule, data["places"], ratios)
    axis.axhline(1.0, color=BLACK, lw=1)
    axis.set_xlabel("place of the robot [units]")
    axis.set_ylabel("entropy / best sensor's")
    figure.legend(*axis.get_legend_handles_labels(), loc=BELOW, ncols=3, fontsize=8)
    return figure


METRICS = {
    "entropy": "entropy [nats]",
    "log_score": "log score [nats]",
    "coverage_50": "50 % coverage",
    "coverage_95": "95 % coverage",
}


def _over_time(data: Mapping[str, Any]) -> Figure:
    """Fig. 6: each metric over time."""
    figure, _ = _by_grid(data, METRICS, "time", "time [s]", max(1, len(data["time"]) // 10))
    return figure


def _over_size(data: Mapping[str, Any]) -> Figure:
    """Fig. 7: each metric over the size of the team."""
    metrics = {"ratio": "entropy / original entropy", **{m: METRICS[m] for m in METRICS if m != "entropy"}}
    figure, axes = _by_grid(data, metrics, "robots", "robots that cooperate")
    for axis in axes.flat:
        axis.set_xticks(data["robots"])
    return figure


def _by_grid(
    data: Mapping[str, Any], metrics: Mapping[str, str], along: str, place: str, every: int = 1
) -> tuple[Figure, Any]:
    """A panel per metric and grid, over `along` (a key of `data`, labelled `place`), with 95 % intervals if there are enough runs."""
    figure, axes = _figure(len(metrics), len(data["grids"]), data["title"])
    for column, (size, by_rule) in zip(axes.T, data["grids"].items(), strict=True):
        for axis, (metric, label) in zip(column, metrics.items(), strict=True):
            for rule, values in by_rule.items():
                _line(axis, rule, data[along], values[metric], every)
                _interval(axis, rule, data[along], values, metric)
            axis.set_ylabel(label)
        _finish(column, size, by_rule, place)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc=BELOW, ncols=1 + axes.shape[1], fontsize=8)
    return figure, axes


def _finish(column: Any, size: str, by_rule: Mapping[str, Any], label: str) -> None:
    """The title of a grid's column, with the curves that coincide in it, its axis, and what the coverages should be."""
    same = [
        f"{LINES[one][0]} = {LINES[other][0]}"
        for i, one in enumerate(by_rule)
        for other in list(by_rule)[:i]
        if all(np.allclose(by_rule[one][metric], by_rule[other][metric], atol=1e-9) for metric in METRICS)
    ]
    column[0].set_title("\n".join([f"{size} x {size} cells", *same]), fontsize=9)
    column[-1].set_xlabel(label)
    for axis, level in ((column[-2], 0.5), (column[-1], 0.95)):
        axis.axhline(level, color=BLACK, lw=1)
