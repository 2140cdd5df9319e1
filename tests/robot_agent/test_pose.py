"""The pose grid: against brute force where that is possible, and its laws of motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import Localizer
from robot_agent.pose import COMPASS_SIGMA, PoseLocalizer
from robot_agent.sensing import Motion

GRID = Grid((40, 36), 0.1, (-2.0, -1.8), "m")
SETTINGS = RobotSection.model_validate(
    {"localizer": "pose", "headings": 60, "vision": {"kind": "range-bearing", "outlier": 0.0, "frames": 1.0}}
)


def at(x: float, y: float, heading: float, sigma: float = 0.15, heading_sigma: float = 0.1) -> PoseLocalizer:
    fix = Fix(position=(x, y), sigma=sigma, heading=heading, heading_sigma=heading_sigma)
    return PoseLocalizer.unknown(SETTINGS, GRID).update_with_fix(fix)


def step(distance: float, turn: float = 0.0, heading: float = 0.0) -> Motion:
    return Motion(distance, turn, 1.0, 0.0, 0.0, heading)


def mean_heading(it: PoseLocalizer) -> float:
    return float(np.angle((it.poses.masses * np.exp(1j * it.poses.headings)).sum()))


def test_a_straight_way_moves_the_mean_and_does_not_blur() -> None:
    it: Localizer = at(-1.0, 0.0, 0.0, heading_sigma=0.01)
    before = it.marginal().covariance()
    for _ in range(30):
        it = it.predict(step(0.043), None)
    after = it.marginal()
    assert after.mean() == pytest.approx((-1.0 + 30 * 0.043, 0.0), abs=0.02)
    assert after.covariance()[0, 0] - before[0, 0] < 0.003  # a quarter of cell ** 2, from one resampling


def test_turning_rolls_the_heading_and_carries_the_remainder() -> None:
    it: Localizer = at(0.0, 0.0, 0.5)
    for _ in range(17):
        it = it.predict(step(0.0, turn=0.09), None)
    assert isinstance(it, PoseLocalizer)
    assert mean_heading(it) == pytest.approx(0.5 + 17 * 0.09, abs=0.01)


def test_heading_noise_adds_its_variance_and_loses_no_mass() -> None:
    it: Localizer = at(0.0, 0.0, 0.0, heading_sigma=0.05)
    assert isinstance(it, PoseLocalizer)
    before = float((it.poses.masses * np.angle(np.exp(1j * it.poses.headings)) ** 2).sum())
    for _ in range(10):
        it = it.predict(step(0.0, heading=0.01), None)
    assert isinstance(it, PoseLocalizer)
    assert it.poses.masses.sum() == pytest.approx(1.0, abs=1e-3)
    after = float((it.poses.masses * np.angle(np.exp(1j * it.poses.headings)) ** 2).sum())
    assert after - before == pytest.approx(0.1, rel=0.1)


def test_heading_doubt_bends_the_position_as_it_should() -> None:
    """After a straight way of 1.5 m with a heading of sigma 0.1, the position is spread sideways by 0.15 m."""
    it: Localizer = at(-1.2, 0.0, 0.0, sigma=0.1, heading_sigma=0.1)
    for _ in range(30):
        it = it.predict(step(0.05), None)
    sideways = it.marginal().covariance()[1, 1]
    assert sideways == pytest.approx(0.1**2 + 0.15**2 + 0.1**2 / 12, rel=0.25)


def test_a_landmark_weighs_every_pose_by_range_and_bearing() -> None:
    it = at(0.0, 0.0, 0.3)
    it = replace(it, poses=replace(it.poses, offsets=np.full((60, 2), 0.02)))
    p = it.poses.p
    place, sighting = (1.2, 0.7), Sighting(subject="landmark/1", range=1.3, bearing=0.2)
    vision, cell = SETTINGS.vision, GRID.cell
    expected = np.zeros_like(p, dtype=float)
    likelihoods = np.zeros_like(expected)
    for i, heading in enumerate(it.poses.headings):
        for a, x in enumerate(GRID.centres(0) + 0.02):
            for b, y in enumerate(GRID.centres(1) + 0.02):
                distance = math.hypot(place[0] - x, place[1] - y)
                off = math.remainder(math.atan2(place[1] - y, place[0] - x) - heading - 0.2, 2 * math.pi)
                radial = vision.range_floor**2 + (vision.range_share * 1.3) ** 2 + cell**2 / 12
                angular = vision.bearing**2 + it.poses.bin**2 / 12 + cell**2 / 12 / distance**2
                squared = (1.3 - distance) ** 2 / radial + off**2 / angular
                likelihoods[i, a, b] = math.exp(-0.5 * squared) / math.sqrt(radial * angular)
    expected = p * (likelihoods + math.exp(-vision.misread) * likelihoods[p > 1e-6].max())
    seen = it.update_with_sighting(sighting, None, np.array(place), np.zeros((2, 2)))
    assert np.abs(seen.poses.p - expected / expected.sum()).sum() < 0.02


def test_a_misread_barcode_does_little_harm() -> None:
    it = at(0.0, 0.0, 0.0, sigma=0.1, heading_sigma=0.05)
    wrong = Sighting(subject="landmark/1", range=1.0, bearing=3.0)
    after = it.update_with_sighting(wrong, None, np.array((1.5, 0.0)), np.zeros((2, 2)))
    assert np.abs(after.marginal().mean() - it.marginal().mean()).max() < 0.1


def test_projection_moves_every_slice_along_its_line_of_sight() -> None:
    it = at(-0.5, -0.4, 0.2)
    sighting = Sighting(subject="robot/r2", range=1.0, bearing=0.4)
    rng = np.random.default_rng(1)  # the oracle: many poses drawn from the grid, each with a drawn reading
    flat = it.poses.p.ravel().astype(float)
    i, a, b = np.unravel_index(rng.choice(flat.size, 200_000, p=flat / flat.sum()), it.poses.p.shape)
    vision = SETTINGS.vision
    r = 1.0 + rng.normal(0, math.hypot(vision.range_floor, vision.range_share), len(i))
    angle = it.poses.headings[i] + 0.4 + rng.normal(0, math.sqrt(vision.bearing**2 + it.poses.bin**2 / 12), len(i))
    points = np.stack([GRID.centres(0)[a] + r * np.cos(angle), GRID.centres(1)[b] + r * np.sin(angle)])
    seen = it.project(sighting, None)
    assert seen.mean() == pytest.approx(points.mean(axis=1), abs=0.01)
    assert seen.covariance() == pytest.approx(np.cov(points), rel=0.1, abs=0.002)


def test_a_sighting_of_long_ago_is_taken_from_where_the_robot_was() -> None:
    it = at(0.0, 0.0, 0.0, sigma=0.1, heading_sigma=0.05)
    moved = Motion(0.2, 0.3, 1.0, 0.0, 0.0, 0.0)  # it has driven 0.2 m and turned by 0.3 in the last second
    old = it.project(Sighting(subject="object/ball", range=1.0, bearing=0.0, age=1.0), moved)
    place = np.array([math.cos(-0.3) - 0.2, math.sin(-0.3)])
    assert old.mean() == pytest.approx(place, abs=0.05)


def test_folding_what_was_reported_changes_nothing() -> None:
    it = at(0.3, 0.2, 1.0)
    reported = it.marginal()
    assert it.fold(reported, reported) is it


def test_folding_keeps_heading_given_position() -> None:
    """Far ahead means heading straight on, far left heading left: a new position brings its heading with it."""
    it: Localizer = at(-1.0, 0.0, 0.0, sigma=0.08, heading_sigma=0.2)
    for _ in range(20):
        it = it.predict(step(0.06), None)
    reported = it.marginal()
    left = gaussian(GRID, (0.15, 0.25), 0.1)
    after = it.fold(left, reported)
    assert isinstance(after, PoseLocalizer)
    assert mean_heading(after) > 0.12
    assert after.marginal().mean() == pytest.approx((0.15, 0.25), abs=0.06)


def test_a_lost_robot_starts_again_where_the_team_says_and_keeps_its_heading() -> None:
    it = at(-1.5, -1.3, 0.7, sigma=0.05)
    agreed = gaussian(GRID, (1.2, 1.0), 0.1)
    after = it.fold(agreed, it.marginal())
    assert after.marginal().mean() == pytest.approx((1.2, 1.0), abs=0.03)
    assert mean_heading(after) == pytest.approx(mean_heading(it), abs=0.01)


def test_a_compass_is_as_wide_as_its_noise_and_a_bin() -> None:
    """From an unknown heading: the variance of Gaussian noise and of a uniform place within the bin."""
    it = PoseLocalizer.unknown(SETTINGS.model_copy(update={"headings": 360}), GRID)
    after = it.predict(Motion(0.0, 0.0, 1.0, 0.0, 0.0, 0.0), 1.0)
    assert isinstance(after, PoseLocalizer)
    off = np.angle(np.exp(1j * (after.poses.headings - 1.0)))
    assert float((after.poses.masses * off).sum()) == pytest.approx(0.0, abs=1e-3)
    assert float((after.poses.masses * off**2).sum()) == pytest.approx(
        COMPASS_SIGMA**2 + after.poses.bin**2 / 12, rel=0.005
    )
