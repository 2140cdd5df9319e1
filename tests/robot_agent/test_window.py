"""Windows of a grid, and the position grid that works in one against the same on all cells, slow and obvious."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.belief import Belief, gaussian, shift, uniform
from blackboard.opinion.grid import Array, Grid
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.evidence import gaussian_evidence
from robot_agent.position import FAINT, SMALL, PositionLocalizer
from robot_agent.raster import LEAST_SHARE, diffused, reach_of, resampled
from robot_agent.sensing import TickMotion, place_likelihood
from robot_agent.window import Window, around, bounds, embedded, whole
from tests.robot_agent.robots import sight_of

GRID = Grid((90, 80), 1.0, (-5.0, 3.0))
LOW, HIGH = np.array([-5.0, 3.0]), np.array([85.0, 83.0])
EXACT, VAGUE = np.zeros((2, 2)), np.array([[1.2, 0.5], [0.5, 0.8]])

#: L1 distance from the slow version where the window was the whole grid: there, as in small grids, mass that a motion moves by more
#: than six standard deviations is not folded back at the border.
FOLDED = 1e-6

windows = st.builds(
    lambda x, y: Window(min(x), max(x) + 1, min(y), max(y) + 1),
    st.tuples(st.integers(0, 11), st.integers(0, 11)),
    st.tuples(st.integers(0, 8), st.integers(0, 8)),
)


def cells(window: Window) -> set[tuple[int, int]]:
    return {(x, y) for x in range(window.x0, window.x1) for y in range(window.y0, window.y1)}


# --- windows -------------------------------------------------------------------------------------------------------------


@given(a=windows, b=windows)
def test_windows_are_sets_of_cells(a: Window, b: Window) -> None:
    assert cells(a.meet(b)) == cells(a) & cells(b)
    assert min(a.meet(b).shape) >= 0
    assert a.holds(b) == (cells(b) <= cells(a))
    hull = a.hull(b)
    assert hull.holds(a)
    assert hull.holds(b)
    mask = np.zeros((12, 9), dtype=bool)
    mask[a.slices] = mask[b.slices] = True
    assert bounds(mask) == hull
    assert cells(a.grown(2, (12, 9))) == {(x, y) for x in range(12) for y in range(9) if near((x, y), a, 2)}


def near(cell: tuple[int, int], window: Window, reach: int) -> bool:
    (x, y), (x0, x1, y0, y1) = cell, window
    return x0 - reach <= x < x1 + reach and y0 - reach <= y < y1 + reach


@given(a=windows, b=windows)
def test_what_is_embedded_stands_where_it_stood(a: Window, b: Window) -> None:
    values = np.arange(108.0).reshape(12, 9)
    out = embedded(values[a.slices], a, a.hull(b), -1.0)
    assert np.array_equal(out[a.within(a.hull(b))], values[a.slices])
    assert (out == -1.0).sum() == len(cells(a.hull(b)) - cells(a))


def test_nothing_that_is_held_is_bounded_by_the_whole_grid() -> None:
    assert bounds(np.zeros((4, 3), dtype=bool)) == whole((4, 3))


@given(x=st.floats(-40, 120), y=st.floats(-40, 120), reach=st.floats(0, 50))
def test_around_holds_all_cells_within_reach_and_at_most_one_more(x: float, y: float, reach: float) -> None:
    grid = Grid((24, 18), 0.5, (-3.0, 2.0))
    window = around(grid, (x, y), (reach, 2 * reach))
    for axis, (at, far, ends) in enumerate(((x, reach, window[:2]), (y, 2 * reach, window[2:]))):
        away = np.abs(grid.centres(axis) - at)
        inside = np.zeros(grid.shape[axis], dtype=bool)
        inside[ends[0] : ends[1]] = True
        assert not (away[~inside] < far - 1e-9).any()
        assert (away[inside] <= far + 0.5 + 1e-9).all()


@given(
    mean=st.tuples(st.floats(-30, 110), st.floats(-30, 110)),
    sigmas=st.tuples(st.floats(0.3, 9), st.floats(0.3, 9)),
    correlation=st.floats(-0.95, 0.95),
    misread=st.floats(0.1, 12),
)
@settings(max_examples=40)
def test_a_gaussian_is_computed_where_it_matters(
    mean: tuple[float, float], sigmas: tuple[float, float], correlation: float, misread: float
) -> None:
    xy = correlation * sigmas[0] * sigmas[1]
    covariance, floor = np.array([[sigmas[0] ** 2, xy], [xy, sigmas[1] ** 2]]), math.exp(-misread)
    x, y = GRID.mesh()
    d = np.stack(np.broadcast_arrays(x - mean[0], y - mean[1]), axis=-1)
    logs = -0.5 * (d * np.linalg.solve(covariance, d[..., None])[..., 0]).sum(axis=-1)
    relative = np.exp(logs - logs.max())
    evidence = gaussian_evidence(lambda window: relative[window.slices], GRID, mean, covariance, floor)
    assert relative[evidence.peak.slices].max() == 1.0
    for window, most in ((evidence.support, floor * 2.0**-53), (evidence.peak, 1.001 * floor)):
        outside = relative.copy()
        outside[window.slices] = 0.0
        assert outside.max() <= most


@given(variance=st.floats(1e-4, 60))
def test_the_heat_kernel_ends_within_its_reach(variance: float) -> None:
    n = 256
    kernel = np.fft.irfft(np.exp(variance * (np.cos(2 * math.pi * np.fft.rfftfreq(n)) - 1)), n)
    assert np.abs(kernel[reach_of(variance) + 1 : n // 2]).sum() < 1e-14  # 1e-15, and the rounding of the transform


# --- the position grid on all cells, slow and obvious ----------------------------------------------------------------------


@dataclass
class Slow:
    """What `PositionLocalizer` does, on all cells: mass is folded back at the border from as far as it comes."""

    vision: str
    p: Array
    offset: Array
    pending: Array
    #: Bound of the L1 distance of a belief in a window: each evidence may raise its share.
    left_out: float = FAINT * GRID.size

    def predict(self, motion: TickMotion, heading: float) -> None:
        c, s = math.cos(heading), math.sin(heading)
        way = self.offset + motion.distance * np.array([c, s])
        steps = np.array([round(v) for v in way])
        self.p, self.offset = shift(self.p, steps.tolist()), way - steps
        turn = np.array([[c, -s], [s, c]])
        self.pending = self.pending + turn @ np.diag([motion.along, motion.across]) @ turn.T
        if max(self.pending[0, 0], self.pending[1, 1]) > 1 / 9:
            self.p, self.pending = self.spread(), np.zeros((2, 2))

    def spread(self) -> Array:
        if not self.pending.any():
            return self.p
        (xx, xy), (_, yy) = self.pending
        far = reach_of(max(xx, yy))
        wide = np.pad(self.p, far)
        fx, fy = (2 * math.pi * np.fft.fftfreq(n) for n in wide.shape)
        fx = fx[:, None]
        symbol = np.exp(xx * (np.cos(fx) - 1) + yy * (np.cos(fy) - 1) - xy * np.sin(fx) * np.sin(fy))
        out = np.maximum(np.fft.ifft2(np.fft.fft2(wide) * symbol).real, LEAST_SHARE * wide)
        for axis in (0, 1):
            rows = np.moveaxis(out, axis, 0)
            kept = rows[far:-far].copy()
            kept[:far] += rows[:far][::-1]
            kept[-far:] += rows[-far:][::-1]
            out = np.moveaxis(kept, 0, axis)
        return np.asarray(out * self.p.sum() / out.sum())

    def away(self, place: Array) -> tuple[Array, Array]:
        x, y = GRID.mesh()
        return np.asarray(place[0] - x - self.offset[0]), np.asarray(place[1] - y - self.offset[1])

    def see(self, sighting: Sighting, heading: float, place: Array, covariance: Array, section: RobotSection) -> None:
        angle = heading + sighting.bearing
        sight = np.array([math.cos(angle), math.sin(angle)])
        sight_end = sighting.range * sight
        dx, dy = self.away(place)
        vision = section.vision
        if self.vision == "position":
            likelihood = place_likelihood(dx, dy, (sight_end[0], sight_end[1]), covariance, vision)
        else:
            aside = np.array([-sight[1], sight[0]])
            along = vision.frames * (vision.range_floor**2 + (vision.range_share * sighting.range) ** 2)
            across = vision.frames * (sighting.range * vision.bearing) ** 2
            noise = along * np.outer(sight, sight) + across * np.outer(aside, aside) + covariance + np.eye(2) / 12
            d = np.stack(np.broadcast_arrays(dx - sight_end[0], dy - sight_end[1]), axis=-1)
            likelihood = np.exp(-0.5 * (d * np.linalg.solve(noise, d[..., None])[..., 0]).sum(axis=-1))
        self.weigh(likelihood + math.exp(-vision.misread) * likelihood.max())

    def fix(self, place: Array, sigma: float) -> None:
        dx, dy = self.away(place)
        self.weigh(np.exp(-0.5 * (dx**2 + dy**2) / (sigma**2 + 1 / 12)))

    def weigh(self, likelihood: Array) -> None:
        p, met = self.p * likelihood, float((self.p * likelihood).sum() / likelihood.max())
        self.left_out /= met if met > 1e-12 else self.left_out / (FAINT * GRID.size)
        p = p if met > 1e-12 else likelihood
        self.p = np.asarray(p / p.sum())

    def marginal(self) -> Array:
        p = resampled(self.spread(), self.offset[0], self.offset[1])
        return np.asarray(p / p.sum())


def section(vision: str) -> RobotSection:
    return RobotSection.model_validate({"vision": {"kind": vision, "bearing": 0.1}})


def place_of(fraction: tuple[float, float]) -> Array:
    return np.asarray(LOW + np.array(fraction) * (HIGH - LOW))


unit = st.floats(0, 1)
places = st.tuples(st.sampled_from([0.0, 0.02, 1.0]) | unit, st.sampled_from([0.0, 1.0]) | unit)  # often at the border
steps = st.fixed_dictionaries(
    {
        "distance": st.floats(-2, 6),
        "heading": st.floats(-math.pi, math.pi),
        "along": st.floats(0, 0.8),
        "across": st.floats(0, 0.2),
        "event": st.sampled_from(["", "fix", "far fix", "landmark", "mate"]),
        "off": st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),  # standard deviations
        "sight": st.tuples(st.floats(2, 12), st.floats(-math.pi, math.pi)),
        "to": places,
    }
)


@given(
    vision=st.sampled_from(["position", "range-bearing"]),
    begins=st.sampled_from(["uniform", "one", "two", "sharp"]),
    at=places,
    other=places,
    course=st.lists(steps, min_size=1, max_size=8),
)
@settings(max_examples=60, deadline=None)
def test_in_its_window_a_belief_is_that_on_all_cells(vision, begins, at, other, course) -> None:  # type: ignore[no-untyped-def]
    true, robot = place_of(at), section(vision)
    p = uniform(GRID).p
    if begins != "uniform":
        sigma = 0.3 if begins == "sharp" else 2.0
        p = gaussian(GRID, true.tolist(), sigma).p
        p = 0.5 * p + 0.5 * gaussian(GRID, place_of(other).tolist(), sigma).p if begins == "two" else p
    localizer = replace(PositionLocalizer.unknown(robot, GRID), p=p)
    slow, folded = Slow(vision, p, np.zeros(2), np.zeros((2, 2))), 0.0
    for step in course:
        heading, moved = step["heading"], TickMotion(step["distance"], 0.0, 1.0, step["along"], step["across"], 0.0)
        localizer = localizer.predict(moved, heading)
        slow.predict(moved, heading)
        true = np.clip(true + moved.distance * np.array([math.cos(heading), math.sin(heading)]), LOW, HIGH)
        off = np.array(step["off"])
        if step["event"] == "far fix":
            true = place_of(step["to"])
        if step["event"].endswith("fix"):
            localizer = localizer.update_with_fix(Fix(position=(true + off).tolist(), sigma=1.0))
            slow.fix(true + off, 1.0)
        elif step["event"]:
            distance, angle = step["sight"]
            place = true + distance * np.array([math.cos(angle), math.sin(angle)])
            sighting = Sighting(
                subject="landmark/1",
                range=max(0.0, distance + 0.3 * off[0]),
                bearing=math.remainder(angle - heading + 0.05 * off[1], 2 * math.pi),
            )
            covariance = VAGUE if step["event"] == "mate" else EXACT
            localizer = localizer.update_with_sighting(sighting, moved, place, covariance)
            slow.see(sighting, heading, place, covariance, robot)
        folded = FOLDED if localizer.window == whole(GRID.shape) else folded
    assert np.abs(localizer.marginal().p - slow.marginal()).sum() < slow.left_out + folded


# --- what the window is for, and what it must not cost ---------------------------------------------------------------------

STEP = TickMotion(1.0, 0.0, 1.0, 0.3, 0.1, 0.0)


def sighting_of(true: Array, place: Array, heading: float) -> Sighting:
    return sight_of((true[0], true[1], heading), "landmark/1", (place[0], place[1]), landmark=False)


@pytest.mark.parametrize("vision", ["position", "range-bearing"])
def test_a_robot_that_was_carried_off_finds_itself_by_what_it_sees(vision: str) -> None:
    """Where nothing of its belief is left, as many sightings are needed as FILL has to be raised by: e^misread each."""
    localizer = PositionLocalizer.unknown(section(vision), GRID).update_with_fix(Fix(position=(10.0, 15.0), sigma=1.0))
    localizer = localizer.predict(STEP, 0.0)
    assert localizer.p.size < SMALL
    true = np.array([60.0, 60.0])
    for _ in range(8):
        localizer, true = localizer.predict(STEP, 0.0), true + [1.0, 0.0]
        localizer = localizer.update_with_sighting(
            sighting_of(true, true + [5.0, 5.0], 0.0), STEP, true + [5.0, 5.0], EXACT
        )
    assert localizer.marginal().mean() == pytest.approx(true, abs=0.3)


def test_a_team_that_knows_better_brings_a_robot_back() -> None:
    """Most of the agreed belief is elsewhere, so that both still meet."""
    localizer = PositionLocalizer.unknown(section("position"), GRID).update_with_fix(
        Fix(position=(10.0, 15.0), sigma=1.0)
    )
    for _ in range(10):
        localizer = localizer.predict(STEP, math.pi / 2)
        here, there = localizer.marginal(), gaussian(GRID, (60.0, 60.0), 1.5)
        localizer = localizer.fold(Belief(GRID, 0.1 * here.p + 0.9 * there.p), here)
    assert localizer.marginal().p[55:75, 50:70].sum() > 0.85


@pytest.mark.parametrize("vision", ["position", "range-bearing"])
def test_a_projection_from_a_window_is_that_of_the_whole_grid(vision: str) -> None:
    localizer = PositionLocalizer.unknown(section(vision), GRID).update_with_fix(Fix(position=(3.0, 78.0), sigma=1.5))
    small = localizer.predict(STEP, 0.3)
    p = np.zeros(GRID.shape)
    p[small.window.slices] = small.p
    sighting = Sighting(subject="object/ball", range=6.0, bearing=-1.2)
    expected = replace(small, p=p, corner=(0, 0)).project(sighting, STEP).p
    assert small.p.size < SMALL
    assert small.project(sighting, STEP).p == pytest.approx(expected, abs=1e-12)


def test_a_robot_that_knows_its_place_works_in_a_window_and_a_small_grid_is_left_whole() -> None:
    localizer = PositionLocalizer.unknown(section("position"), GRID).update_with_fix(
        Fix(position=(40.0, 40.0), sigma=1.0)
    )
    for _ in range(30):
        localizer = localizer.predict(STEP, 0.5).update_with_fix(Fix(position=(60.0, 60.0), sigma=1.0))
        assert localizer.p.size <= 2 * SMALL
        x, y = localizer.window.slices
        left = localizer.marginal().p.copy()
        left[max(0, x.start - 1) : x.stop + 1, max(0, y.start - 1) : y.stop + 1] = 0.0
        assert left.max() <= FAINT
    small = Grid((64, 64))
    localizer = PositionLocalizer.unknown(section("position"), small).update_with_fix(
        Fix(position=(40.0, 40.0), sigma=1.0)
    )
    assert localizer.predict(STEP, 0.5).window == whole(small.shape)


def test_mass_between_no_walls_goes_on() -> None:
    p = np.zeros((60, 60))
    p[30, 25] = 1.0
    covariance = np.array([[0.5, 0.2], [0.2, 0.3]])
    open_ended = diffused(p, covariance, ((False, False), (False, True)))
    assert open_ended == pytest.approx(diffused(p, covariance), abs=1e-9)
    corner = np.zeros((60, 60))
    corner[0, 0] = 1.0
    assert diffused(corner, covariance, ((True, False), (True, False))) == pytest.approx(
        diffused(corner, covariance), abs=1e-6
    )


def test_a_belief_to_a_power_lets_a_robot_that_was_carried_away_be_found() -> None:
    settings_ = RobotSection.model_validate({"localizer": "position"})
    known = PositionLocalizer.unknown(settings_, GRID).update_with_fix(Fix(position=(20.0, 30.0), sigma=1.0))
    for _ in range(3):
        known = known.predict(TickMotion(0.0, 0.0, 1.0, 0.01, 0.01, 0.0), 0.0)
    assert known.p.size < GRID.size
    wide = known.tempered(0.2)
    assert wide.p.shape == GRID.shape
    assert wide.p.min() > 0
    belief = wide.update_with_fix(Fix(position=(70.0, 60.0), sigma=1.0)).marginal()
    assert belief.mean() == pytest.approx([70.0, 60.0], abs=1.0)
