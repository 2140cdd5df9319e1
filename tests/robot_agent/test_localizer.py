"""The laws of a localizer: both of the package's own, and both sensor models of the position grid."""

import math

import numpy as np
import pytest

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Sighting
from robot_agent.config import RobotSection
from robot_agent.estimator import Estimator
from robot_agent.localizer import Localizer, TakesParts
from robot_agent.sensing import TickMotion
from tests.robot_agent.robots import sight_of

GRID = Grid((40, 36), 0.1, (-2.0, -1.8), "m")
STEP = TickMotion(0.13, 0.4, 0.5, 0.002, 0.001, 0.01)
MOVED = TickMotion(0.3, 0.5, 1.0, 0.0, 0.0, 0.0)  # in the second before a sighting
EXACT = np.zeros((2, 2))


SETTINGS = [
    RobotSection.model_validate(
        {
            "localizer": kind,
            "headings": 60,
            "vision": {"kind": vision, "outlier": 0.0, "frames": 1.0, "misread": 12.0, "gain": 1e-6, "floor": 0.1},
        }
    )
    for kind, vision in (("position", "position"), ("position", "range-bearing"), ("pose", "range-bearing"))
]
every = pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: f"{s.localizer}, {s.vision.kind}")


def at(settings: RobotSection, x: float, y: float, heading: float, sigma: float = 0.2) -> Localizer:
    localizer: Localizer = Estimator.begin(settings, GRID, "r1").localizer
    return localizer.update_with_fix(Fix(position=(x, y), sigma=sigma, heading=heading, heading_sigma=0.02))


def sighting(x: float, y: float, heading: float, place: tuple[float, float], age: float = 0.0) -> Sighting:
    """What a robot at (x, y, heading) measures of a place."""
    return sight_of((x, y, heading), "landmark/1", place, landmark=False, age=age)


@every
def test_at_first_nothing_is_known(settings: RobotSection) -> None:
    localizer: Localizer = Estimator.begin(settings, GRID, "r1").localizer
    assert localizer.marginal().p == pytest.approx(np.full(GRID.shape, 1 / GRID.size))
    bins = settings.headings if settings.localizer == "pose" else 1
    assert localizer.entropy() == pytest.approx(math.log(bins * GRID.size), rel=1e-4)


@every
def test_a_robot_drives_where_it_looks_after_its_turn(settings: RobotSection) -> None:
    """The oracle: an arc in many little steps."""
    localizer = at(settings, -0.8, -0.6, 0.3, 0.1)
    x, y, heading = -0.8, -0.6, 0.3
    for _ in range(5):
        compass = None if settings.localizer == "pose" else heading + 0.4 / 2  # the direction of the chord
        localizer = localizer.predict(TickMotion(0.2, 0.4, 0.5, 0.0, 0.0, 0.0), compass)
        for _ in range(100):
            heading += 0.004
            x, y = x + 0.002 * math.cos(heading), y + 0.002 * math.sin(heading)
    assert localizer.marginal().mean() == pytest.approx((x, y), abs=0.03)


@every
def test_noise_along_the_way_spreads_along_the_heading(settings: RobotSection) -> None:
    before = at(settings, 0.0, 0.0, math.pi / 2, 0.15)
    after = before.predict(
        TickMotion(0.0, 0.0, 1.0, 0.04, 0.01, 0.0), math.pi / 2 if settings.localizer != "pose" else None
    )
    spread = after.marginal().covariance() - before.marginal().covariance()
    assert spread == pytest.approx(np.array([[0.01, 0.0], [0.0, 0.04]]), abs=0.002)


@every
def test_noise_below_a_third_of_a_cell_waits_and_is_never_lost(settings: RobotSection) -> None:
    little, much = at(settings, 0.0, 0.0, 0.7), at(settings, 0.0, 0.0, 0.7)
    for _ in range(40):
        little = little.predict(TickMotion(0.0, 0.0, 1.0, 0.0011, 0.0004, 0.0), None)
    much = much.predict(TickMotion(0.0, 0.0, 40.0, 0.044, 0.016, 0.0), None)
    assert little.marginal().covariance() == pytest.approx(much.marginal().covariance(), abs=0.0025)


