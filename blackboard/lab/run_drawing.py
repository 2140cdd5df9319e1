"""The pictures of a run: error, 95 % region, entropy and coverage over time, and where everything was (extra `plot`)."""

from collections.abc import Callable, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from blackboard.errors import RunFailed
from blackboard.judge.calibration import BLOCK, FEWEST
from blackboard.judge.intervals import Estimate, share_of_blocks, shown, student
from blackboard.judge.samples import GROUPS, Sample, held_by, rms_error
from blackboard.lab.drawing import BLACK, BLUE, ORANGE, STYLE, VERMILION, save_all
from blackboard.opinion.grid import Array

LINES = {"solo": (ORANGE, ":"), "consensus": (BLUE, "--"), "agreed": (VERMILION, "-")}  # level -> colour, line style
BIN = 1.0  # seconds of team time in a point of a line; BLOCK in one of coverage
COVERED = 95  # percent
ELLIPSES = 12  # of a way
CHI2 = 5.991465  # of two degrees of freedom, 95 %
WIDE = 3  # panels beside each other
Axis = Any  # of matplotlib, which has no types


def draw_run(samples: Sequence[Sample], unit: str, folder: Path, title: str) -> list[Path]:
    """Draw a run, which `title` names, into a folder, as SVG and PNG: the files. RunFailed: it has no samples."""
    if not samples:
        raise RunFailed(f"--plot {folder}: the run has no samples, so there is nothing to draw")
    with mpl.rc_context(STYLE):
        figures = {"over-time": over_time(samples, unit, title), "trajectories": trajectories(samples, unit, title)}
    return save_all(figures, folder)


def over_time(samples: Sequence[Sample], unit: str, title: str) -> Figure:
    """Four rows (error, area of the 95 % region, entropy, coverage of it) for robots and for objects, a line for each level.

    The legend of the coverage has the share of the whole run, and its 95 % interval where there are blocks enough.
    """
    rows: list[tuple[str, float, Callable[[list[Sample]], float]]] = [
        (f"RMS error [{unit}]", BIN, rms_error),
        (f"95 % region [{unit}²]", BIN, lambda some: float(np.median([s.area for s in some]))),
        ("entropy [nats]", BIN, lambda some: float(np.mean([s.entropy for s in some]))),
        ("in the 95 % region", BLOCK, lambda some: float(held_by(some, COVERED).mean())),
    ]
    groups = [group for group, prefix in GROUPS.items() if any(s.subject.startswith(prefix) for s in samples)]
    figure = Figure(figsize=(1 + 4.2 * len(groups), 8), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(len(rows), len(groups), squeeze=False, sharex=True, sharey="row")
    for number, (column, group) in enumerate(zip(axes.T, groups, strict=True)):
        own = [s for s in samples if s.subject.startswith(GROUPS[group])]
        for axis, (label, width, value) in zip(column, rows, strict=True):
            for level, (colour, style) in LINES.items():
                some = [s for s in own if s.level == level]
                shares = width == BLOCK
                axis.plot(
                    *binned(some, width, value), color=colour, ls=style, lw=1.4, marker="." if shares else "",
                    label=f"{level} {coverage(some)}" if shares and some else level,
                )  # fmt: skip
            if width == BLOCK:
                axis.axhline(COVERED / 100, color=BLACK, lw=0.8)
                axis.set_ylim(0, 1.05)
                axis.legend(fontsize=8)
            axis.set_ylabel("" if number else label)
        column[0].set_title(group)
        column[-1].set_xlabel("team time [s]")
    axes[0, 0].legend(fontsize=8)
    return figure


def coverage(samples: Sequence[Sample]) -> str:
    """The share of at least one sample's 95 % regions that hold the truth, with its interval where there are blocks enough."""
    _, block = np.unique([ceil(sample.time / BLOCK - 1e-9) for sample in samples], return_inverse=True)
    held, n = np.bincount(block, weights=held_by(samples, COVERED)), np.bincount(block)
    share = Estimate(held.sum() / n.sum()) if len(n) < FEWEST else share_of_blocks(held, n, student(len(n) - 1))
    return shown(vars(share), 2)


def binned(samples: Sequence[Sample], width: float, value: Callable[[list[Sample]], float]) -> tuple[Array, Array]:
    """The ends of the intervals of a width (s) that have samples, and the value of the samples in each."""
    bins: dict[int, list[Sample]] = {}
    for sample in samples:
        bins.setdefault(ceil(sample.time / width - 1e-9), []).append(sample)
    return width * np.array(sorted(bins), float), np.array([value(bins[number]) for number in sorted(bins)])


def trajectories(samples: Sequence[Sample], unit: str, title: str) -> Figure:
    """A panel for each subject: where it was (black), where it was agreed to be, and 95 % ellipses along that way."""
    subjects = sorted({s.subject for s in samples}, key=lambda s: (not s.startswith("robot/"), s))
    columns = min(WIDE, len(subjects))
    rows = ceil(len(subjects) / columns)
    figure = Figure(figsize=(1 + 3.0 * columns, 0.8 + 3.0 * rows), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axis, subject in zip(axes.ravel(), subjects, strict=False):
        way = agreed_way(samples, subject)
        axis.plot([s.truth_x for s in way], [s.truth_y for s in way], color=BLACK, lw=1.5, label="truth")
        axis.plot([s.mean_x for s in way], [s.mean_y for s in way], color=VERMILION, lw=1, label="agreed")
        for sample in way[:: max(1, len(way) // ELLIPSES)]:
            axis.add_patch(ellipse(sample))
        axis.set_title(subject)
        axis.set_aspect("equal")
    for axis in axes.ravel()[len(subjects) :]:
        axis.set_visible(False)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    oval = Line2D([], [], ls="", marker="o", mfc="none", color=BLUE)
    axes[0, 0].legend([*handles, oval], [*labels, "95 % of what is agreed"], fontsize=7)
    figure.supxlabel(f"x [{unit}]")
    figure.supylabel(f"y [{unit}]")
    return figure


def agreed_way(samples: Sequence[Sample], subject: str) -> list[Sample]:
    """What was agreed about a subject, one sample for each tick: an object has one for each robot that knows of it."""
    way: dict[int, Sample] = {}
    for sample in samples:
        if sample.subject == subject and sample.level == "agreed":
            way.setdefault(sample.tick, sample)
    return [way[tick] for tick in sorted(way)]


def ellipse(sample: Sample) -> Ellipse:
    """The ellipse that holds 95 % of a Gaussian with the belief's mean and covariance."""
    values, axes = np.linalg.eigh([[sample.var_x, sample.cov_xy], [sample.cov_xy, sample.var_y]])
    height, width = 2 * np.sqrt(CHI2 * np.maximum(values, 0.0))
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return Ellipse((sample.mean_x, sample.mean_y), width, height, angle=angle, fill=False, color=BLUE, lw=0.8)
