"""The estimator: objects, team-mates as landmarks, and whose information is in it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, blur, gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting
from robot_agent.config import RobotSection
from robot_agent.estimator import CONTRADICTION, SPLIT_WEIGHTS, VAGUE, Estimator, Mate, combined, newest

GRID = Grid((30, 30))
NOISE = 0.6  # cells, of a seen position at any distance
SETTINGS = RobotSection.model_validate(
    {"vision": {"gain": 1e-6, "floor": NOISE, "outlier": 0.0, "misread": 30.0}, "objects": {"drift": 0.5}}
)
BALL = Sighting(subject="object/ball", range=6.0, bearing=0.0)
MATE = Sighting(subject="robot/r2", range=6.0, bearing=0.0)


def readings(
    tick: int, *sightings: Sighting, fix: Fix | None = None, distance: float | None = None, dt: float = 0.5
) -> Readings:
    odometry = None if distance is None else Odometry(distance=distance, turn=0.0, dt=dt)
    return Readings(
        run="x",
        robot="r1",
        tick=tick,
        time=0.5 * tick,
        odometry=odometry,
        compass=0.0,
        fix=fix,
        sightings=list(sightings),
    )


def begun(*sightings: Sighting, sigma: float = 1.5, settings: RobotSection = SETTINGS) -> Estimator:
    """r1 at about (10, 15), looking along x."""
    fix = Fix(position=(10.0, 15.0), sigma=sigma)
    return Estimator.begin(settings, GRID, "r1").advance(readings(0, *sightings, fix=fix))


def mate(variance: float, *ancestors: str, mean: tuple[float, float] = (16.0, 15.0)) -> dict[str, Mate]:
    return {"robot/r2": Mate(np.array(mean), np.eye(2) * variance, dict.fromkeys(ancestors, 0.0))}


# --- objects ---------------------------------------------------------------------------------------------------------


def test_an_object_and_a_mate_are_projected_and_landmarks_and_the_robot_itself_are_not() -> None:
    landmark = Sighting(subject="landmark/6", range=6.0, bearing=0.0, landmark=(16.0, 15.0))
    it = begun(BALL, MATE, landmark, Sighting(subject="robot/r1", range=3.0, bearing=0.0))
    assert (set(it.objects), set(it.seen)) == ({"object/ball"}, {"robot/r2"})
    assert it.objects["object/ball"].mean() == pytest.approx((16, 15), abs=0.1)
    assert it.advance(readings(1)).seen == {}  # a mate moves: what was seen counts in its tick only
    assert set(it.advance(readings(1)).objects) == {"object/ball"}


def test_a_landmark_is_used_before_what_else_was_seen_is_projected() -> None:
    landmark = Sighting(subject="landmark/6", range=6.0, bearing=0.0, landmark=(17.0, 15.0))
    assert begun(BALL, landmark, sigma=3.0).objects["object/ball"].mean()[0] == pytest.approx(17.0, abs=0.2)


def test_the_last_sighting_of_each_subject_counts() -> None:
    assert newest([BALL, MATE, BALL.model_copy(update={"range": 5.0})]) == [
        BALL.model_copy(update={"range": 5.0}),
        MATE,
    ]


def test_an_object_drifts_with_the_square_root_of_time_however_short_the_ticks() -> None:
    it = begun(BALL)
    before = it.objects["object/ball"]
    for tick in range(1, 41):
        it = it.advance(readings(tick, distance=0.0, dt=0.1))
    expected = blur(before.p, 0.5 * math.sqrt(4.0))
    after = it.objects["object/ball"]
    pending = it.pending_variance
    assert Belief(GRID, blur(after.p, math.sqrt(pending))).p == pytest.approx(expected, abs=1e-9)
    assert pending <= 1 / 9


def test_nothing_drifts_while_no_time_passes() -> None:
    it = begun(BALL)
    assert it.advance(readings(1)).objects["object/ball"] is it.objects["object/ball"]


@pytest.mark.parametrize(("forget", "kept"), [(0.9, False), (0.999, True)])
def test_a_belief_that_became_nearly_uniform_is_dropped(forget: float, kept: bool) -> None:
    settings = SETTINGS.model_copy(update={"objects": SETTINGS.objects.model_copy(update={"forget": forget})})
    it = begun(BALL, settings=settings).advance(readings(1, distance=0.0, dt=400.0))
    assert ("object/ball" in it.objects) == kept
    most = blur(begun(BALL).objects["object/ball"].p, 0.5 * math.sqrt(400.0))
    assert 0.9 * math.log(900) < entropy(most) < 0.999 * math.log(900)


# --- a tracked object and a new sighting of it -----------------------------------------------------------------------


def test_the_first_sighting_is_taken_as_it_is() -> None:
    seen = gaussian(GRID, (10, 10), 1.0)
    assert combined(None, seen, 0.1) is seen


def test_of_two_that_agree_the_geometric_mean_of_least_entropy_is_taken() -> None:
    tracked, seen = gaussian(GRID, (10, 10), (1.0, 3.0)), gaussian(GRID, (10.5, 10), (3.0, 1.0))
    expected, w = chernoff(tracked.p, seen.p)
    assert 0 < w < 1
    assert combined(tracked, seen, 0.5).p == pytest.approx(expected)


def test_a_sharper_tracked_belief_learns_the_new_share_of_a_sighting() -> None:
    tracked, seen = gaussian(GRID, (10, 10), 1.0), gaussian(GRID, (11, 10), 4.0)
    expected = tracked.p * seen.p**0.3
    assert combined(tracked, seen, 0.3).p == pytest.approx(expected / expected.sum())
    assert combined(tracked, seen, 0.0).p == pytest.approx(tracked.p)


def test_a_sharper_sighting_replaces_the_tracked_belief() -> None:
    tracked, seen = gaussian(GRID, (10, 10), 4.0), gaussian(GRID, (11, 10), 1.0)
    assert combined(tracked, seen, 0.3).p == pytest.approx(seen.p)


@pytest.mark.parametrize(("apart", "both"), [(6.4, True), (5.6, False)])
def test_of_two_that_contradict_each_other_both_are_kept(apart: float, both: bool) -> None:
    """Two Gaussians of sigma 1 have the coefficient exp(-d^2 / 8): 0.01 at d = 6.07."""
    tracked, seen = gaussian(GRID, (10, 10), 1.0), gaussian(GRID, (10 + apart, 10), 1.0)
    assert (math.exp(-(apart**2) / 8) < CONTRADICTION) == both
    mean = 0.5 * (tracked.p + seen.p)
    found = combined(tracked, seen, 0.0).p
    assert found.sum() == pytest.approx(1.0)
    assert (np.abs(found - mean).max() < 1e-12) == both


# --- team-mates as landmarks -----------------------------------------------------------------------------------------


def variance_after(mates: Mapping[str, Mate], sigma: float = 1.5) -> float:
    """Of the robot's x, once it has seen r2 where the mates say."""
    after = begun(sigma=sigma).advance(readings(1, MATE), mates)
    return float(after.localizer.marginal().covariance()[0, 0])


