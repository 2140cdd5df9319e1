"""The service of a robot as a scenario asks for it: an honest one, or one under faults."""

from collections.abc import Sequence
from typing import Any

from blackboard.config import Scenario
from blackboard.faults import faults_of, is_of_sensors
from robot_agent.config import settings_of
from robot_agent.estimator import Estimator
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import sensors_of
from robot_agent.service import AgentService


def estimator_of(scenario: Scenario, robot: str) -> Estimator:
    """The beliefs on grids of a robot that has no reading yet. UserError: a mistake in the scenario."""
    return Estimator.begin(settings_of(scenario, robot), scenario.grid, robot)


def first_hand_of(scenario: Scenario, robot: str) -> FirstHand:
    """The Gaussian filter of a robot that has no reading yet. UserError: a mistake in the scenario."""
    return FirstHand(f"robot/{robot}", sensors_of(settings_of(scenario, robot)))


def robot_of(scenario: Scenario, robot: str, *, sub_teams: Sequence[str] | None = None) -> AgentService:
    """The service of a robot, by default in the scenario's sub-teams. UserError: a mistake in the scenario."""
    arguments: dict[str, Any] = {
        "team": scenario.team.name,
        "sub_teams": scenario.team.of(robot) if sub_teams is None else sub_teams,
        "robot": robot,
        "grid": scenario.grid,
        "settings": settings_of(scenario, robot),
        "feedback": scenario.board.feedback,
        "joint": scenario.board.fusion == "joint",
        "drift": scenario.board.drift,
        "robots": max(1, len(scenario.team.robots)),
    }
    faults = [fault for fault in faults_of(scenario) if robot in fault.names and not is_of_sensors(fault)]
    if not faults:
        return AgentService(**arguments)
    from robot_agent.faults import FaultyRobot

    return FaultyRobot(faults, int(scenario.tables.get("world", {}).get("seed", 1)), **arguments)
