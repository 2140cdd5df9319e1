"""Cameras of one make: what robots that see landmarks found of their noise says it of others, against an exact Gaussian."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.cameras import MOST, UNKNOWN, CameraFound, Found, by_mates, scaled
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Bias, Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import Motion, Nuisance, entering

MODEL = (0.03, 0.07, 0.02)
NUISANCE = Nuisance(1.0, 1.0, (0.15, 0.1, 0.003), alike=0.9)
MEASURED = st.tuples(st.floats(-MOST, MOST), st.floats(0.05, 100.0))  # a value, and the variance of its error


def found(value: float, variance: float) -> Found:
    """What a robot believes that began with 0 and 1, and has measured this."""
    return value / (1 + variance), (variance / (1 + variance)) ** 0.5


def with_the_make(measured: list[tuple[float, float]], alike: float) -> float:
    """The mean of the first robot's logarithm, by all that was measured: the make's logarithm is a state of its own."""
    number = len(measured)
    covariance = alike * np.ones((number, number)) + (1 - alike) * np.eye(number)
    values, noise = np.array(measured).T
    return float(covariance[0] @ np.linalg.solve(covariance + np.diag(noise), values))


@given(own=MEASURED, mates=st.lists(MEASURED, min_size=1, max_size=5), alike=st.floats(0.01, 0.99))
def test_a_factor_is_what_it_is_with_the_make_as_a_state(
    own: tuple[float, float], mates: list[tuple[float, float]], alike: float
) -> None:
    def camera(measured: tuple[float, float]) -> CameraFound:
        return CameraFound(MODEL, range=found(*measured))

    by, bearings = by_mates(camera(own), map(camera, mates), alike)
    assert np.log(by) / np.log(4) == pytest.approx(with_the_make([own, *mates], alike) - found(*own)[0], abs=1e-5)
    assert bearings == 1.0


@given(
    own=st.tuples(st.floats(-8, 8), st.floats(0, 1e7)),
    mates=st.lists(st.tuples(st.floats(-8, 8), st.floats(0, 1e7)), max_size=5),
)
def test_whatever_a_mate_claims_it_counts_for_a_sigma_of_the_prior(own: Found, mates: list[Found]) -> None:
    by, _ = by_mates(CameraFound(MODEL, own), [CameraFound(MODEL, mate) for mate in mates], 0.9)
    assert 4.0**-18 <= by <= 4.0**18
    blind, _ = by_mates(CameraFound(MODEL), [CameraFound(MODEL, mate) for mate in mates], 0.9)
    assert 4.0**-MOST <= blind <= 4.0**MOST


def test_factors_over_other_models_say_nothing() -> None:
    others = [CameraFound((0.1, 0.07, 0.02), (1.5, 0.1), (1.5, 0.1)), CameraFound(MODEL, UNKNOWN, UNKNOWN)]
    assert by_mates(CameraFound(MODEL), others, 0.9) == (1.0, 1.0)


def test_a_sighting_that_says_how_exact_it_is_stays_as_it_is() -> None:
    modelled = Relative("robot/r1", "robot/r2", 2.0, 0.5, 0.04, 0.01, biases=(Bias(0.1, 100.0),))
    assert scaled(modelled, 4.0, 0.25) == Relative(
        "robot/r1", "robot/r2", 2.0, 0.5, 0.16, 0.0025, biases=(Bias(0.2, 100.0),)
    )
    exact = Relative("robot/r1", "robot/r2", 2.0, 0.5, 0.04, 0.01)
    assert scaled(exact, 4.0, 0.25) == exact


@pytest.mark.parametrize("own", [(-4.0, 1e7), (-4.0, 0.0), (4.0, 0.0), (4.0, 1.0)])
@pytest.mark.parametrize("mate", [(-4.0, 0.0), (4.0, 0.0)])
@pytest.mark.parametrize(("variance", "lasting"), [(1e-12, 0.0), (1e7, 1e7)])
def test_no_claim_within_the_format_ends_a_joint_or_moves_a_mate_that_was_not_seen(
    own: Found, mate: Found, variance: float, lasting: float
) -> None:
    joint, cameras = TeamJoint(), {"robot/r1": own, "robot/r2": UNKNOWN, "robot/r3": mate}
    lie = Relative("robot/r1", "robot/r2", 2.5, 0.0, variance, 0.01, biases=(Bias(lasting, 100.0),))
    for tick in range(1, 8):
        evidence = []
        for place, (robot, found_of_it) in enumerate(cameras.items()):
            belief = entering(Moments(np.array([2.0 * place, 0.0, 0.0]), np.diag([0.01, 0.01, 1e-4])), NUISANCE)
            camera, seen = CameraFound(MODEL, found_of_it, found_of_it), (lie,) if robot == "robot/r1" else ()
            motion = Motion(dt=0.2 * tick)
            evidence.append(Evidence(robot, 0, tick, motion, NUISANCE, belief, None, seen, 0.2 * tick, camera=camera))
        joint.settle(tick, 0.2, evidence)
    assert np.linalg.eigvalsh(joint.joint.covariance).min() > -1e-9
    assert joint.pose("robot/r3").mean[:2] == pytest.approx([4.0, 0.0], abs=1e-6)


def variance_of_a_sighted_mate(nuisance: Nuisance, model: tuple[float, ...]) -> float:
    """Of x, unit^2, where r1 sees r2 after r3, of its make or not, told that such cameras are a quarter as noisy as their models."""

    def told(robot: str, tick: int, wide: float, camera: CameraFound, *relatives: Relative) -> Evidence:
        belief = entering(
            Moments(np.array([2.0 * (robot == "robot/r2"), 0.0, 0.0]), np.diag([wide, wide, 1e-6])), nuisance
        )
        motion = Motion(dt=0.2 * tick)
        return Evidence(robot, 0, tick, motion, nuisance, belief, None, relatives, 0.2 * tick, camera=camera)

    joint, sighting = TeamJoint(), Relative("robot/r1", "robot/r2", 2.0, 0.0, 0.25, 0.01, biases=(Bias(1e-6, 100.0),))
    for tick in (1, 2):
        seen = [sighting] if tick == 2 else []
        r1 = told("robot/r1", tick, 1e-6, CameraFound(MODEL), *seen)
        r2 = told("robot/r2", tick, 4.0, CameraFound(MODEL))
        r3 = told("robot/r3", tick, 1e-6, CameraFound(model, (-2.0, 0.01), (-2.0, 0.01)))
        joint.settle(tick, 0.2, [r1, r2, r3])
    return float(joint.pose("robot/r2").covariance[0, 0])


def test_a_robot_that_sees_no_landmark_is_believed_as_its_mates_of_one_make_found() -> None:
    alike, other = variance_of_a_sighted_mate(NUISANCE, MODEL), variance_of_a_sighted_mate(NUISANCE, (0.1,))
    alone = variance_of_a_sighted_mate(Nuisance(1.0, 1.0, NUISANCE.sigmas), MODEL)
    assert other == pytest.approx(0.25, rel=0.1)
    assert alone == pytest.approx(0.25, rel=0.1)
    assert alike == pytest.approx(0.25 * 4.0 ** (-MOST * 0.9), rel=0.1)
