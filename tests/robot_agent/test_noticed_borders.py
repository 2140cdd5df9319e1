"""The position grid at its borders and when it is lost, against exact expectations, on the grid of the pose grid's tests."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from robot_agent.config import RobotSection
from robot_agent.position import PositionLocalizer
from tests.robot_agent.test_noticed_pose import CENTRE, GRID, SETTINGS, drive


def test_a_lost_position_forgets_its_offset_and_pending_noise() -> None:
    begun = PositionLocalizer.unknown(RobotSection(), GRID)
    it = replace(begun, p=gaussian(GRID, CENTRE, 0.4).p, offset=(0.2, -0.2), pending_covariance=(0.01, 0.02, 0.005))
    agreed = gaussian(GRID, (-4.0, 13.0), 0.5)
    after = it.fold(agreed, it.marginal())
    assert after.marginal().p == pytest.approx(agreed.p)
    assert (after.offset, after.pending_covariance) == ((0.0, 0.0), (0.0, 0.0, 0.0))


def test_a_marginal_holds_the_pending_noise() -> None:
    begun = PositionLocalizer.unknown(RobotSection(), GRID)
    it = replace(begun, p=gaussian(GRID, CENTRE, 1.0).p)
    grown = replace(it, pending_covariance=(0.02, 0.01, 0.005)).marginal().covariance() - it.marginal().covariance()
    assert np.diag(grown) == pytest.approx((0.02, 0.01), rel=0.05)
    assert grown[0, 1] == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize(
    ("heading", "axis", "end"), [(0.0, 0, -1), (math.pi, 0, 0), (math.pi / 2, 1, -1), (-math.pi / 2, 1, 0)]
)
def test_what_would_leave_the_grid_stays_in_the_last_row(heading: float, axis: int, end: int) -> None:
    p = np.full(GRID.shape, 1.0 / GRID.size)
    it = replace(PositionLocalizer.unknown(SETTINGS, GRID), p=p)
    after = it.predict(drive(distance=3 * 0.5), heading).p
    rows = after.sum(axis=1 - axis)
    n = GRID.shape[axis]
    assert rows[end] == pytest.approx(4 / n)
    assert rows[:3] == pytest.approx([0.0] * 3 if end else [4 / n, 1 / n, 1 / n])
    assert rows[-3:] == pytest.approx([1 / n, 1 / n, 4 / n] if end else [0.0] * 3)
    far = it.predict(drive(distance=100 * 0.5), heading).p.sum(axis=1 - axis)
    assert far[end] == pytest.approx(1.0)
