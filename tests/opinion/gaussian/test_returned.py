"""What robots return of a joint that is gone: more than they know themselves, and no evidence counts more than once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.opinion.gaussian.comparing import RETURNING
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, Motion, Nuisance, entering

SIGMA = 1e-3  # radians: of the headings, so small that places alone matter


def block(covariance: np.ndarray) -> Moments:
    whole = np.diag([0.0, 0.0, SIGMA**2])
    whole[AXES, AXES] = covariance
    return entering(Moments(np.zeros(3), whole), Nuisance())


def says(robot: int, tick: int, own: np.ndarray, returned: np.ndarray | None, epoch: int = 1) -> Evidence:
    back = None if returned is None else block(returned)
    motion = Motion(dt=0.1 * tick)
    return Evidence(f"robot/r{robot}", epoch, tick, motion, Nuisance(), block(own), time=10.0 + tick, returned=back)


def places(team: TeamJoint, robots: list[int]) -> np.ndarray:
    """The covariance of all places."""
    rows = np.concatenate([team.joint.blocks[f"robot/r{robot}"].start + np.arange(2) for robot in robots])
    return np.asarray(team.joint.covariance[np.ix_(rows, rows)])


@settings(deadline=None, max_examples=60)
@given(st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_whoever_returns_what_and_whenever_the_joint_is_never_surer_than_all_evidence_makes_it(
    n: int, seed: int
) -> None:
    """By linear algebra: robots know their places first-hand, some exactly, and measured each other before the joint was lost."""
    rng = np.random.default_rng(seed)
    own = [np.diag(10.0 ** rng.uniform(-3, 2, 2)) for _ in range(n)]
    information = np.zeros((2 * n, 2 * n))
    for i, covariance in enumerate(own):
        information[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = np.linalg.inv(covariance)
    measured = []
    for _ in range(int(rng.integers(1, 2 * n + 1))):
        one, other = rng.choice(n, 2, replace=False)
        row = np.zeros((2, 2 * n))
        row[:, 2 * one : 2 * one + 2], row[:, 2 * other : 2 * other + 2] = -np.eye(2), np.eye(2)
        variance = 10.0 ** rng.uniform(-4, 0)
        measured.append((row, variance))
        information += row.T @ row / variance
    known = np.linalg.inv(information)
    returning = rng.random(n) < 0.6
    ticks = rng.integers(0, 3, n)
    team = TeamJoint()
    for tick in range(3):
        coming = [
            says(i, tick, own[i], 2 * (n - 1) * known[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] if returning[i] else None)
            for i in range(n)
            if ticks[i] == tick
        ]
        team.settle(tick, 0.1, coming)
    # The error of each robot's place is a sum of the errors of all evidence; of who enters by its own belief of that alone.
    errors = np.zeros((2 * n, 2 * n + 2 * len(measured)))
    sizes = np.concatenate([np.concatenate([np.diag(c) for c in own]), np.repeat([v for _, v in measured], 2)])
    by_evidence = np.hstack([np.diag(1 / sizes[: 2 * n]), *(row.T / variance for row, variance in measured)])
    for i in range(n):
        mine = slice(2 * i, 2 * i + 2)
        errors[mine] = (known @ by_evidence)[mine] if returning[i] else np.eye(2 * n + 2 * len(measured))[mine]
    true = (errors * sizes) @ errors.T
    told = places(team, list(range(n)))
    root = np.linalg.cholesky(told)
    share = np.linalg.solve(root, np.linalg.solve(root, true).T)
    assert np.linalg.eigvalsh(0.5 * (share + share.T))[-1] <= 1 + 1e-6


def test_a_robot_that_enters_a_new_joint_is_as_sure_as_what_it_returns() -> None:
    team = TeamJoint()
    team.settle(0, 0.1, [says(1, 0, np.eye(2) * 4.0, np.eye(2) * 0.1), says(2, 0, np.eye(2), None)])
    assert np.diag(places(team, [1, 2])) == pytest.approx([0.1, 0.1, 2.0, 2.0])


@pytest.mark.parametrize("epoch", [1, 20_000])
def test_what_a_robot_tells_first_hand_after_others_returned_it_counts_half_unless_it_began_anew(epoch: int) -> None:
    team = TeamJoint()
    team.settle(0, 0.1, [says(1, 0, np.eye(2) * 4.0, np.eye(2) * 0.1)])
    team.settle(1, 60.0, [says(2, 1, np.eye(2), None, epoch=epoch)])
    assert np.diag(places(team, [2])) == pytest.approx([2.0, 2.0] if epoch == 1 else [1.0, 1.0])


def test_a_joint_that_began_long_ago_takes_nothing_back_nor_of_a_robot_that_it_knows() -> None:
    team = TeamJoint()
    team.settle(0, 0.1, [says(1, 0, np.eye(2) * 4.0, None)])
    team.settle(1, 0.1, [says(1, 1, np.eye(2) * 4.0, np.eye(2) * 0.1, epoch=2)])
    assert np.diag(places(team, [1])) == pytest.approx([4.0, 4.0])
    team.settle(2, RETURNING + 0.1, [says(2, 2, np.eye(2), np.eye(2) * 0.1)])
    assert np.diag(places(team, [2])) == pytest.approx([1.0, 1.0])
