"""Equal joints of one process are settled once, and each is as if it had settled alone."""

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.errors import Degenerate
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.once import SettledOnce, settle_alone
from blackboard.opinion.gaussian.team import TeamJoint
from tests.opinion.gaussian.driving import reports_of, team


@dataclass
class Counted(TeamJoint):
    """A joint that counts how often one of its kind was settled."""

    settled: ClassVar[int] = 0

    def settle(self, tick: int, dt: float, reports: Iterable[Evidence]) -> list[Verdict]:
        Counted.settled += 1
        return super().settle(tick, dt, reports)


def state(joint: TeamJoint) -> tuple[object, ...]:
    """What joints that settled the same have in common, to the bit."""
    verdicts = [(verdict.source, verdict.subject, verdict.squared, verdict.taken) for verdict in joint.tally.verdicts]
    return joint.joint.blocks, joint.joint.mean.tobytes(), joint.joint.covariance.tobytes(), verdicts


@given(seed=st.integers(0, 100), chance=st.randoms(use_true_random=False))
def test_equal_joints_are_settled_once_and_others_by_themselves(seed: int, chance: random.Random) -> None:
    robots, once, before = team(3, seed), SettledOnce(), Counted.settled
    joints: list[TeamJoint] = [Counted(), Counted()]
    alone, apart, apart_alone = TeamJoint(), TeamJoint(), TeamJoint()
    for tick in range(3):
        news = reports_of(robots, tick)
        alone = settle_alone(alone, tick, 1.0, news)
        joints = [once(joint, tick, 1.0, chance.sample(news, len(news))) for joint in joints]
        apart = once(apart, tick, 1.0, news[: 3 - tick % 2])
        apart_alone = settle_alone(apart_alone, tick, 1.0, news[: 3 - tick % 2])
        assert state(joints[0]) == state(joints[1]) == state(alone)
        assert state(apart) == state(apart_alone)
    assert Counted.settled - before == 3


@dataclass
class Broken(Counted):
    def settle(self, tick: int, dt: float, reports: Iterable[Evidence]) -> list[Verdict]:
        super().settle(tick, dt, reports)
        raise Degenerate("", "overflow")


def test_a_settlement_that_failed_is_not_taken_for_one() -> None:
    once, news = SettledOnce(), reports_of(team(2, 1), 0)
    for _ in range(2):
        with pytest.raises(Degenerate):
            once(Broken(), 0, 1.0, news)