@every
def test_a_landmark_moves_the_belief_to_where_it_is_seen_from(settings: RobotSection) -> None:
    localizer = at(settings, 0.25, 0.25, 0.3)
    place = (1.55, 0.85)
    after = localizer.update_with_sighting(sighting(0.05, 0.15, 0.3, place), None, np.array(place), EXACT)
    assert after.marginal().mean() == pytest.approx((0.05, 0.15), abs=0.1)
    assert after.entropy() < localizer.entropy()


@every
def test_an_uncertain_landmark_counts_as_its_covariance_says(settings: RobotSection) -> None:
    """Uncertain across the line of sight in x only: x stays as it was, y is measured."""
    localizer = at(settings, 0.05, 0.05, 0.0)
    place, covariance = (0.05, 1.45), np.array([[25.0, 0.0], [0.0, 0.0]])
    measured = sighting(0.25, -0.15, 0.0, place)
    x, y = localizer.update_with_sighting(measured, None, np.array(place), covariance).marginal().mean()
    assert x == pytest.approx(0.05, abs=0.03)
    assert y < -0.03


@every
def test_the_sighting_of_a_tick_ago_counts_from_where_the_robot_was(settings: RobotSection) -> None:
    """It stood at the origin with heading 0 and saw; then it turned by 0.5 and drove 0.3 m."""
    place = (1.4, 0.6)
    there = (0.3 * math.cos(0.5), 0.3 * math.sin(0.5))
    localizer = at(settings, *there, 0.5, 0.3)
    measured = sighting(0.0, 0.0, 0.0, place, age=1.0)
    after = localizer.update_with_sighting(measured, MOVED, np.array(place), EXACT)
    assert after.marginal().mean() == pytest.approx(there, abs=0.07)
    assert localizer.project(measured, MOVED).mean() == pytest.approx(place, abs=0.08)
    half = sighting(there[0] / 2, there[1] / 2, 0.25, place, age=0.5)
    assert localizer.project(half, MOVED).mean() == pytest.approx(place, abs=0.08)


ANCHORS = [(1.4, 0.6), (-1.5, 1.2), (-0.4, -1.6)]


def taking_parts(localizer: Localizer) -> TakesParts:
    assert isinstance(localizer, TakesParts)
    return localizer


def part(kind: str, there: tuple[float, float, float], place: tuple[float, float], age: float = 0.0) -> Seen:
    """A range or a bearing alone that a robot there measures of a place."""
    measured = sighting(*there, place)
    value, sigma = (measured.range, 0.05) if kind == "range" else (measured.bearing, 0.03)
    return Seen(subject="landmark/1", kind=kind, values=(value,), covariance=(sigma**2,), landmark=place, age=age)


@every
@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_ranges_or_bearings_alone_of_three_known_points_tell_the_place(settings: RobotSection, kind: str) -> None:
    """Nothing but the heading is known before."""
    localizer = taking_parts(at(settings, 0.0, 0.0, 0.4, sigma=50.0))
    for place in ANCHORS:
        localizer = localizer.update_with_part(part(kind, (0.35, -0.25, 0.4), place), None, np.array(place), EXACT)
    assert localizer.marginal().mean() == pytest.approx((0.35, -0.25), abs=0.1)
    assert math.sqrt(np.trace(localizer.marginal().covariance())) < 0.2


@every
def test_one_range_alone_leaves_a_ring(settings: RobotSection) -> None:
    localizer = taking_parts(Estimator.begin(settings, GRID, "r1").localizer)
    localizer = localizer.update_with_part(
        part("range", (0.0, 0.0, 0.0), (1.0, 0.0)), None, np.array([1.0, 0.0]), EXACT
    )
    p = localizer.marginal().p
    x, y = GRID.mesh()
    off = np.abs(np.hypot(x - 1.0, y) - 1.0)
    assert p[off < 0.2].sum() > 0.95
    assert p[off < 0.05].min() > 0.2 * p.max()


@every
def test_a_range_to_an_uncertain_place_counts_as_its_covariance_says(settings: RobotSection) -> None:
    """The place is straight ahead in y. Uncertain in x only, the range measures y; uncertain in y only, it hardly does."""
    localizer = taking_parts(at(settings, 0.05, 0.05, 0.0))
    place = (0.05, 1.45)
    measured = part("range", (0.05, -0.15, 0.0), place)

    def y(covariance: list[float]) -> float:
        after = localizer.update_with_part(measured, None, np.array(place), np.diag(covariance))
        return float(after.marginal().mean()[1])

    assert y([0.3, 0.0]) == pytest.approx(-0.13, abs=0.04)
    assert y([0.0, 0.3]) == pytest.approx(0.03, abs=0.04)


