"""The robots of a factor graph without grids and processes: their filters with the joint of a board, and one filter that has everything."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from blackboard.config import Scenario
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Joint, Moments, squared_distance
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import forget_biases
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import AXES, Motion, correct, drive, entering
from blackboard.run.flags import RecordingFlags
from blackboard.wire.messages import Odometry, Readings, Truth
from robot_agent.config import RobotSection
from robot_agent.gaussian.absolute import starting_pose
from robot_agent.gaussian.filter import FirstHand
from robot_agent.gaussian.sensors import sensors_of
from sim_world.sources import open_sensor_source

HELD = 5.991  # the 95 % quantile of chi-squared with two degrees of freedom
Judged = tuple[float, float]  # RMSE, m, and the share of 95 % ellipses that hold the truth


def new_scenario(file: Path, seed: int, seconds: float) -> Scenario:
    return RecordingFlags(pyfg=str(file)).scenario().changed("time", seconds=seconds).changed("world", seed=seed)


def ticks(scenario: Scenario) -> Iterator[tuple[Truth, list[Readings], bool]]:
    source = open_sensor_source(scenario)
    for tick in range(scenario.time.ticks + 1):
        yield *source.advance("x", tick), source.judged(tick)


def joint_of_a_team(scenario: Scenario) -> Judged:
    """First-hand filters, and the joint that takes their evidence; each linearises where the joint has it."""
    sensors = sensors_of(scenario.section("robot", RobotSection))
    robots = {name: FirstHand(f"robot/{name}", sensors) for name in scenario.team.robots}
    team, judge = TeamJoint(), _Judge()
    for truth, readings, judged in ticks(scenario):
        evidence = []
        for reading in readings:
            subject = f"robot/{reading.robot}"
            at = team.pose(subject) if subject in team.joint else None
            result = robots[reading.robot].step(reading, at)
            evidence.append(result.evidence(subject, reading.tick, reading.time, sensors.wheels.nuisance))
        team.settle(truth.tick, scenario.time.tick, evidence)
        if judged:
            judge.take(truth, {subject: team.marginal(subject) for subject in truth.positions})
    return judge.said()


def one_filter(scenario: Scenario) -> Judged:
    """An extended Kalman filter of all robots with all readings and the same models; it gates as the team does."""
    sensors, joint, judge = sensors_of(scenario.section("robot", RobotSection)), Joint(), _Judge()
    last: dict[str, Odometry] = {}
    for truth, readings, judged in ticks(scenario):
        motions: dict[str, Motion] = {}
        for reading in readings:
            subject = f"robot/{reading.robot}"
            if (pose := starting_pose(reading, sensors.compass)) is not None:
                joint.add(subject, entering(pose, sensors.wheels.nuisance))
            if reading.odometry is not None:
                motions[subject] = sensors.wheels.motion(reading.odometry, last.get(subject))
                last[subject] = reading.odometry
                drive(joint, subject, motions[subject], sensors.wheels.nuisance)
        forget_biases(joint, scenario.time.tick)
        for reading in readings:
            for sighting in reading.seen:
                place = None if sighting.landmark is None else np.array(sighting.landmark)
                factor = linearise(joint, sensors.relative(f"robot/{reading.robot}", sighting), motions, place)
                innovation = joint.innovation(factor)
                if innovation.squared <= quantile(GATE, innovation.freedom):
                    correct(joint, factor)
        if judged:
            places = {subject: joint.moments(subject) for subject in truth.positions}
            judge.take(truth, {s: Moments(m.mean[AXES], m.covariance[AXES, AXES]) for s, m in places.items()})
    return judge.said()


class _Judge:
    def __init__(self) -> None:
        self.squares: list[float] = []
        self.held: list[bool] = []

    def take(self, truth: Truth, marginals: dict[str, Moments]) -> None:
        for subject, place in truth.positions.items():
            off = marginals[subject].mean - np.array(place)
            self.squares.append(float(off @ off))
            self.held.append(squared_distance(off, marginals[subject].covariance) < HELD)

    def said(self) -> Judged:
        return math.sqrt(float(np.mean(self.squares))), float(np.mean(self.held))
