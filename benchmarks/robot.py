"""What does a step of a robot's filter on a grid cost? `python benchmarks/robot.py`

A step is a motion, a sighting of a known place, and the belief that is reported. Beside it stands FilterPy's `discrete_bayes`
(R. Labbe) on the same grid: `predict` by one cell with a kernel of the same noise, out to 3 sigma, and `update` with the likelihood
of the same sighting. FilterPy is no dependency of this package: without it (`pip install filterpy`) these rows are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from ratios import Row, milliseconds, show

from blackboard import Grid
from blackboard.config import load
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Fix, Odometry, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizers import localizer_factory
from robot_agent.sensing import motion

try:
    from filterpy import discrete_bayes  # type: ignore[import-not-found,import-untyped,unused-ignore]
except ImportError:
    discrete_bayes = None

SIGMA = 0.8  # cells, of the noise of a motion by one cell
RANGE = 8.0  # unit, to what is sighted
STEPS = 20  # of a course on the pose grid


def rows() -> Iterator[Row]:
    for cells in (50, 100, 200):
        yield from position(cells)
    for cell, degrees, most in ((0.1, 4, 50.0), (0.05, 2, 1000.0)):
        yield Row(
            f"a step on the pose grid of the recorded arena, {cell:g} m and {degrees} degrees, one sighting each",
            pose(cell, degrees), "ms", most=most,
        )  # fmt: skip


def position(cells: int) -> Iterator[Row]:
    """Ours, and FilterPy's, on `cells` x `cells` cells of 1 unit, about a belief of sigma 3 in the middle."""
    grid, middle = Grid((cells, cells)), cells / 2
    settings = RobotSection.model_validate(
        {"localizer": "position", "vision": {"gain": 0.05}, "odometry": {"along": SIGMA, "across": SIGMA}}
    )
    moved = motion(Odometry(distance=1.0, turn=0.0, dt=1.0), settings.odometry)
    sighting, place = Sighting(subject="landmark/1", range=RANGE, bearing=0.0), np.array([middle + RANGE + 1, middle])
    known = localizer_factory("position")(settings, grid).update_with_fix(Fix(position=(middle, middle), sigma=3.0))

    def ours() -> object:
        step = known.predict(moved, 0.0)
        return step.update_with_sighting(sighting, moved, place, np.zeros((2, 2))).marginal()

    calls: list[Callable[[], object]] = [ours]
    if discrete_bayes is not None:
        calls.append(_filterpy(grid, (middle, middle), place, settings))
    mine, *others = milliseconds(*calls)
    about = f"{cells} x {cells}"
    yield Row(f"a step on the grid of positions, {about}", mine, "ms")
    for other in others:
        yield Row(f"FilterPy's discrete_bayes / that, {about}", other / mine, least=5.0 if cells == 200 else None)


def _filterpy(grid: Grid, middle: tuple[float, float], place: Array, settings: RobotSection) -> Callable[[], object]:
    prior, (x, y) = gaussian(grid, middle, 3.0).p, grid.mesh()
    reach = np.arange(-math.ceil(3 * SIGMA), math.ceil(3 * SIGMA) + 1)
    bell = np.exp(-0.5 * (reach / SIGMA) ** 2)
    kernel = np.outer(bell, bell) / bell.sum() ** 2
    variance = (settings.vision.gain * RANGE + settings.vision.floor) ** 2

    def theirs() -> object:
        moved = discrete_bayes.predict(prior, (1, 0), kernel)
        away = (place[0] - RANGE - x) ** 2 + (place[1] - y) ** 2
        return discrete_bayes.update(np.exp(-0.5 * away / variance), moved)

    return theirs


def pose(cell: float, degrees: int) -> float:
    """Milliseconds of a step, the mean over a course of `STEPS` seconds of a robot that knows about where it is."""
    scenario = load("mrclam").changed("grid", cell=cell, shape=[round(7 / cell), round(12 / cell)])
    scenario = scenario.changed("robot", headings=360 // degrees)
    settings = scenario.section("robot", RobotSection)
    begun = localizer_factory("pose")(settings, scenario.grid)
    begun = begun.update_with_fix(Fix(position=(2.0, 0.0), sigma=0.1, heading=0.0))
    moved = motion(Odometry(distance=0.1, turn=0.05, dt=1.0), settings.odometry)
    sighting = Sighting(subject="landmark/6", range=2.0, bearing=0.3)

    def course() -> object:
        it, found = begun, None
        for step in range(STEPS):
            angle = 0.05 * (step + 1)
            it = it.predict(moved, None)
            place = np.array([2.0 + 2 * math.sin(angle), 2 - 2 * math.cos(angle)])  # of a circle of 2 m, about
            place += 2.0 * np.array([math.cos(angle + 0.3), math.sin(angle + 0.3)])
            it = it.update_with_sighting(sighting, moved, place, np.zeros((2, 2)))
            found = it.marginal()
        return found

    return milliseconds(course, rounds=5)[0] / STEPS


if __name__ == "__main__":
    show(rows())