@every
@pytest.mark.parametrize(("kind", "least"), [("sighting", 0.5), ("range", 0.2), ("bearing", 0.2)])
def test_a_vaguer_place_says_less(settings: RobotSection, kind: str, least: float) -> None:
    localizer = taking_parts(at(settings, 0.25, 0.25, 0.3))
    place, there = (1.55, 0.85), (0.05, 0.15, 0.3)

    def entropy_after(variance: float) -> float:
        about = None, np.array(place), np.eye(2) * variance
        if kind == "sighting":
            return localizer.update_with_sighting(sighting(*there, place), *about).entropy()
        return localizer.update_with_part(part(kind, there, place), *about).entropy()

    entropies = [entropy_after(variance) for variance in (0.0, 0.05, 0.5, 50.0)]
    assert entropies == sorted(entropies)
    assert entropies[-1] - entropies[0] > least


@every
def test_a_range_of_a_tick_ago_counts_from_where_the_robot_was(settings: RobotSection) -> None:
    there = (0.3 * math.cos(0.5), 0.3 * math.sin(0.5))
    localizer = taking_parts(at(settings, *there, 0.5, 0.3))
    for place in ANCHORS:
        localizer = localizer.update_with_part(
            part("range", (0.0, 0.0, 0.0), place, age=1.0), MOVED, np.array(place), EXACT
        )
    assert localizer.marginal().mean() == pytest.approx(there, abs=0.07)


@every
def test_a_belief_stays_a_belief(settings: RobotSection) -> None:
    localizer = at(settings, 1.7, 1.5, 0.4)
    for k in range(8):  # out of the grid
        localizer = localizer.predict(STEP, 0.4 if settings.localizer != "pose" else None)
        measured = sighting(1.0, 1.0, 0.4, (0.1, 0.1))
        localizer = localizer.update_with_sighting(measured, STEP, np.array((0.1, 0.1)), EXACT) if k % 2 else localizer
        for belief in (localizer.marginal(), localizer.project(measured, STEP)):
            assert belief.p.sum() == pytest.approx(1.0)
            assert belief.p.min() >= 0
        assert math.isfinite(localizer.entropy())


@every
def test_folding_what_was_reported_changes_nothing_and_what_was_agreed_is_taken_over(settings: RobotSection) -> None:
    localizer = at(settings, 0.1, 0.2, 0.3).predict(STEP, None)
    reported = localizer.marginal()
    assert localizer.fold(reported, reported).marginal().p == pytest.approx(reported.p, abs=1e-15)
    agreed = gaussian(GRID, reported.mean() + 0.1, 0.15)
    assert np.abs(localizer.fold(agreed, reported).marginal().p - agreed.p).sum() < 0.1  # but for interpolation


@every
def test_folding_what_the_robot_ruled_out_starts_again_there(settings: RobotSection) -> None:
    localizer = at(settings, -1.5, -1.3, 0.3, 0.05).predict(STEP, None)
    agreed = gaussian(GRID, (1.2, 1.1), 0.1)
    after = localizer.fold(agreed, localizer.marginal())
    assert after.marginal().p == pytest.approx(agreed.p, abs=1e-6)
    assert entropy(after.marginal().p) == pytest.approx(entropy(agreed.p), rel=1e-3)
    moved = after.predict(TickMotion(0.2, 0.0, 1.0, 0.0, 0.0, 0.0), None)
    direction = math.atan2(*(moved.marginal().mean() - agreed.mean())[::-1])
    assert direction == pytest.approx(0.3 + STEP.turn, abs=0.1)  # the heading is kept


@every
def test_a_fix_where_the_robot_is_not_replaces_its_belief(settings: RobotSection) -> None:
    localizer = at(settings, -1.5, -1.3, 0.3, 0.01)
    after = localizer.update_with_fix(Fix(position=(1.5, 1.3), sigma=0.01, heading=0.3, heading_sigma=0.02))
    assert after.marginal().mean() == pytest.approx((1.5, 1.3), abs=0.06)
