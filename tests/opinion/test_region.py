"""What is read out of a belief: its mode, its highest-density regions as cells and polygons, samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard import Belief, Grid
from blackboard.opinion.belief import uniform
from blackboard.opinion.grid import Array
from tests.opinion.stacks import few, stacks

GRID = Grid((40, 30), 0.5, (-2.0, 1.0), "m")


def area(ring: Array) -> float:
    """Signed: positive counter-clockwise (the shoelace formula)."""
    x, y = ring[:, 0], ring[:, 1]
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2)


def test_the_mode_is_the_centre_of_the_likeliest_cell() -> None:
    p = np.zeros(GRID.shape)
    p[3, 4], p[5, 6] = 0.4, 0.6
    assert Belief(GRID, p).mode() == pytest.approx(GRID.centre((5, 6)))


@few
@given(stacks(("random",), most=1), st.floats(0.05, 1.0))
def test_a_region_is_the_smallest_that_holds_so_much(opinions: Array, share: float) -> None:
    p = opinions[0].reshape(len(opinions[0]), -1)
    inside = Belief(Grid(p.shape), p).region(share)
    assert p[inside].sum() >= share - 1e-9
    assert p[inside].min() >= p[~inside].max(initial=0.0)
    least = p[inside].min()
    assert p[p > least].sum() < share


def test_an_even_belief_s_region_is_everything_and_a_share_is_above_0_and_at_most_1() -> None:
    assert uniform(GRID).region(0.5).all()
    for share in (0.0, 1.1, float("nan")):
        with pytest.raises(ValueError, match="^region: share"):
            uniform(GRID).region(share)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_polygons_enclose_the_cells_and_nothing_else(seed: int, share: float) -> None:
    """Rings around cells less those around holes have the region's area, and every ring is closed and turns at each point."""
    belief = Belief(GRID, np.random.default_rng(seed).dirichlet(np.full(GRID.size, 0.3)).reshape(GRID.shape))
    rings = belief.polygons(share)
    assert sum(area(ring) for ring in rings) == pytest.approx(belief.region(share).sum() * GRID.volume)
    for ring in rings:
        assert tuple(ring[0]) == tuple(ring[-1])
        steps = np.diff(ring, axis=0)
        assert ((steps != 0).sum(axis=1) == 1).all()
        assert ((steps[:-1] != 0) != (steps[1:] != 0)).all()


def test_a_square_with_a_hole_has_two_rings_and_corners_do_not_join() -> None:
    p = np.zeros((7, 7))
    p[1:4, 1:4] = 1.0
    p[2, 2] = 0.0
    p[4, 4] = 1.0  # touches the square in a corner
    belief = Belief(Grid((7, 7)), p / p.sum())
    assert sorted(area(ring) for ring in belief.polygons(1.0)) == [-1.0, 1.0, 9.0]
    with pytest.raises(ValueError, match="^polygons: a grid of 1 axes"):
        uniform(Grid((4,))).polygons()


def test_samples_come_from_where_the_mass_is() -> None:
    belief = Belief.from_gaussian(GRID, (8, 8), [[2, 0.8], [0.8, 1]])
    drawn = belief.samples(20_000, np.random.default_rng(1))
    assert drawn.mean(axis=0) == pytest.approx(belief.mean(), abs=0.05)
    assert np.cov(drawn.T) == pytest.approx(belief.covariance() + np.eye(2) * GRID.cell**2 / 12, abs=0.08)
    back = Belief.from_particles(GRID, drawn, bandwidth=0.2)
    assert 0.5 * np.abs(back.p - belief.p).sum() < 0.1
