"""The pose grid against exact expectations, on a grid whose cell is not 1 and whose origin is not 0, and its laws of motion."""

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Array, Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.localizer import Localizer
from robot_agent.pose import PoseLocalizer
from robot_agent.position import PositionLocalizer
from robot_agent.sensing import TickMotion

GRID = Grid((30, 26), 0.5, (-6.0, 2.0), "m")
N = 16
BIN = 2 * math.pi / N
SETTINGS = RobotSection.model_validate(
    {"localizer": "pose", "headings": N, "vision": {"kind": "range-bearing", "outlier": 0.1, "frames": 2.0}}
)
CENTRE = (1.3, 8.2)


def pose_localizer(*masses: float, sigma: float = 1.1, **more: object) -> PoseLocalizer:
    """A Gaussian around CENTRE in each heading bin, with these masses from bin 0 on."""
    shares = np.zeros(N)
    shares[: len(masses)] = masses
    p = (shares[:, None, None] * gaussian(GRID, CENTRE, sigma).p).astype(np.float32)
    begun = PoseLocalizer.unknown(SETTINGS, GRID)
    held = {name: more.pop(name) for name in ("turned", "offsets") if name in more}
    return replace(begun, poses=replace(begun.poses, p=p, **held), **more)  # type: ignore[arg-type]


def drive(
    distance: float = 0.0, turn: float = 0.0, along: float = 0.0, across: float = 0.0, heading: float = 0.0
) -> TickMotion:
    return TickMotion(distance, turn, 1.0, along, across, heading)


def headings(localizer: Localizer) -> tuple[Array, Array]:
    assert isinstance(localizer, PoseLocalizer)
    return localizer.poses.headings, localizer.poses.p.sum(axis=(1, 2), dtype=float)


def off(angles: Array, angle: float) -> Array:
    return np.asarray(np.angle(np.exp(1j * (angles - angle))))


def test_a_compass_weighs_the_headings_by_its_sigma_and_the_bins() -> None:
    localizer = pose_localizer(*[1 / N] * N, turned=0.1)
    after = localizer.predict(drive(), 0.5)
    angles, masses = headings(after)
    expected = np.exp(-0.5 * off(angles, 0.5) ** 2 / (0.03**2 + BIN**2 / 12))
    assert masses == pytest.approx(expected / expected.sum(), abs=1e-5)


def test_a_fix_weighs_every_pose() -> None:
    localizer = pose_localizer(0.5, 0.3, 0.2, turned=-0.1, offsets=np.tile((0.2, -0.1), (N, 1)))
    after = localizer.update_with_fix(Fix(position=(2.0, 7.5), sigma=0.6, heading=0.4, heading_sigma=0.3))
    x, y = GRID.centres(0) + 0.2, GRID.centres(1) - 0.1
    places = (x[:, None] - 2.0) ** 2 + (y[None, :] - 7.5) ** 2
    likelihood = np.exp(-0.5 * places / (0.6**2 + 0.5**2 / 12))
    angles = np.arange(N) * BIN - 0.1
    turned = np.exp(-0.5 * off(angles, 0.4) ** 2 / (0.3**2 + BIN**2 / 12))
    expected = localizer.poses.p * likelihood * turned[:, None, None]
    assert after.poses.p == pytest.approx(expected / expected.sum(), abs=1e-6)


