"""The position grid against exact expectations and brute force."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Sighting
from robot_agent.sensing import TickMotion, position_likelihood
from tests.robot_agent.robots import CAMERA, FINE, position_localizer

GRID = FINE
PLACE = np.array([4.0, 7.0])


def normal(difference: npt.NDArray[np.float64], covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """exp(-d^T C^-1 d / 2) of differences (..., 2)."""
    solved = np.linalg.solve(covariance, difference[..., None])[..., 0]
    return np.asarray(np.exp(-0.5 * (difference * solved).sum(axis=-1)))


def camera_covariance(distance: float, angle: float) -> npt.NDArray[np.float64]:
    """Of the seen displacement: the range's variance along the line of sight, the bearing's across, and half a cell's."""
    along = 2.0 * (0.3**2 + (0.1 * distance) ** 2)
    across = 2.0 * (distance * 0.2) ** 2
    sight = np.array([math.cos(angle), math.sin(angle)])
    aside = np.array([-math.sin(angle), math.cos(angle)])
    return along * np.outer(sight, sight) + across * np.outer(aside, aside) + np.eye(2) * 0.5**2 / 12


def points(offset: tuple[float, float] = (0.0, 0.0)) -> npt.NDArray[np.float64]:
    """The places at which the cells stand, (nx, ny, 2)."""
    x, y = GRID.centres(0) + offset[0], GRID.centres(1) + offset[1]
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


@pytest.mark.parametrize("kind", ["range-bearing", "position"])
def test_a_projection_sums_over_all_own_places_on_any_grid(kind: str) -> None:
    vision = {**CAMERA, "kind": kind, "outlier": 0.1}
    localizer = position_localizer(gaussian(GRID, (0.2, 5.0), 0.7), heading=0.4, vision=vision, offset=(0.15, -0.1))
    sighting = Sighting(subject="object/ball", range=4.0, bearing=0.3, age=0.5)
    moved = TickMotion(0.8, 0.2, 1.0, 0.0, 0.0, 0.0)
    angle = 0.4 - 0.1 + 0.3  # half of the turn came after the sighting, and half of the way
    sight = np.array([4.0 * math.cos(angle) - 0.4 * math.cos(0.4), 4.0 * math.sin(angle) - 0.4 * math.sin(0.4)])
    expected = np.zeros(GRID.shape)
    for own, mass in zip(points((0.15, -0.1)).reshape(-1, 2), localizer.p.ravel(), strict=True):
        away = points() - own
        if kind == "position":
            expected += mass * position_likelihood(
                away[..., 0], away[..., 1], (sight[0], sight[1]), localizer.settings.vision
            )
        else:
            expected += mass * normal(away - sight, camera_covariance(4.0, 0.7))
    expected = 0.9 * expected / expected.sum() + 0.1 / GRID.size
    assert localizer.project(sighting, moved).p == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("corner", [(0, 0), (-1, 0), (0, -1), (-1, -1)])
def test_a_projection_reaches_from_each_corner_of_the_grid_to_the_opposite_one(corner: tuple[int, int]) -> None:
    own, other = np.array([GRID.centres(axis)[i] for axis, i in enumerate(corner)]), (-1 - corner[0], -1 - corner[1])
    p = np.zeros(GRID.shape)
    p[corner] = 1.0
    away = np.array([GRID.centres(axis)[i] for axis, i in enumerate(other)]) - own
    distance, angle = math.hypot(*away), math.atan2(away[1], away[0])
    localizer = position_localizer(Belief(GRID, p))
    expected = normal(points() - own - away, camera_covariance(distance, angle))
    projected = localizer.project(Sighting(subject="object/ball", range=distance, bearing=angle), None)
    assert projected.p == pytest.approx(expected / expected.sum(), abs=1e-12)
    assert np.unravel_index(projected.p.argmax(), GRID.shape) == (other[0] % 24, other[1] % 18)


def test_a_camera_of_range_and_bearing_weighs_every_place() -> None:
    localizer = position_localizer(gaussian(GRID, (1.0, 5.0), 1.5), heading=0.5, offset=(0.1, 0.2))
    sighting = Sighting(subject="robot/r2", range=3.5, bearing=-0.2)
    covariance = np.array([[0.5, 0.2], [0.2, 0.3]])
    sight = 3.5 * np.array([math.cos(0.3), math.sin(0.3)])
    likelihood = normal(PLACE - points((0.1, 0.2)) - sight, camera_covariance(3.5, 0.3) + covariance)
    expected = localizer.p * (likelihood + math.exp(-7.0) * likelihood.max())
    after = localizer.update_with_sighting(sighting, None, PLACE, covariance)
    assert after.p == pytest.approx(expected / expected.sum(), abs=1e-12)


