"""The position grid against brute force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import Localizer
from robot_agent.position import PositionLocalizer
from robot_agent.sensing import Motion, position_likelihood, uncertain_likelihood

GRID = Grid((24, 18))
SETTINGS = RobotSection.model_validate({"vision": {"outlier": 0.0}})


def standing(p: Belief, **more: object) -> PositionLocalizer:
    return replace(PositionLocalizer.unknown(SETTINGS, GRID), p=p.p, **more)  # type: ignore[arg-type]


def step(distance: float, along: float = 0.0) -> Motion:
    return Motion(distance, 0.0, 1.0, along, 0.0, 0.0)


def test_projection_is_the_sum_over_all_own_places_and_all_places_of_the_subject() -> None:
    it = standing(gaussian(GRID, (9, 8), 1.5), heading=0.4, offset=(0.3, -0.2))
    sighting = Sighting(subject="object/ball", range=6.0, bearing=0.2)
    angle = 0.4 + 0.2
    seen = 6.0 * math.cos(angle), 6.0 * math.sin(angle)
    expected = np.zeros(GRID.shape)
    gx, gy = GRID.mesh()
    for i in range(GRID.shape[0]):
        for j in range(GRID.shape[1]):
            dx, dy = gx - (GRID.centres(0)[i] + 0.3), gy - (GRID.centres(1)[j] - 0.2)
            expected += it.p[i, j] * position_likelihood(dx, dy, seen, SETTINGS.vision)
    assert np.allclose(it.project(sighting, None).p, expected / expected.sum(), atol=1e-12)


def test_motion_moves_the_mean_and_does_not_blur() -> None:
    it: Localizer = standing(gaussian(GRID, (6, 8), 1.0))
    before = it.marginal().covariance()
    for _ in range(20):
        it = it.predict(step(0.37), 0.0)
    after = it.marginal()
    assert after.mean()[0] == pytest.approx(6 + 20 * 0.37, abs=0.02)
    assert after.covariance()[0, 0] - before[0, 0] <= 0.26  # of the one resampling into the team's grid


def test_odometry_noise_adds_its_variance() -> None:
    it: Localizer = standing(gaussian(GRID, (12, 9), 1.0))
    before = it.marginal().covariance()
    for _ in range(10):
        it = it.predict(step(0.0, along=0.2), 0.0)
    spread = it.marginal().covariance() - before
    assert spread[0, 0] == pytest.approx(2.0, rel=0.1)
    assert spread[1, 1] == pytest.approx(0.0, abs=0.02)


def test_a_fix_is_the_product_with_a_gaussian() -> None:
    it = standing(gaussian(GRID, (10, 8), 2.0)).update_with_fix(Fix(position=(12.0, 8.0), sigma=2.0))
    assert it.marginal().mean() == pytest.approx((11.0, 8.0), abs=0.05)


def test_folding_what_was_reported_changes_nothing() -> None:
    it = standing(gaussian(GRID, (10, 8), 2.0), offset=(0.2, 0.4))
    reported = it.marginal()
    assert np.array_equal(it.fold(reported, reported).p, it.p / it.p.sum())


def test_folding_takes_the_agreed_position_over() -> None:
    it = standing(gaussian(GRID, (10, 8), 2.0))
    agreed = gaussian(GRID, (12, 9), 1.0)
    assert np.abs(it.fold(agreed, it.marginal()).p - agreed.p).sum() < 1e-3


def test_a_lost_robot_starts_again_where_the_team_says() -> None:
    it = standing(gaussian(GRID, (3, 3), 0.6))
    agreed = gaussian(GRID, (20, 15), 0.8)
    assert np.allclose(it.fold(agreed, it.marginal()).p, agreed.p)


def test_an_uncertain_mate_counts_as_the_mean_over_all_places_where_it_may_be() -> None:
    """Where sigma hardly depends on the distance, the likelihood is the exact marginal."""
    vision = SETTINGS.vision.model_copy(update={"floor": 1.5, "gain": 1e-6})
    covariance = np.array([[1.2, 0.5], [0.5, 0.8]])
    dx, dy = np.array([[5.0, 6.0, 7.5]]), np.array([[1.0, -0.5, 2.0]])
    seen = 6.2, 0.4
    rng = np.random.default_rng(1)
    shifts = rng.multivariate_normal((0, 0), covariance, 200_000)
    expected = [
        position_likelihood(x + shifts[:, 0], y + shifts[:, 1], seen, vision).mean()
        for x, y in zip(dx[0], dy[0], strict=True)
    ]
    assert uncertain_likelihood(dx, dy, seen, covariance, vision)[0] == pytest.approx(np.array(expected), rel=0.02)
    nearly = uncertain_likelihood(dx, dy, seen, 1e-12 * covariance, SETTINGS.vision)
    assert nearly == pytest.approx(position_likelihood(dx, dy, seen, SETTINGS.vision), rel=1e-9)


def test_a_robot_that_sees_a_mate_of_known_place_finds_itself() -> None:
    it = standing(gaussian(GRID, (9, 9), 3.0), heading=0.0)
    mate, covariance = np.array([15.0, 10.0]), np.eye(2) * 0.3
    after = it.update_with_sighting(
        Sighting(subject="robot/r2", range=7.5, bearing=0.0), None, mate, covariance
    ).marginal()
    assert after.mean() == pytest.approx((7.5, 10.0), abs=0.4)
    assert np.trace(after.covariance()) < 2.0