def test_an_uncertain_landmark_weighs_range_and_bearing_by_all_their_variances() -> None:
    localizer = pose_localizer(0.4, 0.4, 0.2, turned=0.1, offsets=np.tile((0.1, 0.15), (N, 1)))
    sighting = Sighting(subject="robot/r2", range=4.0, bearing=0.2, age=0.5)
    moved = drive(distance=0.6, turn=0.2)
    place, covariance = np.array([5.0, 9.5]), np.array([[0.8, 0.3], [0.3, 0.4]])
    vision = SETTINGS.vision
    likelihood = np.zeros(localizer.poses.p.shape)
    for i, heading in enumerate(localizer.poses.headings):
        x = GRID.centres(0)[:, None] + 0.1 - 0.3 * math.cos(heading)  # half of the way was driven since
        y = GRID.centres(1)[None, :] + 0.15 - 0.3 * math.sin(heading)
        dx, dy = place[0] - x, place[1] - y
        distance = np.maximum(np.hypot(dx, dy), 0.25)
        sight = np.stack([dx + 0 * dy, dy + 0 * dx]) / distance
        aside = np.stack([-dy + 0 * dx, dx + 0 * dy]) / distance
        whole = covariance + np.eye(2) * 0.5**2 / 12
        radial = 2.0 * (vision.range_floor**2 + (vision.range_share * 4.0) ** 2)
        radial = radial + np.einsum("axy,ab,bxy->xy", sight, whole, sight)
        angular = 2.0 * vision.bearing**2 + BIN**2 / 12
        angular = angular + np.einsum("axy,ab,bxy->xy", aside, whole, aside) / distance**2
        angle = off(np.arctan2(dy, dx), heading - 0.1 + 0.2)
        squared = (4.0 - distance) ** 2 / radial + angle**2 / angular
        likelihood[i] = np.exp(-0.5 * squared) / np.sqrt(radial * angular)
    floor = math.exp(-vision.misread) * likelihood[localizer.poses.p > 1e-7 * localizer.poses.p.sum()].max()
    expected = localizer.poses.p * (likelihood + floor)
    after = localizer.update_with_sighting(sighting, moved, place, covariance)
    assert after.poses.p == pytest.approx(expected / expected.sum(), abs=2e-6)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.2, -0.15)])
def test_a_projection_moves_each_slice_along_its_own_line_of_sight(offset: tuple[float, float]) -> None:
    localizer = pose_localizer(0.6, 0.4, turned=0.15, offsets=np.tile(offset, (N, 1)))
    sighting = Sighting(subject="object/ball", range=3.0, bearing=0.5, age=0.5)
    moved = drive(distance=1.0, turn=0.2)
    vision = SETTINGS.vision
    along = 2.0 * (vision.range_floor**2 + (vision.range_share * 3.0) ** 2)
    across = 9.0 * (2.0 * vision.bearing**2 + BIN**2 / 12)
    total = np.zeros(GRID.shape)
    x, y = GRID.centres(0)[:, None], GRID.centres(1)[None, :]
    for mass, heading in ((0.6, 0.15), (0.4, 0.15 + BIN)):
        angle = heading - 0.1 + 0.5
        sight = np.array([math.cos(angle), math.sin(angle)])
        aside = np.array([-math.sin(angle), math.cos(angle)])
        spread = along * np.outer(sight, sight) + across * np.outer(aside, aside) + 1.1**2 * np.eye(2)
        mean = np.array(CENTRE) + offset + 3.0 * sight - 0.5 * np.array([math.cos(heading), math.sin(heading)])
        inverse = np.linalg.inv(spread)
        dx, dy = x - mean[0], y - mean[1]
        squared = inverse[0, 0] * dx**2 + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy**2
        density = np.exp(-0.5 * squared)
        total += mass * density / density.sum()
    assert localizer.project(sighting, moved).p == pytest.approx(0.9 * total + 0.1 / GRID.size, abs=1e-5)


@pytest.mark.parametrize("distance", [5e3, 1e7, 1e12])
def test_what_is_seen_far_beyond_the_grid_costs_no_memory_and_tells_nothing(distance: float) -> None:
    """As millimetres on a grid of metres: the robot asked for petabytes, and did not do its tick."""
    projected = pose_localizer(0.5, 0.5).project(Sighting(subject="object/ball", range=distance, bearing=0.0), None)
    assert projected.p == pytest.approx(1.0 / GRID.size)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_pending_variances_wait_for_a_third_of_a_cell_or_a_bin(share: float) -> None:
    third, narrow = share * (0.5 / 3) ** 2, share * (BIN / 3) ** 2
    localizer = pose_localizer(1.0)
    for motion_, name, waiting in (
        (drive(along=third), "along", third),
        (drive(across=third), "across", third),
        (drive(heading=narrow), "heading", narrow),
    ):
        after = localizer.predict(motion_, None)
        assert np.array_equal(after.poses.p, localizer.poses.p) == (share < 1)
        assert getattr(after, name) == pytest.approx(waiting if share < 1 else 0.0)


