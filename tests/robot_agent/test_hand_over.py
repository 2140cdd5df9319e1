"""The hand-over between a robot's grid and its Gaussian filter."""

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.gaussian.drawing import draw
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.grid import Grid
from robot_agent.gaussian.hand_over import one_hypothesis

GRID = Grid((40, 40), 0.1, (-2.0, -2.0), "m")


def test_a_grid_with_one_hypothesis_is_handed_over() -> None:
    covariance = np.array([[0.04, 0.01], [0.01, 0.02]])
    belief = draw(GRID, Moments(np.array([0.3, -0.4]), covariance))
    p = 0.99 * belief.p + 0.01 / GRID.size
    moments = one_hypothesis(Belief(GRID, p))
    assert moments is not None
    assert moments.mean == pytest.approx((0.3, -0.4), abs=0.01)
    assert np.allclose(moments.covariance, covariance, atol=0.006)


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_a_grid_with_two_hypotheses_is_not(share: float) -> None:
    here, there = gaussian(GRID, (-1.0, -1.0), 0.2), gaussian(GRID, (1.0, 1.0), 0.2)
    assert one_hypothesis(Belief(GRID, share * here.p + (1 - share) * there.p)) is None
    assert one_hypothesis(uniform(GRID)) is None
