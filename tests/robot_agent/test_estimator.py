"""The estimator: objects, team-mates as landmarks, and whose information is in it."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt
import pytest

from blackboard.opinion.belief import Belief, blur, gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Sighting
from robot_agent.config import RobotSection
from robot_agent.estimator import CONTRADICTION, Estimator, Mate, combined, newest
from tests.robot_agent.robots import BALL, CAMERA, FINE, STILL, position_localizer
from tests.robot_agent.robots import readings as driven

GRID = FINE
PLACE = np.array([4.0, 7.0])
MATE = Sighting(subject="robot/r2", range=3.5, bearing=0.3)
readings = partial(driven, distance=0.0)


def bump(x: float, y: float, sigma: float) -> Belief:
    return gaussian(GRID, (x, y), sigma)


def new_estimator(*, sigma: float = 1.2, **settings: object) -> Estimator:
    """r1 at about (0.5, 5.5) m, looking along x."""
    tables = {"vision": {**CAMERA, "outlier": 0.01}, "objects": {"drift": 0.4}, **settings}
    begun = Estimator.begin(RobotSection.model_validate(tables), GRID, "r1")
    return replace(begun, localizer=position_localizer(bump(0.5, 5.5, sigma), vision=tables["vision"]))  # type: ignore[arg-type]


def with_ball(ball: Belief, **settings: object) -> Estimator:
    return replace(new_estimator(**settings), objects={"object/ball": ball})  # type: ignore[arg-type]


# --- objects ---------------------------------------------------------------------------------------------------------


def test_what_is_seen_becomes_an_object_or_a_mate_but_never_a_landmark_or_oneself() -> None:
    sightings = [
        Sighting(subject="landmark/l1", range=3.0, bearing=0.1, landmark=(4.0, 6.0)),
        Sighting(subject="robot/r1", range=3.0, bearing=0.1),
        Sighting(subject="robot/r2", range=3.0, bearing=0.1),
        Sighting(subject="object/ball", range=3.0, bearing=2.0),
        Sighting(subject="object/ball", range=2.0, bearing=0.1),
    ]
    after = new_estimator().advance(readings(0, *sightings))
    assert set(after.objects) == {"object/ball"}
    assert set(after.seen) == {"robot/r2"}
    assert after.objects["object/ball"].p == pytest.approx(after.localizer.project(sightings[-1], None).p)  # the newest
    assert after.advance(readings(1)).seen == {}


def test_a_landmark_is_used_before_what_else_was_seen_is_projected() -> None:
    landmark = Sighting(subject="landmark/6", range=3.0, bearing=0.0, landmark=(4.5, 5.5))
    ball = new_estimator(sigma=3.0).advance(readings(0, BALL, landmark)).objects["object/ball"]
    assert ball.mean()[0] == pytest.approx(1.5 + 5.0 * math.cos(0.3), abs=0.3)


def test_the_last_sighting_of_each_subject_counts() -> None:
    assert newest([BALL, MATE, BALL.model_copy(update={"range": 5.0})]) == [
        BALL.model_copy(update={"range": 5.0}),
        MATE,
    ]


def test_an_object_drifts_with_the_square_root_of_time_however_short_the_ticks() -> None:
    ball = bump(3.0, 6.0, 0.6)
    estimator = with_ball(ball)
    for tick in range(1, 41):
        estimator = estimator.advance(readings(tick, dt=0.1))
    belief = Belief(GRID, blur(estimator.objects["object/ball"].p, math.sqrt(estimator.pending_variance) / GRID.cell))
    assert belief.p == pytest.approx(blur(ball.p, 0.4 * math.sqrt(4.0) / GRID.cell), abs=1e-9)
    assert estimator.pending_variance <= (GRID.cell / 3) ** 2


def test_nothing_drifts_while_no_time_passes() -> None:
    ball = bump(3.0, 6.0, 0.6)
    assert with_ball(ball).advance(readings(1, distance=None)).objects["object/ball"] is ball


def test_a_drift_below_a_third_of_a_cell_waits() -> None:
    third = (0.5 / 3) ** 2
    ball = bump(3.0, 6.0, 0.6)
    for share, blurred in ((0.99, False), (1.01, True)):
        drift = math.sqrt(share * third / 0.5)
        estimator = with_ball(ball, objects={"drift": drift}).advance(readings(1))
        assert (estimator.objects["object/ball"] is not ball) == blurred
        assert estimator.pending_variance == pytest.approx(0.0 if blurred else share * third)
    assert estimator.objects["object/ball"].p == pytest.approx(blur(ball.p, math.sqrt(1.01 * third) / 0.5))


@pytest.mark.parametrize("forget", [0.7, 0.9])
def test_an_object_is_forgotten_once_its_entropy_exceeds_its_share_of_ln_m(forget: float) -> None:
    estimator = new_estimator(objects={"drift": 1.0, "forget": forget})
    most = forget * math.log(GRID.size)
    kept, lost = (gaussian(GRID, (3.0, 6.0), s) for s in _sigmas(most))
    after = replace(estimator, objects={"object/kept": kept, "object/lost": lost}).advance(readings(1))
    assert set(after.objects) == {"object/kept"}


def _sigmas(most: float) -> tuple[float, float]:
    """Two sigmas (m) for which a Gaussian has less and more entropy than `most`, after a drift of 0.7 m."""
    sigmas = [s for s in np.arange(0.2, 9.0, 0.05) if entropy(blur(bump(3.0, 6.0, s).p, math.sqrt(0.5) / 0.5)) < most]
    return sigmas[-1], sigmas[-1] + 0.1


# --- a tracked object and a new sighting of it -----------------------------------------------------------------------


def test_the_first_sighting_is_taken_as_it_is() -> None:
    sighted = gaussian(GRID, (2, 6), 0.5)
    assert combined(None, sighted, 0.1) is sighted


def test_of_two_that_agree_the_geometric_mean_of_least_entropy_is_taken() -> None:
    tracked, sighted = gaussian(GRID, (2, 6), (0.5, 1.5)), gaussian(GRID, (2.25, 6), (1.5, 0.5))
    expected, w = chernoff(tracked.p, sighted.p)
    assert 0 < w < 1
    assert combined(tracked, sighted, 0.5).p == pytest.approx(expected)


def test_a_sharper_tracked_belief_learns_the_new_share_of_a_sighting() -> None:
    tracked, sighted = gaussian(GRID, (2, 6), 0.5), gaussian(GRID, (2.5, 6), 2.0)
    expected = tracked.p * sighted.p**0.3
    assert combined(tracked, sighted, 0.3).p == pytest.approx(expected / expected.sum())
    assert combined(tracked, sighted, 0.0).p == pytest.approx(tracked.p)


def test_a_sharper_sighting_replaces_the_tracked_belief() -> None:
    tracked, sighted = gaussian(GRID, (2, 6), 2.0), gaussian(GRID, (2.5, 6), 0.5)
    assert combined(tracked, sighted, 0.3).p == pytest.approx(sighted.p)


@pytest.mark.parametrize(("apart", "both"), [(6.4, True), (5.6, False)])
def test_of_two_that_contradict_each_other_both_are_kept(apart: float, both: bool) -> None:
    """Two Gaussians that are `apart` sigmas apart have the coefficient exp(-d^2 / 8): 0.01 at d = 6.07."""
    tracked, sighted = gaussian(GRID, (2, 6), 0.5), gaussian(GRID, (2 + apart / 2, 6), 0.5)
    assert (math.exp(-(apart**2) / 8) < CONTRADICTION) == both
    mean = 0.5 * (tracked.p + sighted.p)
    p = combined(tracked, sighted, 0.0).p
    assert p.sum() == pytest.approx(1.0)
    assert (np.abs(p - mean).max() < 1e-12) == both


# --- team-mates as landmarks -----------------------------------------------------------------------------------------


def belief_after(ancestors: dict[str, float], covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    mate = Mate(PLACE, covariance, ancestors)
    return new_estimator().advance(readings(0, MATE), {"robot/r2": mate}).localizer.marginal().p


def test_a_mate_of_independent_origin_is_a_landmark() -> None:
    covariance = np.array([[0.4, 0.1], [0.1, 0.3]])
    before = new_estimator().localizer.predict(STILL, 0.0)
    expected = before.update_with_sighting(MATE, None, PLACE, covariance).marginal().p
    assert belief_after({"r2": 0.0}, covariance) == pytest.approx(expected)


@pytest.mark.parametrize("variance", [0.05, 0.6, 3.0])
def test_a_mate_that_may_hold_the_robots_own_evidence_is_split_by_the_least_entropy(variance: float) -> None:
    """Split covariance intersection: the own belief to the power w, the mate's covariance divided by 1 - w."""
    covariance = variance * np.eye(2)
    own = new_estimator().localizer.predict(STILL, 0.0)
    options = [own]
    for w in (0.95, 0.8, 0.5, 0.2):
        options.append(own.tempered(w).update_with_sighting(MATE, None, PLACE, covariance / (1.0 - w)))
    expected = min(options, key=lambda option: option.entropy())
    assert (expected is own) == (variance > 1.0)  # so vague a mate may only repeat what the robot knows
    assert belief_after({"r1": 0.0, "r2": 0.0}, covariance) == pytest.approx(expected.marginal().p)