@pytest.mark.parametrize("bins", [0.4, 1.3, 3.0])
def test_heading_noise_adds_its_variance_and_carries_the_offsets_along(bins: float) -> None:
    """Slices that stand at different offsets keep their places when mass passes between them."""
    offsets = np.zeros((N, 2))
    offsets[7], offsets[8], offsets[9] = (-0.2, 0.1), (0.2, -0.1), (0.1, 0.2)
    localizer = pose_localizer(*[0.0] * 8, 1.0, offsets=offsets)
    after = localizer.predict(drive(heading=bins * BIN**2), None)
    angles, masses = headings(after)
    assert (masses * off(angles, 8 * BIN) ** 2).sum() == pytest.approx(bins * BIN**2, rel=0.02)
    assert masses.sum() == pytest.approx(1.0, abs=1e-5)
    assert after.marginal().mean() == pytest.approx(localizer.marginal().mean(), abs=1e-3)
    assert after.heading == 0.0


def test_a_pose_to_a_power_and_its_entropy() -> None:
    localizer = pose_localizer(0.7, 0.3)
    expected = localizer.poses.p.astype(float) ** 0.5
    assert localizer.tempered(0.5).poses.p == pytest.approx(expected / expected.sum(), abs=1e-4)
    assert localizer.entropy() == pytest.approx(
        entropy(localizer.poses.p.astype(float) / localizer.poses.p.sum(dtype=float)), abs=1e-4
    )


def test_the_marginal_moves_each_slice_by_its_offset() -> None:
    localizer = pose_localizer(0.5, 0.5, offsets=np.vstack([[(0.2, 0.0), (0.0, -0.2)], np.zeros((N - 2, 2))]))
    assert localizer.marginal().mean() == pytest.approx((CENTRE[0] + 0.1, CENTRE[1] - 0.1), abs=1e-3)


def test_folding_a_slice_reads_the_ratio_where_it_stands() -> None:
    localizer = pose_localizer(0.5, 0.5, offsets=np.tile((0.2, -0.2), (N, 1)), sigma=1.4)
    agreed = gaussian(GRID, (1.9, 7.4), 1.1)
    after = localizer.fold(agreed, localizer.marginal()).marginal()
    assert after.mean() == pytest.approx(agreed.mean(), abs=0.03)
    assert after.covariance() == pytest.approx(agreed.covariance(), abs=0.08)


def test_a_lost_pose_forgets_its_offsets_and_pending_variances() -> None:
    localizer = pose_localizer(0.6, 0.4, sigma=0.4, offsets=np.tile((0.2, -0.2), (N, 1)), along=0.01, across=0.02)
    agreed = gaussian(GRID, (-4.0, 13.0), 0.5)
    after = localizer.fold(agreed, localizer.marginal())
    assert after.marginal().p == pytest.approx(agreed.p, abs=1e-6)
    assert headings(after)[1] == pytest.approx([0.6, 0.4, *[0.0] * (N - 2)], abs=1e-6)
    assert (after.along, after.across) == (0.0, 0.0)


@pytest.mark.parametrize("kind", ["pose", "position"])
def test_a_fix_is_blurred_by_the_width_of_a_cell_whatever_the_cell(kind: str) -> None:
    grid = Grid((20, 18), 0.3, (-1.0, 2.0))
    begun = PoseLocalizer.unknown(SETTINGS, grid) if kind == "pose" else PositionLocalizer.unknown(SETTINGS, grid)
    after = begun.update_with_fix(Fix(position=(2.0, 5.0), sigma=0.1)).marginal()
    away = (grid.centres(0)[:, None] - 2.0) ** 2 + (grid.centres(1)[None, :] - 5.0) ** 2
    expected = np.exp(-0.5 * away / (0.1**2 + 0.3**2 / 12))
    assert after.p == pytest.approx(expected / expected.sum(), abs=1e-5)


