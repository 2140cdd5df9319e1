"""The recorded robots with odometry that is worse than their model of it.

Their mates correct them, their own model of the odometry adapts, and nobody is left out as a liar.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import squared_distance
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.run.flags import RecordingFlags
from blackboard.wire.messages import Odometry
from robot_agent.config import RobotSection
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import sensors_of
from sim_world.sources import open_sensor_source
from tests.files import DATASET7, needs_dataset7

pytestmark = needs_dataset7
SECONDS = 420.0  # a robot that is off by 5 % in its turns has contradicted its mates three times by then


Spoil = Callable[[Odometry, np.random.Generator], Odometry]


def turned(turn: float, drift: float) -> Spoil:
    """Odometry that reports each turn as `turn` times what it measured, and `drift` rad/s more while the robot moves."""
    return lambda told, rng: told.model_copy(
        update={"turn": turn * told.turn + (drift * told.dt if moving(told) else 0.0)}
    )


def slipping(along: float) -> Spoil:
    """Odometry with white noise of `along` metres per square root of a second of motion on the distance."""
    return lambda told, rng: told.model_copy(
        update={"distance": told.distance + (along * np.sqrt(told.dt) * rng.normal() if moving(told) else 0.0)}
    )


def moving(told: Odometry) -> bool:
    return told.distance != 0.0 or told.turn != 0.0


def run(protocol: str, spoil: Spoil) -> tuple[float, float]:
    """The RMSE (m) of the joint's robots over a spoilt recording, and the share of their 95 % ellipses that hold the truth."""
    scenario = RecordingFlags(str(DATASET7), 1248446200.0, protocol).scenario().changed("time", seconds=SECONDS)
    world, tick, rng = open_sensor_source(scenario), scenario.time.tick, np.random.default_rng(7)
    sensors = sensors_of(scenario.section("robot", RobotSection))
    filters = {f"robot/{name}": FirstHand(f"robot/{name}", sensors) for name in scenario.team.robots}
    joint, squares, held = TeamJoint(Objects(scenario.board.objects_drift, scenario.board.objects_drifts)), [], []
    for number in range(scenario.time.ticks + 1):
        truth, readings = world.advance("test", number)
        evidence = []
        for one in readings:
            robot = f"robot/{one.robot}"
            at = joint.pose(robot) if joint.knows(robot) else None
            odometry = None if one.odometry is None else spoil(one.odometry, rng)
            told = filters[robot].step(one.model_copy(update={"odometry": odometry}), at)
            said = (told.travelled, sensors.wheels.nuisance, told.belief, told.increment, told.relatives)
            evidence.append(Evidence(robot, told.epoch, number, *said))
        joint.settle(number, tick if number else 0.0, evidence)
        assert not joint.trust.left_out() | joint.contacts.left_out()
        for robot in filters:
            marginal = joint.marginal(robot)
            apart = marginal.mean - truth.positions[robot]
            squares.append(float(apart @ apart))
            held.append(squared_distance(apart, marginal.covariance) < 5.99)
    return float(np.sqrt(np.mean(squares))), float(np.mean(held))


@pytest.mark.parametrize(("turn", "drift"), [(1.05, 0.0), (1.0, 0.01)])
def test_two_robots_without_landmarks_are_kept_in_place_by_their_mates(turn: float, drift: float) -> None:
    rmse, _ = run("C_blind12", turned(turn, drift))
    assert rmse < 0.2, "metres; 0.12 with good odometry, 0.5 to 2 without the mates' help"


def test_wheels_that_slip_more_than_the_physics_say_are_found_out() -> None:
    """Three times the error along the way. Without `along.py` .72 of the 95 % ellipses held the truth, with it .87."""
    rmse, held = run("A_all", slipping(0.08))
    assert rmse < 0.17, "metres; 0.172 without"
    assert held > 0.8
