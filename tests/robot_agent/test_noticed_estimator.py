"""An estimator's signs, factors and limits against exact expectations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from blackboard.opinion.belief import Belief, blur, gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.weights import entropy
from blackboard.wire.messages import Fix, Odometry, Readings, Sighting
from robot_agent.config import RobotSection
from robot_agent.estimator import Estimator, Mate, combined
from tests.robot_agent.test_noticed_position import CAMERA, GRID, PLACE, STILL, localizer


def bump(x: float, y: float, sigma: float) -> Belief:
    return gaussian(GRID, (x, y), sigma)


def test_two_hypotheses_that_contradict_each_other_count_half_each() -> None:
    tracked, seen = bump(-2, 3, 0.4), bump(7, 9, 0.4)
    assert combined(tracked, seen, 0.04).p == pytest.approx((tracked.p + seen.p) / 2)


def test_a_vaguer_sighting_of_a_tracked_object_counts_by_its_new_share() -> None:
    tracked, seen = bump(2, 5, 0.6), bump(2.5, 5, 2.0)
    expected = tracked.p * seen.p**0.04
    assert combined(tracked, seen, 0.04).p == pytest.approx(expected / expected.sum())


def test_a_sharper_sighting_is_pooled_by_the_least_entropy() -> None:
    tracked, seen = bump(2, 5, 2.0), bump(2.5, 5, 0.6)
    assert combined(tracked, seen, 0.04).p == pytest.approx(chernoff(tracked.p, seen.p)[0])
    assert combined(None, seen, 0.04) is seen


def estimator(**settings: object) -> Estimator:
    tables = {"vision": {**CAMERA, "outlier": 0.01}, "objects": {"drift": 0.4}, **settings}
    begun = Estimator.begin(RobotSection.model_validate(tables), GRID, "r1")
    return replace(begun, localizer=localizer(bump(0.5, 5.5, 1.2), heading=0.0, vision=tables["vision"]))  # type: ignore[arg-type]


def readings(
    tick: int, *sightings: Sighting, distance: float = 0.0, fix: tuple[float, float] | None = None
) -> Readings:
    return Readings(
        run="x",
        robot="r1",
        tick=tick,
        time=0.5 * tick,
        odometry=Odometry(distance=distance, turn=0.0, dt=0.5) if tick else None,
        compass=0.0,
        fix=None if fix is None else Fix(position=fix, sigma=0.5),
        sightings=list(sightings),
    )


MATE = Sighting(subject="robot/r2", range=3.5, bearing=0.3)


def belief_after(ancestors: dict[str, float], covariance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    mate = Mate(PLACE, covariance, ancestors)
    return estimator().advance(readings(0, MATE), {"robot/r2": mate}).localizer.marginal().p


def test_a_mate_of_independent_origin_is_a_landmark() -> None:
    covariance = np.array([[0.4, 0.1], [0.1, 0.3]])
    before = estimator().localizer.predict(STILL, 0.0)
    expected = before.update_with_sighting(MATE, None, PLACE, covariance).marginal().p
    assert belief_after({"r2": 0.0}, covariance) == pytest.approx(expected)


@pytest.mark.parametrize("variance", [0.05, 0.6, 3.0])
def test_a_mate_that_may_hold_the_robots_own_evidence_is_split_by_the_least_entropy(variance: float) -> None:
    """Split covariance intersection: the own belief to the power w, the mate's covariance divided by 1 - w."""
    covariance = variance * np.eye(2)
    own = estimator().localizer.predict(STILL, 0.0)
    options = [own]
    for w in (0.95, 0.8, 0.5, 0.2):
        options.append(own.tempered(w).update_with_sighting(MATE, None, PLACE, covariance / (1.0 - w)))
    expected = min(options, key=lambda option: option.entropy())
    assert (expected is own) == (variance > 1.0)  # so vague a mate may only repeat what the robot knows
    assert belief_after({"r1": 0.0, "r2": 0.0}, covariance) == pytest.approx(expected.marginal().p)


@pytest.mark.parametrize(("sigma", "used"), [(4.9, True), (5.1, False)])
def test_a_mate_less_certain_than_ten_cells_is_no_landmark(sigma: float, used: bool) -> None:
    """The standard deviation is that of both axes together: 10 cells of 0.5 m."""
    alone = estimator().advance(readings(0)).localizer.marginal().p
    after = belief_after({"r2": 0.0}, np.diag([sigma**2 / 2, sigma**2 / 2]))
    assert (np.abs(after - alone).max() > 1e-6) == used