def test_a_mate_with_other_evidence_counts_in_full() -> None:
    own = float(begun().localizer.marginal().covariance()[0, 0])
    expected = 1 / (1 / own + 1 / (0.5 + NOISE**2))
    assert variance_after(mate(0.5, "r2")) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("variance", [0.02, 0.2, 1.0])
def test_a_mate_that_may_hold_the_robots_own_evidence_counts_by_split_covariance_intersection(variance: float) -> None:
    """Gaussians: 1 / var = w / own + 1 / (mate's / (1 - w) + noise), with the w of the least variance; w = 1 is own."""
    own = float(begun().localizer.marginal().covariance()[0, 0])
    options = [own] + [1 / (w / own + 1 / (variance / (1 - w) + NOISE**2)) for w in SPLIT_WEIGHTS]
    assert variance_after(mate(variance, "r1", "r2")) == pytest.approx(min(options), rel=0.03)


def test_a_mate_that_knows_less_than_the_robot_is_no_help_where_it_may_hold_its_evidence() -> None:
    it = begun()
    after = it.advance(readings(1, MATE), mate(30.0, "r1"))
    assert np.allclose(after.localizer.marginal().p, it.localizer.marginal().p)


@pytest.mark.parametrize(("deviation", "used"), [(1.01 * VAGUE, False), (0.99 * VAGUE, True)])
def test_a_vague_mate_is_no_landmark(deviation: float, used: bool) -> None:
    """The standard deviation of both axes together: the root of the trace."""
    after = begun().advance(readings(1, MATE), mate(deviation**2 / 2, "r2"))
    assert ("r2" in after.ancestors) == used


def test_the_evidence_of_a_mate_that_was_used_is_in_it_from_then_on() -> None:
    it = begun().advance(readings(1, MATE), mate(0.5, "r2", "r3"))
    assert it.ancestors == {"r1": 0.5, "r2": 0.0, "r3": 0.0}
    unseen = begun().advance(readings(1, BALL), mate(0.5, "r2"))
    assert unseen.ancestors == {"r1": 0.5}


# --- folding back ----------------------------------------------------------------------------------------------------


def test_folding_keeps_the_latest_time_of_each_source() -> None:
    it = begun().folded(gaussian(GRID, (10, 15), 1.0), None, {"r1": -1.0, "r2": 3.0})
    assert it.ancestors == {"r1": 0.0, "r2": 3.0}
    assert it.folded(gaussian(GRID, (10, 15), 1.0), None, {"r2": 2.0, "r1": 5.0}).ancestors == {"r1": 5.0, "r2": 3.0}


def test_folding_divides_by_what_was_reported() -> None:
    """Reported at 10 with variance v, agreed at 11: who has moved on to 12 since is at 13 now."""
    it = begun()
    agreed = gaussian(GRID, (11, 15), 1.5)
    assert it.folded(agreed, None, {}).localizer.marginal().mean()[0] == pytest.approx(11.0, abs=0.05)
    reported = gaussian(GRID, (11, 15), 1.5)
    assert it.folded(agreed, reported, {}).localizer.marginal().mean()[0] == pytest.approx(10.0, abs=0.05)