def test_a_fix_weighs_by_its_sigma_and_the_cells_and_may_tell_the_heading() -> None:
    localizer = position_localizer(gaussian(GRID, (1.0, 5.0), 0.8), offset=(0.2, -0.15), heading=1.0)
    after = localizer.update_with_fix(Fix(position=(2.0, 6.0), sigma=0.3, heading=0.7, heading_sigma=0.1))
    away = points((0.2, -0.15)) - np.array([2.0, 6.0])
    expected = localizer.p * np.exp(-0.5 * (away**2).sum(axis=-1) / (0.3**2 + 0.5**2 / 12))
    assert after.p == pytest.approx(expected / expected.sum(), abs=1e-12)
    assert after.heading == 0.7
    assert localizer.update_with_fix(Fix(position=(2.0, 6.0), sigma=0.3)).heading == 1.0


def test_a_pending_variance_is_blurred_in_once_it_exceeds_a_third_of_a_cell() -> None:
    localizer = position_localizer(gaussian(GRID, (3.0, 6.0), 0.6))
    third = (0.5 / 3) ** 2
    for axis, heading in ((0, 0.0), (1, math.pi / 2)):
        waits = localizer.predict(TickMotion(0.0, 0.0, 1.0, 0.99 * third, 0.0, 0.0), heading)
        assert np.array_equal(waits.p, localizer.p)
        assert waits.pending_covariance[axis] == pytest.approx(0.99 * third)
        done = localizer.predict(TickMotion(0.0, 0.0, 1.0, 1.01 * third, 0.0, 0.0), heading)
        assert done.pending_covariance == (0.0, 0.0, 0.0)
        assert done.marginal().covariance()[axis, axis] > localizer.marginal().covariance()[axis, axis] + 0.8 * third


def test_without_a_compass_the_heading_is_reckoned_and_the_way_goes_along_it() -> None:
    localizer = position_localizer(gaussian(GRID, (1.0, 5.0), 0.6), heading=0.3)
    after = localizer.predict(TickMotion(2.3, 0.4, 1.0, 0.0, 0.0, 0.0), None)
    assert after.heading == pytest.approx(0.7)
    way = 2.3 * np.array([math.cos(0.7), math.sin(0.7)])
    assert after.marginal().mean() == pytest.approx(localizer.marginal().mean() + way, abs=0.01)
    assert max(abs(x) for x in after.offset) <= 0.25  # whole cells are moved, only the rest is carried


def test_a_belief_to_a_power_and_its_entropy() -> None:
    localizer = position_localizer(gaussian(GRID, (1.0, 5.0), 0.8))
    assert localizer.tempered(0.5).p == pytest.approx(localizer.p**0.5 / (localizer.p**0.5).sum())
    assert localizer.entropy() == pytest.approx(entropy(localizer.p))


def test_folding_reads_the_ratio_where_the_cells_stand() -> None:
    """Half a cell beside the team's grid the agreed belief still becomes the marginal."""
    localizer = position_localizer(gaussian(GRID, (3.0, 6.0), 1.2), offset=(0.2, -0.2))
    agreed = gaussian(GRID, (3.6, 5.5), 1.0)
    after = localizer.fold(agreed, localizer.marginal()).marginal()
    assert after.mean() == pytest.approx(agreed.mean(), abs=0.03)
    assert after.covariance() == pytest.approx(agreed.covariance(), abs=0.08)


def test_a_lost_position_forgets_its_offset_and_pending_noise() -> None:
    localizer = position_localizer(
        gaussian(GRID, (6.0, 4.0), 0.4), offset=(0.2, -0.2), pending_covariance=(0.01, 0.02, 0.005)
    )
    agreed = gaussian(GRID, (-1.0, 9.0), 0.5)
    after = localizer.fold(agreed, localizer.marginal())
    assert after.marginal().p == pytest.approx(agreed.p)
    assert (after.offset, after.pending_covariance) == ((0.0, 0.0), (0.0, 0.0, 0.0))


def test_a_marginal_holds_the_pending_noise() -> None:
    belief = gaussian(GRID, (3.0, 6.0), 0.7)
    pending = position_localizer(belief, pending_covariance=(0.02, 0.01, 0.005))
    grown = pending.marginal().covariance() - position_localizer(belief).marginal().covariance()
    assert np.diag(grown) == pytest.approx((0.02, 0.01), rel=0.05)
    assert grown[0, 1] == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize(
    ("heading", "axis", "end"), [(0.0, 0, -1), (math.pi, 0, 0), (math.pi / 2, 1, -1), (-math.pi / 2, 1, 0)]
)
def test_what_would_leave_the_grid_stays_in_the_last_row(heading: float, axis: int, end: int) -> None:
    localizer = position_localizer(uniform(GRID))
    after = localizer.predict(TickMotion(3 * 0.5, 0.0, 1.0, 0.0, 0.0, 0.0), heading).p
    rows = after.sum(axis=1 - axis)
    n = GRID.shape[axis]
    assert rows[end] == pytest.approx(4 / n)
    assert rows[:3] == pytest.approx([0.0] * 3 if end else [4 / n, 1 / n, 1 / n])
    assert rows[-3:] == pytest.approx([1 / n, 1 / n, 4 / n] if end else [0.0] * 3)
    far = localizer.predict(TickMotion(100 * 0.5, 0.0, 1.0, 0.0, 0.0, 0.0), heading).p.sum(axis=1 - axis)
    assert far[end] == pytest.approx(1.0)
