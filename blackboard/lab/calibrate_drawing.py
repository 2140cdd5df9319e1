"""The pictures of a calibration: what is left of each robot's readings and motions once its sensors are known (extra `plot`)."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from blackboard.calibrate.fit import Fit
from blackboard.calibrate.found import FoundTeam
from blackboard.lab.drawing import BLACK, BLUE, ORANGE, STYLE, VERMILION, save_all


def draw(calibration: FoundTeam, unit: str, folder: Path) -> list[Path]:
    """Draw the residuals of each robot, and where all drove, into a folder as SVG and PNG: the files."""
    with mpl.rc_context(STYLE):
        figures = {
            f"residuals-{name}": residuals(calibration.fit, n, unit) for n, name in enumerate(calibration.robots)
        }
        return save_all({**figures, "ways": ways(calibration, unit)}, folder)


def residuals(fit: Fit, robot: int, unit: str) -> Figure:
    """Errors of range by distance, of bearing by angle, and of the motions over time, with two sigmas of what was found."""
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 2)
    seen, noise = fit.drives.sightings, fit.noise
    for good, colour, marker in ((True, BLUE, "."), (False, VERMILION, "x")):
        rows = (seen.robot == robot) & ((fit.believed > 0.5) == good)
        style = {"marker": marker, "ms": 3, "ls": "", "color": colour, "label": "sightings" if good else "misreads"}
        axes[0, 0].plot(seen.range[rows], fit.sighted.residual[rows, 0], **style)
        axes[0, 1].plot(seen.bearing[rows], fit.sighted.residual[rows, 1], **style)
    far = np.linspace(0.0, max(1.0, float(seen.range.max(initial=1.0))), 50)
    sigma = np.sqrt(noise.range_variance(np.full(50, robot), far))
    for side in (-2, 2):
        axes[0, 0].plot(far, side * sigma, color=BLACK, lw=0.8)
        axes[0, 1].axhline(side * float(noise.bearing[robot]), color=BLACK, lw=0.8)
    axes[0, 0].set(xlabel=f"range [{unit}]", ylabel=f"error of the range [{unit}]")
    axes[0, 1].set(xlabel="bearing [rad]", ylabel="error of the bearing [rad]")
    rows = fit.odometry.shared[0][0] == robot
    times = fit.drives.times[fit.odometry.poses[0][0][rows]]
    scaled = np.cumsum(fit.odometry.residual[rows], axis=0)
    axes[1, 0].plot(times, scaled[:, 0], color=ORANGE, label="along")
    axes[1, 0].plot(times, scaled[:, 1], color=BLUE, label="across")
    axes[1, 0].set(xlabel="time [s]", ylabel=f"what the wheels miss, in sum [{unit}]")
    axes[1, 1].plot(times, scaled[:, 2], color=VERMILION, label="turn")
    axes[1, 1].set(xlabel="time [s]", ylabel="what the wheels miss, in sum [rad]")
    for axis in axes.flat:
        axis.legend(loc="best", fontsize=7)
    return figure


def ways(calibration: FoundTeam, unit: str) -> Figure:
    """Where the robots drove, by their readings, and the landmarks; those that are seen elsewhere, with an arrow to there."""
    figure = Figure(figsize=(6, 7), layout="constrained")
    axis = figure.subplots()
    for n, name in enumerate(calibration.robots):
        axis.plot(*calibration.fit.poses[:, n, :2].T, lw=0.8, label=name)
    if len(calibration.fit.drives.places):
        axis.plot(*calibration.fit.drives.places.T, "^", color=BLACK, ls="", label="landmarks")
    for landmark in calibration.landmarks:
        axis.annotate("", xy=landmark.seen, xytext=landmark.map, arrowprops={"arrowstyle": "->", "color": VERMILION})
    axis.set(xlabel=f"x [{unit}]", ylabel=f"y [{unit}]", aspect="equal")
    axis.legend(loc="best", fontsize=7)
    return figure
