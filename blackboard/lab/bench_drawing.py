"""The bench's pictures: of each protocol the robots' ways, their errors and the areas of their 95 % regions over time."""

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from blackboard.judge.samples import Sample
from blackboard.lab import bench
from blackboard.lab.comparison import IDEAL
from blackboard.lab.drawing import BLACK, BLUE, GREEN, STYLE, VERMILION, save

__all__ = ["protocol", "save"]

GREY = "#999999"
LINES = {  # way -> colour, line style
    "solo": (GREY, ":"),
    "opinions": (BLUE, "--"),
    "solo (joint)": (GREY, "-."),
    "joint": (VERMILION, "-"),
    IDEAL: (GREEN, "--"),
}
Axis = Any  # of matplotlib, which has no types


def protocol(name: str, runs: Sequence[bench.Run]) -> dict[str, Figure]:
    """What is drawn of one protocol's runs: "trajectories", "errors" and "areas", a panel for each robot."""
    by_way = bench.ways(runs, bench.own_places)
    with mpl.rc_context(STYLE):
        return {
            "trajectories": _panels(
                f"{name}: where they were (black) and what was agreed on", by_way, _trajectory, False
            ),
            "errors": _panels(f"{name}: error [m]", by_way, _over_time(lambda s: s.error), True),
            "areas": _panels(f"{name}: area of the 95 % region [m²]", by_way, _over_time(lambda s: s.area), True),
        }


def _panels(
    title: str, by_way: dict[str, list[Sample]], draw: Callable[[Axis, dict[str, list[Sample]]], None], times: bool
) -> Figure:
    """A panel for each robot: below each other where time runs to the right, else side by side."""
    robots = sorted({sample.robot for samples in by_way.values() for sample in samples})
    shape = (len(robots), 1) if times else (1, len(robots))
    figure = Figure(figsize=(8, 1 + 1.3 * len(robots)) if times else (1 + 2.4 * len(robots), 4.5), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(*shape, squeeze=False, sharex=True, sharey=True).ravel()
    for axis, robot in zip(axes, robots, strict=True):
        draw(axis, {way: [sample for sample in samples if sample.robot == robot] for way, samples in by_way.items()})
        axis.set_title(robot)
    axes[0].legend(fontsize=7, loc="upper right")
    axes[-1].set_xlabel("time [s]" if times else "x [m]")
    if not times:
        axes[0].set_ylabel("y [m]")
    return figure


def _trajectory(axis: Axis, by_way: dict[str, list[Sample]]) -> None:
    one = next(iter(by_way.values()))
    axis.plot([s.truth_x for s in one], [s.truth_y for s in one], color=BLACK, lw=1.5, label="truth")
    for way, samples in by_way.items():
        if not way.startswith("solo"):
            colour, style = LINES[way]
            axis.plot([s.mean_x for s in samples], [s.mean_y for s in samples], color=colour, ls=style, lw=1, label=way)
    axis.set_aspect("equal")


def _over_time(value: Callable[[Sample], float]) -> Callable[[Axis, dict[str, list[Sample]]], None]:
    def draw(axis: Axis, by_way: dict[str, list[Sample]]) -> None:
        for way, samples in by_way.items():
            colour, style = LINES[way]
            axis.plot([s.time for s in samples], [value(s) for s in samples], color=colour, ls=style, lw=1, label=way)
        axis.set_yscale("log")

    return draw
