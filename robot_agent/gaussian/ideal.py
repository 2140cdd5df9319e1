"""One joint Gaussian of all robots and objects, fed directly with the readings of all robots: the bound of a team. Pure.

No report, no increment and no board is in between, so nothing is forgotten and nothing is counted twice.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from blackboard.config import Scenario
from blackboard.opinion.chi_squared import GATE, quantile
from blackboard.opinion.gaussian.joint import Block, Factor, Joint, Moments
from blackboard.opinion.gaussian.linearising import linearise
from blackboard.opinion.gaussian.relation import Relative, forget_biases
from blackboard.opinion.gaussian.vehicle import AXES, FLAT, HEADING, STATES, Motion, correct, drive, entering
from blackboard.opinion.grid import Array
from blackboard.wire.messages import Odometry, Readings
from robot_agent.config import RobotSection, settings_of
from robot_agent.estimator import newest
from robot_agent.gaussian.absolute import starting_pose, take_absolute
from robot_agent.gaussian.sensors import Sensors, sensors_of, simulated
from robot_agent.sensing import NODES, SEEN_FROM


@dataclass
class Ideal:
    """Mutable; `step` once per tick. Robots and objects are named as subjects: `robot/r1`, `object/ball`."""

    sensors: Sensors  # of every robot that `own` does not name
    drifts: Mapping[str, float]  # object -> its random walk, unit / sqrt(s)
    drift: float = 0.0  # of the other objects
    gate: float = math.inf  # squared Mahalanobis distance beyond which a sighting is not taken
    #: The simulated world turns, then goes straight; else a robot goes along the chord of its turn.
    turns_first: bool = True
    own: Mapping[str, Sensors] = field(default_factory=dict)  # robot -> its sensors, as `robot/r1`
    joint: Joint = field(default_factory=Joint)
    _before: dict[str, Odometry] = field(default_factory=dict)  # robot -> the odometry of the tick before
    #: robot -> first landmark of a group -> its place
    _groups: dict[str, dict[str, tuple[float, float]]] = field(default_factory=dict)

    def step(self, dt: float, readings: Sequence[Readings]) -> None:
        """Take the readings of all robots of a tick of `dt` seconds: motions, then fixes and compasses, then what was seen."""
        sightings = self._sightings(readings)
        motions = {f"robot/{r.robot}": self._move(f"robot/{r.robot}", r.odometry) for r in readings}
        forget_biases(self.joint, dt)
        for block in self.joint.blocks:
            if isinstance(block, str) and block.startswith("object/"):
                walk = np.eye(2) * self.drifts.get(block, self.drift) ** 2 * dt
                self.joint.move(block, self.joint.moments(block).mean, np.eye(2), walk)
        for one in readings:
            self._take(f"robot/{one.robot}", one)
        for relative, place in sightings:
            self._see(relative, motions, place)

    def belief(self, subject: str) -> Moments | None:
        """Mean and covariance of a subject's position; None where it is not known."""
        if subject not in self.joint:
            return None
        block = self.joint.moments(subject)
        known = float(np.trace(block.covariance[AXES, AXES])) < FLAT / 2
        return Moments(block.mean[AXES], block.covariance[AXES, AXES]) if known else None

    # --- inside -------------------------------------------------------------------------------------------------------

    def _sensors(self, robot: str) -> Sensors:
        return self.own.get(robot, self.sensors)

    def _move(self, robot: str, told: Odometry | None) -> Motion:
        if told is None:
            return Motion()
        wheels = self._sensors(robot).wheels
        motion = wheels.motion(told, self._before.get(robot))
        self._before[robot] = told
        if robot in self.joint:
            parts = [motion]
            if self.turns_first:
                turn = replace(motion, distance=0.0, along=0.0, across=0.0)
                parts = [turn, replace(motion, turn=0.0, heading=0.0, dt=0.0, moving=0.0)]
            for part in parts:
                drive(self.joint, robot, part, wheels.nuisance)
        return motion

    def _take(self, robot: str, readings: Readings) -> None:
        """The fix and the compass; a robot enters with its first heading, and a flat position if it has no fix."""
        sensors = self._sensors(robot)
        if robot in self.joint:
            take_absolute(self.joint, robot, readings, sensors.compass)
        elif (pose := starting_pose(readings, sensors.compass)) is not None:
            self.joint.add(robot, entering(pose, sensors.wheels.nuisance))

    def _sightings(self, readings: Sequence[Readings]) -> list[tuple[Relative, Array | None]]:
        """What was seen in a tick, with its place where that is known: landmarks first, then mates, then objects."""
        pairs = []
        for one in readings:
            robot, told = f"robot/{one.robot}", one.odometry
            camera = self._sensors(robot).camera
            before = self._before.get(robot, told)
            turned = 0.0 if told is None or before is None else max(abs(told.turn), abs(told.turn - before.turn))
            for sighting in newest(one.sightings):
                group, dt, place = "", 0.0 if told is None else told.dt, None
                if sighting.landmark is not None:
                    groups = self._groups.setdefault(robot, {})
                    group, place = (
                        camera.group(groups, sighting.subject, sighting.landmark),
                        np.array(sighting.landmark),
                    )
                pairs.append((camera.relative(robot, sighting, turned, dt, group), place))
        return sorted(pairs, key=lambda pair: (pair[1] is None, pair[0].subject.startswith("object/")))

    def _see(self, relative: Relative, motions: Mapping[str, Motion], place: Array | None) -> None:
        if relative.observer not in self.joint:
            return
        if place is None and relative.subject not in self.joint:
            if not relative.subject.startswith("object/"):
                return  # a mate that has not entered, or a landmark of unknown place
            self.joint.add(relative.subject, Moments(np.zeros(2), np.eye(2) * FLAT))
        if relative.profile and place is None:
            self._see_position(relative)
            return
        factor = linearise(self.joint, relative, motions, place)
        if self.joint.innovation(factor).squared <= self.gate:
            correct(self.joint, factor)

    def _see_position(self, relative: Relative) -> None:
        """A position that was seen with an isotropic error, as the simulated cameras do: 0 = subject - observer - R(heading) seen.

        That is linear but for the heading, which the compass tells well. The variance depends on the true distance, so it is
        averaged over the distances that the joint expects; the range that was seen is left out of it, as it has the error itself.
        """
        observer, subject = self.joint.blocks[relative.observer], self.joint.blocks[relative.subject]
        angle = float(self.joint.mean[observer][HEADING]) + relative.bearing
        seen = relative.range * np.array([math.cos(angle), math.sin(angle)])
        expected = self.joint.mean[subject][AXES] - self.joint.mean[observer][AXES]
        mine, its = np.zeros((2, STATES)), np.zeros((2, subject.stop - subject.start))
        mine[:, AXES], its[:, AXES] = -np.eye(2), np.eye(2)
        rows: dict[Block, Array] = {relative.observer: mine, relative.subject: its}
        spread = self.joint.innovation(Factor(seen - expected, rows, np.zeros((2, 2)))).covariance
        mine[:, HEADING] = seen[1], -seen[0]
        # Where nothing is expected, the distance is the one that was seen.
        away, spread = (seen, np.zeros((2, 2))) if np.trace(spread) > FLAT / 2 else (expected, spread)
        distance = max(float(np.hypot(*away)), SEEN_FROM)
        sigma = math.sqrt(float(away @ spread @ away)) / distance
        distances, variances = np.array(relative.profile).T
        nodes, weights = NODES
        variance = float(weights @ np.interp(distance + sigma * nodes, distances, variances))
        correct(self.joint, Factor(seen - expected, rows, np.eye(2) * variance))


def of_team(scenario: Scenario) -> Ideal:
    """The filter with the sensor models that the robots of a scenario are configured with. UserError: a section that is wrong."""
    settings = scenario.section("robot", RobotSection)
    own = {f"robot/{name}": sensors_of(settings_of(scenario, name)) for name in scenario.team.robots}
    return Ideal(sensors_of(settings), {}, settings.objects.drift, quantile(GATE, 2), turns_first=False, own=own)


def of_noise(
    along: float, turn: float, compass: float, profile: tuple[tuple[float, float], ...], drifts: Mapping[str, float]
) -> Ideal:
    """The filter with sensors whose noise is known, and the random walks of objects (unit / sqrt(s)), as `object/ball`.

    The errors of the way (unit / sqrt(s)), the turn (rad / sqrt(rad)) and the compass (rad), and those of a seen position: distances
    with the variance there (unit ** 2).
    """
    sensors = simulated(0.0, turn, compass, profile)
    return Ideal(replace(sensors, wheels=replace(sensors.wheels, along=along, standing=1.0)), drifts)
