"""What does a step of a robot's filter on a grid cost? `python benchmarks/robot.py`

A step is a motion, a sighting of a known place, and the belief that is reported. Beside it stands FilterPy's `discrete_bayes`
(R. Labbe) on the same grid: `predict` by one cell with a kernel of the same noise, out to 3 sigma, and `update` with a likelihood
about as wide as that of the sighting, a round Gaussian, which costs less than ours. Both beliefs must end within a cell of each other.

`discrete_bayes` is made for one axis: `update` divides by Python's own `sum`, which on two axes adds up rows, so that every column
becomes a belief of its own, or nan where all of it is 0; and `predict` rolls the cells in the order of memory. So the grid goes
through it as one row. That `sum` is most of the cost on a large grid, so a second row has NumPy's in its place. FilterPy is no
dependency of this package: without it (`pip install filterpy`) these rows are left out.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from ratios import Measured, milliseconds, show

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


def rows() -> Iterator[Measured]:
    for cells in (50, 100, 200):
        yield from position(cells)
    for cell, degrees, most in ((0.1, 4, 50.0), (0.05, 2, 1000.0)):
        yield Measured(
            f"a step on the pose grid of the recorded arena, {cell:g} m and {degrees} degrees, one sighting each",
            pose(cell, degrees), "ms", most=most,
        )  # fmt: skip


def position(cells: int) -> Iterator[Measured]:
    """Ours, and FilterPy's, on `cells` x `cells` cells of 1 unit, about a belief of sigma 3 in the middle."""
    grid, middle = Grid((cells, cells)), cells / 2
    settings = RobotSection.model_validate(
        {"localizer": "position", "vision": {"gain": 0.05}, "odometry": {"along": SIGMA, "across": SIGMA}}
    )
    moved = motion(Odometry(distance=1.0, turn=0.0, dt=1.0), settings.odometry)
    sighting, place = Sighting(subject="landmark/1", range=RANGE, bearing=0.0), np.array([middle + RANGE + 1, middle])
    known = localizer_factory("position")(settings, grid).update_with_fix(Fix(position=(middle, middle), sigma=3.0))

    def ours() -> Array:
        step = known.predict(moved, 0.0)
        return np.asarray(step.update_with_sighting(sighting, moved, place, np.zeros((2, 2))).marginal().p)

    calls = [ours]
    if discrete_bayes is not None:
        calls += _filterpy(grid, (middle, middle), place, settings)
    for call in calls[1:]:
        _check_alike(grid, ours(), call())
    mine, *others = milliseconds(*calls)
    names = ("FilterPy's discrete_bayes / that", "the same with NumPy's sum / that")
    about = f"{cells} x {cells}"
    yield Measured(f"a step on the grid of positions, {about}", mine, "ms")
    for name, other in zip(names, others, strict=False):
        yield Measured(f"{name}, {about}", other / mine, least=5.0 if cells == 200 else None)


def _filterpy(
    grid: Grid, middle: tuple[float, float], place: Array, settings: RobotSection
) -> list[Callable[[], Array]]:
    """A step of FilterPy's as it is, and one that divides by NumPy's sum."""
    prior, (x, y) = gaussian(grid, middle, 3.0).p, grid.mesh()
    reach = np.arange(-math.ceil(3 * SIGMA), math.ceil(3 * SIGMA) + 1)
    bell = np.exp(-0.5 * (reach / SIGMA) ** 2)
    kernel = np.outer(bell, bell) / bell.sum() ** 2
    variance = (settings.vision.gain * RANGE + settings.vision.floor) ** 2

    def predicted() -> Array:
        a_row_on = grid.shape[1]  # one cell along x, in the order of memory
        return np.asarray(discrete_bayes.predict(prior, a_row_on, kernel))

    def likelihood() -> Array:
        away = (place[0] - RANGE - x) ** 2 + (place[1] - y) ** 2
        return np.asarray(np.exp(-0.5 * away / variance))

    def as_it_is() -> Array:
        return np.asarray(discrete_bayes.update(likelihood().ravel(), predicted().ravel())).reshape(grid.shape)

    def with_numpy() -> Array:
        p = likelihood() * predicted()
        return np.asarray(p / p.sum())

    return [as_it_is, with_numpy]


def _check_alike(grid: Grid, first: Array, second: Array) -> None:
    """RuntimeError where one of them is no belief, or they are not about the same place."""
    means = [[float((p * axis).sum()) for axis in grid.mesh()] for p in (first, second)]
    if not (math.isclose(second.sum(), 1.0) and math.dist(*means) < grid.cell):
        raise RuntimeError(f"FilterPy's result sums to {second.sum():g} around {means[1]}, ours is around {means[0]}")


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
        localizer, belief = begun, None
        for step in range(STEPS):
            angle = 0.05 * (step + 1)
            localizer = localizer.predict(moved, None)
            place = np.array([2.0 + 2 * math.sin(angle), 2 - 2 * math.cos(angle)])  # of a circle of 2 m, about
            place += 2.0 * np.array([math.cos(angle + 0.3), math.sin(angle + 0.3)])
            localizer = localizer.update_with_sighting(sighting, moved, place, np.zeros((2, 2)))
            belief = localizer.marginal()
        return belief

    return milliseconds(course, rounds=5)[0] / STEPS


if __name__ == "__main__":
    show(rows())