def test_a_landmark_within_the_robots_own_cell_counts_as_half_a_cell_away() -> None:
    """Where the distance is smaller than a cell, its direction says nothing, and the bearing must not rule the cell out."""
    localizer = pose_localizer(1.0, sigma=0.6)
    place = np.array([GRID.centres(0)[14], GRID.centres(1)[12]])
    sighting = Sighting(subject="landmark/l1", range=0.1, bearing=0.0)
    vision = SETTINGS.vision
    dx, dy = place[0] - GRID.centres(0)[:, None], place[1] - GRID.centres(1)[None, :]
    distance = np.maximum(np.hypot(dx, dy), 0.25)
    width = 0.5**2 / 12
    radial = 2.0 * (vision.range_floor**2 + (vision.range_share * 0.1) ** 2)
    radial = radial + width * (dx**2 + dy**2) / distance**2
    across = width * (dx**2 + dy**2) / distance**2
    angular = 2.0 * vision.bearing**2 + BIN**2 / 12 + across / distance**2
    squared = (0.1 - distance) ** 2 / radial + np.arctan2(dy, dx) ** 2 / angular
    likelihood = np.exp(-0.5 * squared) / np.sqrt(radial * angular)
    expected = localizer.poses.p[0] * (
        likelihood
        + math.exp(-vision.misread) * likelihood[localizer.poses.p[0] > 1e-7 * localizer.poses.p[0].max()].max()
    )
    after = localizer.update_with_sighting(sighting, None, place, np.zeros((2, 2)))
    assert after.poses.p[0] == pytest.approx(expected / expected.sum(), abs=2e-6)


# --- a robot on a fine grid ----------------------------------------------------------------------------------------------


SMALL = Grid((40, 36), 0.1, (-2.0, -1.8), "m")
CERTAIN = RobotSection.model_validate(
    {"localizer": "pose", "headings": 60, "vision": {"kind": "range-bearing", "outlier": 0.0, "frames": 1.0}}
)


def at(x: float, y: float, heading: float, sigma: float = 0.15, heading_sigma: float = 0.1) -> PoseLocalizer:
    fix = Fix(position=(x, y), sigma=sigma, heading=heading, heading_sigma=heading_sigma)
    return PoseLocalizer.unknown(CERTAIN, SMALL).update_with_fix(fix)


def mean_heading(localizer: PoseLocalizer) -> float:
    return float(np.angle((localizer.poses.masses * np.exp(1j * localizer.poses.headings)).sum()))


def test_heading_doubt_bends_the_position_as_it_should() -> None:
    """After a straight way of 1.5 m with a heading of sigma 0.1, the position is spread sideways by 0.15 m."""
    localizer: Localizer = at(-1.2, 0.0, 0.0, sigma=0.1, heading_sigma=0.1)
    for _ in range(30):
        localizer = localizer.predict(drive(0.05), None)
    sideways = localizer.marginal().covariance()[1, 1]
    assert sideways == pytest.approx(0.1**2 + 0.15**2 + 0.1**2 / 12, rel=0.25)


def test_a_misread_barcode_does_little_harm() -> None:
    localizer = at(0.0, 0.0, 0.0, sigma=0.1, heading_sigma=0.05)
    wrong = Sighting(subject="landmark/1", range=1.0, bearing=3.0)
    after = localizer.update_with_sighting(wrong, None, np.array((1.5, 0.0)), np.zeros((2, 2)))
    assert np.abs(after.marginal().mean() - localizer.marginal().mean()).max() < 0.1


def test_folding_keeps_heading_given_position() -> None:
    """Far ahead means heading straight on, far left heading left: a new position brings its heading with it."""
    localizer: Localizer = at(-1.0, 0.0, 0.0, sigma=0.08, heading_sigma=0.2)
    for _ in range(20):
        localizer = localizer.predict(drive(0.06), None)
    reported = localizer.marginal()
    left = gaussian(SMALL, (0.15, 0.25), 0.1)
    after = localizer.fold(left, reported)
    assert isinstance(after, PoseLocalizer)
    assert mean_heading(after) > 0.12
    assert after.marginal().mean() == pytest.approx((0.15, 0.25), abs=0.06)
