"""What a robot under a fault says instead: lies, over-confidence, stamps and losses."""

from typing import Any

import pytest

from blackboard.config import Scenario
from blackboard.faults import AnyFault, faults_of
from blackboard.wire.falsified import displaced, overconfident
from robot_agent.faults import FaultyRobot, changed, is_lost
from robot_agent.service import AgentService
from robot_agent.team import robot_of
from tests.wire.reports import report


def fault_of(**table: Any) -> AnyFault:
    (fault,) = faults_of(Scenario({"fault": [{"robot": "r1", **table}]}))
    return fault


def test_a_liar_reports_other_places_and_an_over_confident_robot_smaller_sigmas() -> None:
    for lie in (
        fault_of(kind="lie", offset=[2.0, -1.0]),
        fault_of(kind="collude", robot=None, robots=["r1", "r2"], offset=[2.0, -1.0]),
    ):
        assert changed(report(), lie) == displaced(report(), (2.0, -1.0))
    assert changed(report(), fault_of(kind="overconfident", factor=1.5)) == overconfident(report(), 1.5)


def test_a_skewed_clock_stamps_what_is_said_and_changes_nothing_else() -> None:
    said = changed(report(), fault_of(kind="skew", seconds=-3))
    assert said.time == -1.5
    assert said.model_copy(update={"time": 1.5}) == report()


def test_a_lost_report_is_lost_each_time_and_the_share_is_kept() -> None:
    first = report()
    reports = [first.model_copy(update={"tick": tick}) for tick in range(2000)]
    lost = [is_lost(7, message, 0.3) for message in reports]
    assert lost == [is_lost(7, message, 0.3) for message in reports]
    assert lost != [is_lost(8, message, 0.3) for message in reports]
    assert sum(lost) == pytest.approx(600, abs=60)
    assert all(is_lost(7, message, 1.0) for message in reports)


def test_an_honest_robot_is_a_plain_service_and_so_is_one_with_a_broken_sensor() -> None:
    tables = {"fault": [{"kind": "lie", "robot": "r2", "offset": [1, 1]}, {"kind": "freeze", "robot": "r3"}]}
    kinds = [type(robot_of(Scenario(tables), name)) for name in ("r1", "r2", "r3")]
    assert kinds == [AgentService, FaultyRobot, AgentService]
