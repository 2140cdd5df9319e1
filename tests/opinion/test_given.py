"""Beliefs of what people have: sums, moments, and an error that names what cannot become a belief."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import Belief, Grid
from blackboard.opinion.belief import gaussian, uniform
from blackboard.opinion.grid import Array
from tests.opinion.stacks import few

GRID = Grid((60, 50), 0.5, (-5.0, -3.0), "m")  # from -5 to 25 by -3 to 22
WIDTH = GRID.cell**2 / 12 * np.eye(2)
NAN = float("nan")


def covariance(a: float, b: float, angle: float) -> Array:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(turn @ np.diag([a * a, b * b]) @ turn.T)


middle = st.tuples(st.floats(6, 14), st.floats(6, 12))
sigma = st.floats(0.15, 1.6)
angles = st.floats(-4, 4)


# --- Gaussians ---------------------------------------------------------------------------------------------------------


@few
@given(middle, sigma, sigma, angles)
def test_a_gaussian_has_its_moments_and_those_of_a_cell(
    mean: tuple[float, float], a: float, b: float, angle: float
) -> None:
    c = covariance(a, b, angle)
    belief = Belief.from_gaussian(GRID, mean, c)
    assert math.fsum(belief.p.ravel()) == pytest.approx(1.0, abs=1e-12)
    assert belief.p.min() >= 0
    width = 0.25 * GRID.cell
    narrow = covariance(max(a, width), max(b, width), angle)
    # what is read between cells has the variance of a cell on top, but for what a narrow Gaussian shows of the cells' edges
    assert belief.mean() == pytest.approx(mean, abs=0.03 if min(a, b) < 0.5 else 1e-6)
    assert belief.covariance() == pytest.approx(narrow + WIDTH, abs=0.05 if min(a, b) < 0.5 else 1e-5)


def test_each_cell_holds_the_integral_of_the_density() -> None:
    """Along the axes the integral is known exactly, also where the Gaussian is narrower than a cell."""
    for s in (0.13, 0.3, 2.0):
        belief = Belief.from_gaussian(GRID, (7.1, 8.3), np.diag([s * s, 1.0]))
        edges = GRID.origin[0] + np.arange(61) * GRID.cell
        exact = np.diff([0.5 * math.erfc(-(x - 7.1) / s / math.sqrt(2)) for x in edges])
        assert belief.p.sum(axis=1) == pytest.approx(exact, abs=2e-5)


def test_a_wide_gaussian_along_the_axes_is_the_one_of_the_cell_centres() -> None:
    assert Belief.from_gaussian(GRID, (9, 8), np.diag([9.0, 4.0])).p == pytest.approx(
        gaussian(GRID, (9, 8), (3, 2)).p, abs=1e-4
    )


def test_a_certain_place_is_its_cell_and_far_cells_are_possible_still() -> None:
    belief = Belief.from_gaussian(GRID, (7.25, 8.25), np.zeros((2, 2)))
    assert belief.p[24, 22] > 0.9
    assert Belief.from_gaussian(GRID, (0, 0), np.eye(2)).p.min() > 0


def test_grids_of_one_and_three_axes() -> None:
    line = Belief.from_gaussian(Grid((40,)), (20,), [[9]])
    assert line.mean() == pytest.approx([20])
    room = Belief.from_gaussian(Grid((20, 22, 24)), (10, 11, 12), [[4, 1, 0], [1, 3, 0.5], [0, 0.5, 2]])
    assert room.covariance() == pytest.approx(
        np.array([[4, 1, 0], [1, 3, 0.5], [0, 0.5, 2]]) + np.eye(3) / 12, abs=1e-2
    )


@few
@given(middle, middle, sigma, st.floats(0.1, 10))
def test_a_mixture_is_the_weighted_sum(
    first: tuple[float, float], second: tuple[float, float], s: float, weight: float
) -> None:
    c, d = covariance(s, 1.0, 0.5), np.eye(2)
    mixed = Belief.from_mixture(GRID, [first, second], [c, d], [weight, 1.0])
    parts = [Belief.from_gaussian(GRID, first, c).p, Belief.from_gaussian(GRID, second, d).p]
    assert mixed.p == pytest.approx((weight * parts[0] + parts[1]) / (weight + 1), abs=1e-12)


# --- particles ---------------------------------------------------------------------------------------------------------


@few
@given(st.integers(1, 600), st.integers(0, 9), st.floats(0.5, 2))
def test_particles_have_their_moments_and_the_bandwidth_s(n: int, seed: int, bandwidth: float) -> None:
    chance = np.random.default_rng(seed)
    xy = chance.uniform((5, 5), (12, 11), (n, 2))
    w = chance.uniform(0.1, 1, n)
    belief = Belief.from_particles(GRID, xy, 7 * w, bandwidth)
    mean = w @ xy / w.sum()
    spread = (w[:, None] * (xy - mean)).T @ (xy - mean) / w.sum()
    assert belief.p.sum() == pytest.approx(1.0, abs=1e-12)
    assert belief.mean() == pytest.approx(mean, abs=0.01)
    assert belief.covariance() == pytest.approx(spread + bandwidth**2 * np.eye(2) + WIDTH, abs=0.05)


def test_one_particle_is_a_gaussian_and_one_at_the_border_loses_nothing() -> None:
    single = Belief.from_particles(GRID, [(9.1, 8.2)], bandwidth=(1.5, 0.8))
    assert single.p == pytest.approx(Belief.from_gaussian(GRID, (9.1, 8.2), np.diag([1.5**2, 0.8**2])).p, abs=1e-5)
    corner = Belief.from_particles(GRID, [(-5, -3), (9, 8)], bandwidth=0.5)
    assert corner.p[:10, :10].sum() == pytest.approx(0.5)


def test_without_a_bandwidth_more_particles_are_spread_less() -> None:
    chance = np.random.default_rng(1)
    few_of_them, many = (Belief.from_particles(GRID, chance.normal((10, 8), 2.0, (n, 2))) for n in (30, 3000))
    assert np.linalg.det(few_of_them.covariance()) > 4
    assert many.covariance() == pytest.approx(4 * np.eye(2), abs=0.6)
    assert Belief.from_particles(Grid((9, 9, 9)), chance.normal(4.5, 0.5, (500, 3))).mean() == pytest.approx(
        3 * [4.5], abs=0.1
    )


# --- range and bearing -------------------------------------------------------------------------------------------------


@few
@given(st.floats(3, 9), st.floats(-3, 3), st.floats(-3, 3))
def test_a_range_and_a_bearing_point_at_a_place(distance: float, heading: float, bearing: float) -> None:
    belief = Belief.from_range_bearing(
        GRID, (10, 9.5), heading, distance=distance, bearing=bearing, distance_sigma=0.3, bearing_sigma=0.03
    )
    toward = (10 + distance * math.cos(heading + bearing), 9.5 + distance * math.sin(heading + bearing))
    assert belief.p.sum() == pytest.approx(1.0, abs=1e-12)
    assert belief.mean() == pytest.approx(toward, abs=0.1)
    assert np.trace(belief.covariance()) == pytest.approx(0.3**2 + (0.03 * distance) ** 2 + np.trace(WIDTH), abs=0.06)


def test_a_range_alone_is_a_ring_and_a_bearing_alone_a_ray() -> None:
    ring = Belief.from_range_bearing(GRID, (10, 9.5), 1.0, distance=6, distance_sigma=0.4)
    x, y = GRID.mesh()
    far = np.hypot(x - 10, y - 9.5)
    assert ring.mean() == pytest.approx((10, 9.5), abs=0.05)
    assert float((ring.p * far).sum()) == pytest.approx(6.0, abs=0.1)
    ray = Belief.from_range_bearing(GRID, (10, 9.5), 1.0, bearing=0.5, bearing_sigma=0.05)
    angle = np.arctan2(y - 9.5, x - 10)
    assert float(ray.p[np.abs(angle - 1.5) < 0.3].sum()) > 0.95
    assert ray.mean()[1] > 14


def test_an_uncertain_observer_sees_less_sharply() -> None:
    arguments: dict[str, Any] = {"distance": 6, "bearing": 0, "distance_sigma": 0.3, "bearing_sigma": 0.05}
    sharp = Belief.from_range_bearing(GRID, (10, 9.5), 0.3, **arguments)
    heading = Belief.from_range_bearing(GRID, (10, 9.5), 0.3, **arguments, heading_sigma=0.2)
    position = Belief.from_range_bearing(GRID, (10, 9.5), 0.3, **arguments, position_sigma=1.0)
    areas = [float(np.linalg.det(b.covariance())) for b in (sharp, heading, position)]
    assert areas[0] < min(areas[1:])
    assert position.covariance() == pytest.approx(sharp.covariance() + np.eye(2), abs=0.2)


# --- occupancy, and other grids ----------------------------------------------------------------------------------------


def test_occupancy_is_mass_and_what_is_not_known_is_between() -> None:
    grid = Grid((3, 1))
    assert Belief.from_occupancy(grid, [[0], [100], [-1]]).p.ravel() == pytest.approx([0, 2 / 3, 1 / 3])
    assert Belief.from_occupancy(grid, [[0], [100], [-1]], free=True).p.ravel() == pytest.approx([2 / 3, 0, 1 / 3])
    finer = Belief.from_occupancy(
        grid, np.array([[0, 0, 100, 100, 0, 0]]).T, source=Grid((6, 1), 0.5, (0, 0)), unknown=0
    )
    assert finer.p.ravel() == pytest.approx([0, 1, 0])


@few
@given(middle, st.floats(0.2, 1.5), st.floats(-1, 1))
def test_another_grid_keeps_mass_mean_and_spread(mean: tuple[float, float], cell: float, origin: float) -> None:
    belief = Belief.from_gaussian(GRID, mean, covariance(1.5, 0.8, 0.4))
    other = Grid((int(34 / cell) + 2, int(30 / cell) + 2), cell, (-6 + origin, -5 + origin), "m")
    there = belief.resampled(other)
    assert there.p.sum() == pytest.approx(1.0, abs=1e-12)
    assert there.mean() == pytest.approx(belief.mean(), abs=0.02 * cell)
    assert there.covariance() == pytest.approx(belief.covariance(), abs=0.3 * cell**2 + 0.1)
    assert there.resampled(GRID, lost=0.05).mean() == pytest.approx(belief.mean(), abs=0.02)


def test_the_same_grid_again_changes_nothing() -> None:
    belief = Belief.from_gaussian(GRID, (9, 8), np.eye(2))
    assert belief.resampled(Grid(GRID.shape, GRID.cell, GRID.origin, "m", "map")).p == pytest.approx(
        belief.p, abs=1e-15
    )


# --- near and behind walls ---------------------------------------------------------------------------------------------


def test_what_errors_lead_across_the_border_is_a_belief() -> None:
    beyond = Belief.from_gaussian(GRID, (26, 3), np.eye(2))
    assert beyond.mean()[0] > 24
    mixed = Belief.from_mixture(GRID, [(26, 3), (3, 3)], [np.eye(2), np.eye(2)])
    assert mixed.p.sum() == pytest.approx(1)
    here = Belief.from_range_bearing(GRID, (25.5, 3), 0, distance=1, bearing=3.14, distance_sigma=1, position_sigma=0.5)
    assert 23 < here.mean()[0] < 25
    some = Belief.from_particles(GRID, [(3, 3), (3, 99)], weights=[1, 3], bandwidth=1)
    assert some.mean() == pytest.approx((3, 3), abs=0.1)


@pytest.mark.parametrize("bearing", [0.0, None])
def test_what_is_seen_outside_the_grid_tells_nothing_of_a_place_on_it(bearing: float | None) -> None:
    belief = Belief.from_range_bearing(GRID, (3, 3), 0, distance=99, bearing=bearing, distance_sigma=1)
    assert np.ptp(belief.p) == 0


# --- what is no belief -------------------------------------------------------------------------------------------------


B, ONE = Belief, np.eye(2)
WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: B.from_gaussian(GRID, (36, 3), ONE), r"mean \(36, 3\) is outside the grid, which is -5 to 25 by -3 to 22"),
    (lambda: B.from_gaussian(GRID, (NAN, 3), ONE), r"mean \(nan, 3\) is outside"),
    (lambda: B.from_gaussian(GRID, (3,), ONE), "mean of shape"),
    (lambda: B.from_gaussian(GRID, (3, 3), np.eye(3)), r"covariance of shape \(3, 3\)"),
    (lambda: B.from_gaussian(GRID, (3, 3), [[1, 0.5], [0.2, 1]]), r"not symmetric: \(0, 1\) is 0.5, \(1, 0\) is 0.2"),
    (lambda: B.from_gaussian(GRID, (3, 3), [[1, 2], [2, 1]]), "negative eigenvalue -1"),
    (lambda: B.from_gaussian(GRID, (3, 3), [[1, 0], [0, NAN]]), r"entry \(1, 1\) is nan"),
    (lambda: B.from_mixture(GRID, [(3, 3)], []), "1 means and 0 covariances"),
    (lambda: B.from_mixture(GRID, [(3, 3), (99, 3)], [ONE, ONE]), r"mean 1 \(99, 3\) is outside"),
    (lambda: B.from_mixture(GRID, [(3, 3)], [-ONE]), "covariance 0 has the negative eigenvalue -1"),
    (lambda: B.from_mixture(GRID, [(3, 3)], [ONE], [0]), "all weights are 0"),
    (lambda: B.from_particles(GRID, [(3, 3), (3, NAN)]), r"particle 1 at \(3, nan\) is outside"),
    (lambda: B.from_particles(GRID, [(3, 99), (3, 98)]), r"particle 0 at \(3, 99\)"),
    (lambda: B.from_particles(GRID, [3, 3]), "particles of shape"),
    (lambda: B.from_particles(GRID, np.zeros((0, 2))), "particles of shape"),
    (lambda: B.from_particles(GRID, [(3, 3), (4, 4)], [1, -1]), "weight 1 is -1"),
    (lambda: B.from_particles(GRID, [(3, 3), (4, 4)], [1]), "weights of shape"),
    (lambda: B.from_particles(GRID, [(3, 3)], bandwidth=0), "bandwidth 0 must be positive"),
    (lambda: B.from_range_bearing(GRID, (99, 3), 0, distance=1, distance_sigma=1), r"position \(99, 3\)"),
    (lambda: B.from_range_bearing(GRID, (3, 3), NAN, distance=1), "heading nan"),
    (lambda: B.from_range_bearing(GRID, (3, 3), 0, distance=-1), "distance -1"),
    (lambda: B.from_range_bearing(GRID, (3, 3), 0, distance=1, distance_sigma=-1), "distance_sigma -1"),
    (lambda: B.from_range_bearing(GRID, (3, 3), 0), "neither distance nor bearing"),
    (lambda: B.from_range_bearing(Grid((9,)), (3,), 0, distance=1), "a grid of 1 axes"),
    (lambda: B.from_occupancy(Grid((2, 1)), [[0], [101]]), r"cell \(1, 0\) holds 101"),
    (lambda: B.from_occupancy(Grid((2, 1)), [[0], [NAN]]), r"cell \(1, 0\) holds nan"),
    (lambda: B.from_occupancy(Grid((2, 1)), [0, 0]), "values of shape"),
    (lambda: B.from_occupancy(Grid((2, 1)), [[0], [0]]), "no cell holds any mass"),
    (lambda: uniform(GRID).resampled(Grid((60, 25), 0.5, (-5, -3), "m")), "50.0% of the mass is outside the grid"),
    (lambda: uniform(GRID).resampled(Grid((60, 50))), "in m to 2 in cell"),
    (lambda: uniform(Grid((3,), frame="a")).resampled(Grid((3,), frame="b")), "from frame 'a' to 'b'"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "names"), WRONG, ids=[names for _, names in WRONG])
def test_what_cannot_become_a_belief_is_named(make: Callable[[], object], names: str) -> None:
    with pytest.raises(ValueError, match=names):
        make()