@pytest.mark.parametrize(("sigma", "used"), [(4.9, True), (5.1, False)])
def test_a_mate_less_certain_than_ten_cells_is_no_landmark(sigma: float, used: bool) -> None:
    """The standard deviation is that of both axes together: 10 cells of 0.5 m."""
    alone = new_estimator().advance(readings(0)).localizer.marginal().p
    after = belief_after({"r2": 0.0}, np.diag([sigma**2 / 2, sigma**2 / 2]))
    assert (np.abs(after - alone).max() > 1e-6) == used


def test_a_mate_of_unknown_place_does_not_hide_the_next() -> None:
    stranger = Sighting(subject="robot/r9", range=2.0, bearing=-0.5)
    mate = Mate(PLACE, 0.2 * np.eye(2), {"r2": 0.0})
    alone = new_estimator().advance(readings(0, MATE), {"robot/r2": mate}).localizer.marginal().p
    both = new_estimator().advance(readings(0, stranger, MATE), {"robot/r2": mate}).localizer.marginal().p
    assert both == pytest.approx(alone, abs=1e-12)


def test_the_evidence_of_a_mate_that_was_used_is_in_it_from_then_on() -> None:
    """But no later time of the robot's own than that of its readings."""
    mate = {"robot/r2": Mate(PLACE, 0.1 * np.eye(2), {"r1": 9.0, "r2": 3.0})}
    assert new_estimator().advance(readings(2, MATE), mate).ancestors == {"r1": 1.0, "r2": 3.0}
    assert new_estimator().advance(readings(2, BALL), mate).ancestors == {"r1": 1.0}


# --- folding back ----------------------------------------------------------------------------------------------------


def test_folding_keeps_the_latest_time_of_each_ancestor() -> None:
    estimator = replace(new_estimator(), ancestors={"r1": 4.0, "r2": 1.0})
    after = estimator.folded(bump(1.0, 5.5, 0.8), None, {"r2": 3.0, "r1": 2.0, "r3": 5.0})
    assert after.ancestors == {"r1": 4.0, "r2": 3.0, "r3": 5.0}


def test_folding_divides_by_what_was_reported() -> None:
    """If the robot has moved on by some distance since its report, it is that distance from what was agreed."""
    estimator, agreed = new_estimator(sigma=0.8), bump(1.0, 5.5, 0.8)
    assert estimator.folded(agreed, None, {}).localizer.marginal().mean()[0] == pytest.approx(1.0, abs=0.03)
    assert estimator.folded(agreed, agreed, {}).localizer.marginal().mean()[0] == pytest.approx(0.5, abs=0.03)
