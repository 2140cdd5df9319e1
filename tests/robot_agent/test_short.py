"""Evidence in fewer bytes: what is rounded is never refused, never claims what was not known, and is nearly what it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.joint.evidence import shrank, unpack
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.increment import Increment, gained, likelihood
from blackboard.opinion.gaussian.joint import Factor, Joint, Moments
from blackboard.opinion.gaussian.relation import Bias, Relative
from blackboard.opinion.gaussian.vehicle import STATES, Motion, Nuisance, correct
from blackboard.opinion.grid import Array
from blackboard.wire.codec import decode, encode
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import pack_evidence, unpack_increment, unpack_state
from blackboard.wire.messages import Report
from robot_agent.short import OFF, ROUNDED, WIDER, shorter
from tests.present import present
from tests.wire.messages import REPORT

SIGMAS = np.array([0.3, 0.2, 0.1, 0.05, 0.03, 0.003, 0.006, 0.01, 0.02, 0.1, 0.2, 0.1])
PROFILE = tuple((0.25 * i + 1.0, 0.25 + 0.1 * (0.25 * i - 5.0) ** 2) for i in range(50))


def block(rng: np.random.Generator) -> Moments:
    """A robot somewhere, whose errors are correlated."""
    turn = np.linalg.qr(rng.normal(size=(STATES, STATES)))[0]
    mixed = turn @ np.diag(rng.uniform(0.1, 2.0, STATES)) @ turn.T
    mean = np.array([*rng.uniform(-50, 50, 2), rng.uniform(-3, 3), 0.94, 0.97, *rng.normal(size=STATES - 5) * 0.01])
    return Moments(mean, mixed * np.outer(SIGMAS, SIGMAS))


def measured(before: Moments, rng: np.random.Generator, rank: int) -> Moments:
    """The block after as many measurements, some of them sharp, and one of a difference of two states alone."""
    joint = Joint()
    joint.add("robot/r1", before)
    for i in range(rank):
        rows = rng.normal(size=(1, STATES)) / SIGMAS if i else (np.eye(STATES)[2] - np.eye(STATES)[6])[np.newaxis]
        residual, noise = rng.normal(size=1) * 0.01, np.array([[10.0 ** rng.uniform(-5, 0)]])
        joint.update(Factor(residual, {"robot/r1": rows}, noise))
    return joint.moments("robot/r1")


def evidence(
    state: Moments | None = None, increment: Increment | None = None, motion: Motion | None = None
) -> PackedEvidence:
    relative = Relative("robot/r1", "robot/r2", 3.3, 0.3, 0.1, 0.01, 0.1, (Bias(0.1, 100.0),), "g", PROFILE)
    return pack_evidence(
        Evidence("robot/r1", 0, 0, motion or Motion(), Nuisance(0.9, 0.95, (0.1,) * 9), state, increment, (relative,))
    )


def moved(before: Moments, increment: Increment) -> Moments:
    joint = Joint()
    joint.add("robot/r1", before)
    factor = likelihood(joint, "robot/r1", increment)
    correct(joint, present(factor))
    return joint.moments("robot/r1")


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_an_increment_says_nearly_the_same_and_nothing_where_it_said_nothing(seed: int, rank: int) -> None:
    rng = np.random.default_rng(seed)
    before = block(rng)
    after = measured(before, rng, rank)
    whole = present(gained(before, after))
    packed = shorter(evidence(after, whole))
    unpack("r1", 1, 0.2, packed)  # boards refuse what is no likelihood
    unpacked = unpack_increment(present(packed.increment))
    there, here = moved(before, whole), moved(before, unpacked)
    assert np.abs((here.mean - there.mean) / np.sqrt(np.diag(there.covariance))).max() < 0.1
    assert np.diag(here.covariance) == pytest.approx(np.diag(there.covariance), rel=0.06)
    joint = Joint()
    joint.add("robot/r1", before)
    first, second = (likelihood(joint, "robot/r1", increment) for increment in (whole, unpacked))
    # No direction is added: the gate's degrees of freedom stay.
    assert len(present(second).residual) <= len(present(first).residual)


def test_each_number_of_an_increment_takes_five_bytes_at_most() -> None:
    rng = np.random.default_rng(2)
    before = block(rng)
    after = measured(before, rng, 2)
    packed = shorter(evidence(after, gained(before, after)))
    assert packed.increment is not None
    numbers = np.array([*packed.increment.information, *packed.increment.vector, *packed.increment.reference])
    assert np.array_equal(numbers, numbers.astype(np.float32).astype(float))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_a_state_only_grows_wider(seed: int, sharp: int) -> None:
    rng = np.random.default_rng(seed)
    state = measured(block(rng), rng, sharp) if sharp else block(rng)
    packed = shorter(evidence(state))
    unpacked = unpack_state(present(packed.state))  # Refused, were it no covariance
    scale = np.sqrt(np.diag(state.covariance))
    grown = np.linalg.eigvalsh((unpacked.covariance - state.covariance) / np.outer(scale, scale))
    assert grown[0] > 0
    assert grown[-1] < 2 * WIDER
    assert unpacked.mean == pytest.approx(state.mean, rel=1e-6)


def test_sums_never_shrink() -> None:
    rng, sums = np.random.default_rng(3), Motion(dt=ROUNDED - 3.0, moving=ROUNDED / 2, along=ROUNDED - 1e-3)
    before = shorter(evidence(motion=sums))
    for _ in range(300):
        step: Array = rng.uniform(0, 1, 7) * 10.0 ** rng.uniform(-9, -1) * (rng.random(7) < 0.7)
        sums = sums.plus(Motion(*map(float, step)))
        now = shorter(evidence(motion=sums))
        assert not shrank(before, now)
        before = now


def test_a_profile_is_thinned_as_far_as_readers_interpolate_it() -> None:
    thin = shorter(evidence()).profile
    assert len(thin) < len(PROFILE) / 2
    assert [thin[0][0], thin[-1][0]] == [PROFILE[0][0], PROFILE[-1][0]]
    distances, variances = np.array(PROFILE).T
    read = np.interp(distances, *np.array(thin).T)
    assert np.abs(read / variances - 1).max() <= OFF + 1e-6


def test_a_report_of_it_is_read_back_in_half_the_bytes() -> None:
    rng = np.random.default_rng(6)
    before = block(rng)
    after = measured(before, rng, 3)
    full = evidence(after, gained(before, after))
    report = REPORT.model_copy(update={"evidence": shorter(full)})
    payload = encode(report, shortest=True)
    assert decode(Report, payload) == report
    assert len(payload) < 0.55 * len(encode(REPORT.model_copy(update={"evidence": full})))