def test_a_landmark_mate_hands_its_ancestors_on_but_no_later_time_of_ours() -> None:
    mate = Mate(PLACE, 0.1 * np.eye(2), {"r1": 9.0, "r2": 3.0})
    after = estimator().advance(readings(2, MATE), {"robot/r2": mate})
    assert after.ancestors == {"r1": 1.0, "r2": 3.0}


def test_an_object_drifts_by_its_variance_whenever_it_is_blurred() -> None:
    ball = bump(3.0, 6.0, 0.6)
    it = replace(estimator(), objects={"object/ball": ball})
    for tick in range(1, 5):
        it = it.advance(readings(tick))
    grown = it.objects["object/ball"].covariance() - ball.covariance()
    pending = it.pending_variance
    assert np.diag(grown) + pending == pytest.approx(4 * 0.5 * 0.4**2, rel=0.02)
    assert pending <= (0.5 / 3) ** 2


def test_a_drift_below_a_third_of_a_cell_waits() -> None:
    third = (0.5 / 3) ** 2
    ball = bump(3.0, 6.0, 0.6)
    for share, blurred in ((0.99, False), (1.01, True)):
        drift = math.sqrt(share * third / 0.5)
        it = replace(estimator(objects={"drift": drift}), objects={"object/ball": ball}).advance(readings(1))
        assert (it.objects["object/ball"] is not ball) == blurred
        assert it.pending_variance == pytest.approx(0.0 if blurred else share * third)
    assert it.objects["object/ball"].p == pytest.approx(blur(ball.p, math.sqrt(1.01 * third) / 0.5))


@pytest.mark.parametrize("forget", [0.7, 0.9])
def test_an_object_is_forgotten_once_its_entropy_exceeds_its_share_of_ln_m(forget: float) -> None:
    it = estimator(objects={"drift": 1.0, "forget": forget})
    most = forget * math.log(GRID.size)
    kept, lost = (gaussian(GRID, (3.0, 6.0), s) for s in _sigmas(most))
    after = replace(it, objects={"object/kept": kept, "object/lost": lost}).advance(readings(1))
    assert set(after.objects) == {"object/kept"}


def _sigmas(most: float) -> tuple[float, float]:
    """Two sigmas (m) for which a Gaussian has less and more entropy than `most`, after a drift of 0.7 m."""
    found = [s for s in np.arange(0.2, 9.0, 0.05) if entropy(blur(bump(3.0, 6.0, s).p, math.sqrt(0.5) / 0.5)) < most]
    return found[-1], found[-1] + 0.1


def test_what_is_seen_becomes_an_object_or_a_mate_but_never_a_landmark_or_oneself() -> None:
    sightings = [
        Sighting(subject="landmark/l1", range=3.0, bearing=0.1, landmark=(4.0, 6.0)),
        Sighting(subject="robot/r1", range=3.0, bearing=0.1),
        Sighting(subject="robot/r2", range=3.0, bearing=0.1),
        Sighting(subject="object/ball", range=3.0, bearing=2.0),
        Sighting(subject="object/ball", range=2.0, bearing=0.1),
    ]
    after = estimator().advance(readings(0, *sightings))
    assert set(after.objects) == {"object/ball"}
    assert set(after.seen) == {"robot/r2"}
    assert after.objects["object/ball"].p == pytest.approx(after.localizer.project(sightings[-1], None).p)  # the newest
    assert after.advance(readings(1)).seen == {}


def test_folding_keeps_the_latest_time_of_each_ancestor() -> None:
    it = replace(estimator(), ancestors={"r1": 4.0, "r2": 1.0})
    after = it.folded(bump(1.0, 5.5, 0.8), None, {"r2": 3.0, "r1": 2.0, "r3": 5.0})
    assert after.ancestors == {"r1": 4.0, "r2": 3.0, "r3": 5.0}


def test_a_mate_of_unknown_place_does_not_hide_the_next() -> None:
    stranger = Sighting(subject="robot/r9", range=2.0, bearing=-0.5)
    mate = Mate(PLACE, 0.2 * np.eye(2), {"r2": 0.0})
    alone = estimator().advance(readings(0, MATE), {"robot/r2": mate}).localizer.marginal().p
    both = estimator().advance(readings(0, stranger, MATE), {"robot/r2": mate}).localizer.marginal().p
    assert both == pytest.approx(alone, abs=1e-12)
