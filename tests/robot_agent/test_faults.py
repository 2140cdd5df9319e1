"""What a robot under a fault says instead: lies, over-confidence, stamps and losses, in reports and evidence alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.faults import AnyFault, faults_of
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.gaussian.increment import Increment
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.vehicle import HEADING, STATES, Motion, Nuisance
from blackboard.opinion.grid import Grid
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.evidence import pack_evidence, unpack_increment, unpack_state
from blackboard.wire.messages import Informed, Report
from robot_agent.faults import FaultyRobot, changed, is_lost, narrowed, shifted
from robot_agent.service import AgentService
from robot_agent.team import robot_of

GRID = Grid((30, 30), 0.5)


def fault(**table: Any) -> AnyFault:
    (found,) = faults_of(Scenario({"fault": [{"robot": "r1", **table}]}))
    return found


def report(heading: float = 0.5) -> Report:
    mean = np.zeros(STATES)
    mean[:2], mean[HEADING] = (7.0, 8.0), heading
    covariance = np.diag([0.4, 0.4, 0.01, *[1e-4] * (STATES - 3)])
    seen = Relative("robot/r1", "robot/r2", range=3.0, bearing=-0.2, range_variance=0.04, bearing_variance=0.01)
    increment = Increment(mean.copy(), np.diag([4.0, 4.0, *[0.0] * (STATES - 2)]), np.ones(STATES))
    evidence = pack_evidence(0, Motion(1.0), Nuisance(), Moments(mean, covariance), increment, [seen])
    belief = pack(gaussian(GRID, (7.0, 8.0), 0.6))
    return Report(
        source="r1",
        subject="robot/r1",
        tick=3,
        time=1.5,
        belief=belief,
        informed=Informed(belief=belief, ancestors={"r2": 1.0}),
        evidence=evidence,
    )


def test_a_lie_is_off_by_its_offset_in_beliefs_and_evidence() -> None:
    true, lie = report(), changed(report(), fault(kind="lie", offset=[2.0, -1.0]), GRID)
    assert lie.informed
    assert lie.evidence
    assert lie.evidence.state
    assert lie.evidence.increment
    for packed in (lie.belief, lie.informed.belief):
        assert unpack(packed, GRID).mean() == pytest.approx([9.0, 7.0], abs=0.02)
    assert unpack_state(lie.evidence.state).mean[:3] == pytest.approx([9.0, 7.0, 0.5])
    assert unpack_increment(lie.evidence.increment).reference[:2] == pytest.approx([9.0, 7.0])
    assert true.evidence
    (one,), (other,) = lie.evidence.relatives, true.evidence.relatives
    at = [(it.range * np.cos(0.5 + it.bearing), it.range * np.sin(0.5 + it.bearing)) for it in (one, other)]
    assert np.subtract(*at) == pytest.approx([2.0, -1.0])


def test_a_lie_beyond_the_grid_stays_at_its_edge() -> None:
    lie = shifted(gaussian(GRID, (7.0, 8.0), 0.6), (100.0, 0.0))
    assert lie.p.sum() == pytest.approx(1.0)
    assert lie.mean() == pytest.approx([14.75, 8.0], abs=0.02)


@pytest.mark.parametrize("factor", [1.5, 2.0])
def test_over_confidence_makes_sigmas_smaller_by_its_factor(factor: float) -> None:
    wide = Belief(GRID, gaussian(GRID, (7.0, 8.0), 2.0).p)
    assert np.sqrt(np.diag(narrowed(wide, factor).covariance())) == pytest.approx([2.0 / factor] * 2, rel=0.05)
    said = changed(report(), fault(kind="overconfident", factor=factor), GRID)
    assert said.evidence
    assert said.evidence.state
    assert said.evidence.increment
    assert unpack_state(said.evidence.state).covariance[0, 0] == pytest.approx(0.4 / factor**2)
    assert unpack_increment(said.evidence.increment).information[0, 0] == pytest.approx(4.0 * factor**2)
    assert said.evidence.relatives[0].range_variance == pytest.approx(0.04 / factor**2)


def test_a_skewed_clock_stamps_what_is_said_and_changes_nothing_else() -> None:
    said = changed(report(), fault(kind="skew", seconds=-3), GRID)
    assert said.time == -1.5
    assert said.model_copy(update={"time": 1.5}) == report()


def test_a_lost_report_is_lost_each_time_and_the_share_is_kept() -> None:
    one = report()
    reports = [one.model_copy(update={"tick": tick}) for tick in range(2000)]
    lost = [is_lost(7, it, 0.3) for it in reports]
    assert lost == [is_lost(7, it, 0.3) for it in reports]
    assert lost != [is_lost(8, it, 0.3) for it in reports]
    assert sum(lost) == pytest.approx(600, abs=60)
    assert all(is_lost(7, it, 1.0) for it in reports)


def test_an_honest_robot_is_a_plain_service_and_so_is_one_with_a_broken_sensor() -> None:
    tables = {"fault": [{"kind": "lie", "robot": "r2", "offset": [1, 1]}, {"kind": "freeze", "robot": "r3"}]}
    kinds = [type(robot_of(Scenario(tables), name)) for name in ("r1", "r2", "r3")]
    assert kinds == [AgentService, FaultyRobot, AgentService]
