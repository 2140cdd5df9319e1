"""The motion of the pose grid, slice by slice, against the slow and obvious."""

import math
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, blur, gaussian, shift
from blackboard.opinion.grid import Grid
from robot_agent.pose_grid import PoseGrid
from robot_agent.raster import shifted

GRID = Grid((20, 16), 0.5)
N = 12


def poses_of(*masses: float, turned: float = 0.0) -> PoseGrid:
    """Slice i holds masses[i] around another place."""
    poses = PoseGrid.uniform(GRID, N)
    p = poses.empty()
    for i, mass in enumerate(masses):
        p[i] = mass * gaussian(GRID, (4.0 + 0.2 * i, 4.0), 0.8).p
    return replace(poses, p=p, turned=turned)


def mean(p: np.ndarray) -> np.ndarray:
    x, y = GRID.mesh()
    return np.array([(p * x).sum() / p.sum(), (p * y).sum() / p.sum()])


def test_the_headings_go_round() -> None:
    poses = PoseGrid.uniform(GRID, N)
    assert poses.headings == pytest.approx(np.arange(N) * math.pi / 6)
    assert poses.masses == pytest.approx(np.full(N, 1 / N))
    assert replace(poses, turned=0.1).headings[3] == pytest.approx(math.pi / 2 + 0.1)


@pytest.mark.parametrize("angle", [0.0, 0.1, -0.1, 0.4, 1.3, -4.0, 7.0])
def test_turning_turns_every_heading_and_moves_nothing(angle: float) -> None:
    poses = replace(poses_of(0.5, 0.3, 0.2), offsets=np.arange(2.0 * N).reshape(N, 2) / 100)
    after = poses.turn(angle)
    assert abs(after.turned) <= poses.bin / 2 + 1e-12
    for i in range(3):
        wanted = poses.headings[i] + angle
        j = int(np.argmax(np.cos(after.headings - wanted)))
        assert math.cos(after.headings[j] - wanted) == pytest.approx(1.0)
        assert np.array_equal(after.p[j], poses.p[i])
        assert np.array_equal(after.offsets[j], poses.offsets[i])


def test_driving_moves_each_slice_along_its_own_heading() -> None:
    poses = poses_of(0.5, 0.3, 0.0, 0.2)
    after = poses
    for _ in range(4):
        after = after.drive(0.33, 0.0)
    for i in (0, 1, 3):
        moved = mean(after.p[i]) + after.offsets[i] - mean(poses.p[i])
        way = 4 * 0.33 * np.array([math.cos(i * math.pi / 6), math.sin(i * math.pi / 6)])
        assert moved == pytest.approx(way, abs=1e-3)
        assert np.abs(after.offsets[i]).max() <= GRID.cell / 2 + 1e-9
        whole = np.rint((way - after.offsets[i]) / GRID.cell).astype(int)
        assert after.p[i] == pytest.approx(shift(poses.p[i], whole), abs=1e-7)  # by whole cells: nothing was blurred
    assert poses.drive(0.0, 0.3) is poses


def test_the_chord_of_an_arc_points_halfway() -> None:
    poses = poses_of(1.0)
    after = poses.turn(0.2).drive(1.0, 0.2)
    i = int(np.argmax(after.masses))
    assert mean(after.p[i]) + after.offsets[i] - mean(poses.p[0]) == pytest.approx(
        [math.cos(0.1), math.sin(0.1)], abs=1e-3
    )


def test_blurring_positions_is_along_and_across_each_heading() -> None:
    poses = poses_of(0.5, 0.0, 0.0, 0.5)  # headings 0 and 90 degrees
    after = poses.blur_positions(0.64, 0.04)
    assert after.p[0] == pytest.approx(0.5 * blur(poses.p[0] / 0.5, [1.6, 0.4]), abs=1e-6)
    assert after.p[3] == pytest.approx(0.5 * blur(poses.p[3] / 0.5, [0.4, 1.6]), abs=1e-6)


@pytest.mark.parametrize("bins", [0.2, 0.5, 0.7, 1.4])
def test_blurring_headings_adds_its_variance_and_conserves_mass(bins: float) -> None:
    poses = poses_of(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    after = poses.blur_headings(bins * poses.bin**2)
    assert after.masses.sum() == pytest.approx(1.0, abs=1e-5)
    assert after.p.min() >= 0  # a walk in too few steps would take more from a bin than it holds
    away = np.arange(N) - 6
    assert (after.masses * away).sum() == pytest.approx(0.0, abs=1e-5)
    assert (after.masses * away**2).sum() == pytest.approx(bins, rel=0.02)


def test_a_heading_of_which_nothing_is_known_any_more_widens_no_place() -> None:
    """As after a step that came late. A walk in many small steps moves each slice so often, and widens it each time."""
    offsets = np.random.default_rng(1).uniform(-0.25, 0.25, (N, 2))
    poses = replace(poses_of(*[1 / N] * N), offsets=offsets)
    after = poses.blur_headings(math.pi**2)
    assert after.masses == pytest.approx(np.full(N, 1 / N), abs=1e-5)
    assert after.p.min() >= 0
    places = [after.p.sum(axis=0), sum(shifted(p, *(at / GRID.cell)) for p, at in zip(poses.p, offsets, strict=True))]
    spreads = [Belief(GRID, p / p.sum()).covariance() for p in places]
    assert np.trace(spreads[0]) == pytest.approx(np.trace(spreads[1]), rel=0.01)


def test_what_goes_to_a_neighbour_stays_where_it_is() -> None:
    """The neighbours stand elsewhere beside the grid; the mass is moved by the difference."""
    offsets = np.zeros((N, 2))
    offsets[1], offsets[11] = (0.2, -0.1), (-0.15, 0.2)
    poses = replace(poses_of(1.0), offsets=offsets)
    after = poses.blur_headings(0.2 * poses.bin**2)
    for i in (0, 1, 11):
        assert mean(after.p[i]) + offsets[i] == pytest.approx(mean(poses.p[0]), abs=1e-4)
    assert after.masses[[0, 1, 11]] == pytest.approx([0.8, 0.1, 0.1], abs=1e-5)


def test_slices_and_box_hold_all_but_the_faint() -> None:
    poses = poses_of(0.5, 1e-9, 0.4999, 1e-4)
    assert poses.slices().tolist() == [0, 2, 3]
    assert poses.slices(1e-3).tolist() == [0, 2]
    p = poses.empty()
    p[2, 5:8, 3:5] = 1.0
    bx, by = replace(poses, p=p).box(np.array([2]))
    assert (bx, by) == (slice(3, 10), slice(1, 7))
    p[2, 0, 0] = 1.0
    assert replace(poses, p=p).box(np.array([2])) == (slice(0, 10), slice(0, 7))


def test_normalising_scales_to_one_and_keeps_what_it_was_where_nothing_is_left() -> None:
    poses = poses_of(0.5, 0.5)
    assert poses.normalised(4 * poses.p).masses.sum() == pytest.approx(1.0)
    assert poses.normalised(poses.empty()) is poses
    assert poses.normalised(np.full(poses.p.shape, np.nan, dtype=np.float32)) is poses
