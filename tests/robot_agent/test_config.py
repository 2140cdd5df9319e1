"""Every key of [robot] does something: another value changes what a robot reports. A key that nobody reads fails here."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.errors import UserError
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.run.overrides import with_settings
from blackboard.wire.evidence import Seen
from blackboard.wire.messages import Fix, Odometry, Sighting
from robot_agent.agent import Agent
from robot_agent.config import OdometrySection, RobotSection, check_robots, settings_of
from robot_agent.gaussian.sensors import sensors_of
from tests.robot_agent.robots import agreed, measured
from tests.scenarios import keys_of

GRID = Grid((40, 36), 0.5)
START = Fix(position=(7.0, 9.0), sigma=0.6, heading=0.1, heading_sigma=0.1)

#: Where each key matters: the localizer and the sensor model, and another value than the default.
PRINTED, CAMERA, POSE = ("position", "position"), ("position", "range-bearing"), ("pose", "range-bearing")
KEYS: dict[str, tuple[tuple[str, str], Any]] = {
    "localizer": (CAMERA, "pose"),
    "headings": (POSE, 36),
    "vision.kind": (PRINTED, "range-bearing"),
    "vision.gain": (PRINTED, 0.1),
    "vision.floor": (PRINTED, 0.9),
    "vision.range_floor": (CAMERA, 0.5),
    "vision.range_share": (POSE, 0.2),
    "vision.bearing": (POSE, 0.2),
    "vision.frames": (CAMERA, 1.0),
    "vision.misread": (PRINTED, 2.0),
    "vision.outlier": (POSE, 0.1),
    "vision.mates": (PRINTED, False),
    "odometry.distance_scale": (PRINTED, 0.8),
    "odometry.turn_scale": (POSE, 0.5),
    "odometry.along": (PRINTED, 0.6),
    "odometry.across": (POSE, 0.4),
    "odometry.turn": (POSE, 0.06),
    "odometry.standing": (PRINTED, 1.0),
    "objects.drift": (PRINTED, 1.5),
    "objects.fresh": (PRINTED, 0.5),
    "objects.forget": (PRINTED, 0.5),
}

#: Not about beliefs: seconds of waiting, and how a belief is written (tests/flow/test_upgrade.py).
OTHERS = {"patience", "coding"}

#: Read by `robot_agent.budget`: what is said of the beliefs; each is tried in test_budget.py.
SAID = {"send.budget", "send.rate", "send.burst", "send.longest"}

#: Read by a robot of a joint whose camera measures ranges and bearings.
MEASURED = {"vision.range_scale": 1.1, "vision.range_bias": 0.1, "vision.bearing_bias": 0.02}

#: Read by a robot of a joint: each with another value than here.
JOINT: dict[str, Any] = {
    "odometry.distance_lasting": 0.1,
    "odometry.turn_lasting": 0.1,
    "odometry.curve_distance_scale": 0.8,
    "odometry.curve_turn_scale": 0.6,
    "odometry.lag": 0.2,
    "odometry.drift": 0.01,
    "odometry.measured": True,
    "odometry.turning": 0.1,
    "odometry.compass": 0.1,
    "ranging.bias": 0.2,
    "ranging.seconds": 5.0,
    "ranging.scale": 0.05,
    "landmarks": {"6": (11.0, 10.0)},
}


SEEN = Sighting(subject="landmark/6", range=2.0, bearing=0.3)


def settings(setup: tuple[str, str], changed: Mapping[str, Any] | None = None) -> RobotSection:
    tables = {"localizer": setup[0], "vision": {"kind": setup[1]}}
    keys = {f"robot.{key}": value for key, value in (changed or {}).items()}
    return with_settings(Scenario({"robot": tables}), keys).section("robot", RobotSection)


def story(section: RobotSection) -> list[np.ndarray]:
    """All beliefs of a robot that drives, stands, and sees an object, a mate of agreed place and a landmark."""
    agent = Agent("r1", section, GRID)
    mate = agreed(1, gaussian(GRID, (12.0, 9.5), 0.3), "robot/r2", ("r2",))
    beliefs = []
    for tick in range(6):
        moving = tick < 4
        sightings = [
            Sighting(subject="landmark/6", range=4.0, bearing=0.3, landmark=(11.0, 10.0)),
            Sighting(subject="object/ball", range=6.0 - 0.95 * tick, bearing=-0.2 - 0.2 * tick),
            Sighting(subject="robot/r2", range=5.0, bearing=0.1),
        ]
        told = {"odometry": Odometry(distance=1.0 * moving, turn=0.2 * moving, dt=0.5)} if tick else {"fix": START}
        readings = measured(tick, time=0.5 * tick, sightings=sightings if tick in (0, 2, 3) else [], **told)
        agent.tick(readings, mate if tick == 2 else {})
        beliefs += [belief.p for e in (agent.firsthand, agent.informed) for _, belief in sorted(e.beliefs().items())]
    return beliefs


@cache
def usual(setup: tuple[str, str]) -> list[np.ndarray]:
    return story(settings(setup))


def test_every_key_is_here() -> None:
    assert set(keys_of(RobotSection)) == {*KEYS, *OTHERS, *SAID, *JOINT, *MEASURED}


@pytest.mark.parametrize("key", KEYS)
def test_another_value_is_another_belief(key: str) -> None:
    setup, value = KEYS[key]
    before, after = usual(setup), story(settings(setup, {key: value}))
    assert len(before) != len(after) or max(np.abs(a - b).max() for a, b in zip(before, after, strict=True)) > 1e-4


def test_the_same_values_are_the_same_beliefs() -> None:
    assert all(np.array_equal(a, b) for a, b in zip(usual(POSE), story(settings(POSE)), strict=True))
    assert all(math.isclose(p.sum(), 1.0) for p in usual(POSE))


@pytest.mark.parametrize("key", JOINT)
def test_another_value_is_another_model_of_a_robot_in_a_joint(key: str) -> None:
    def model(changed: Mapping[str, Any]) -> tuple[object, ...]:
        sensors = sensors_of(settings(PRINTED, {"ranging.bias": 0.1, **changed}))
        sighting = Seen(kind="range", subject="robot/r2", values=(3.0,))
        return sensors.wheels, sensors.compass, sensors.landmarks, sensors.relative("robot/r1", sighting)

    assert model({key: JOINT[key]}) != model({})


@pytest.mark.parametrize("key", MEASURED)
def test_what_was_measured_of_a_camera_is_taken_off_what_it_sees(key: str) -> None:
    def corrected(changed: Mapping[str, float]) -> tuple[float, float]:
        relative = sensors_of(settings(POSE, changed)).camera.relative("robot/r1", SEEN, 0.0, 1.0)
        return relative.range, relative.bearing

    assert corrected({}) == (SEEN.range, SEEN.bearing)
    assert corrected(
        {"vision.range_scale": 1.1, "vision.range_bias": 0.5, "vision.bearing_bias": 0.02}
    ) == pytest.approx((1.1 * (SEEN.range - 0.5), SEEN.bearing - 0.02))
    assert corrected({key: MEASURED[key]}) != corrected({})


def test_one_robot_has_tables_of_its_own_over_those_of_all() -> None:
    tables = {"robot": {"odometry": {"along": 0.1, "turn": 0.2}}, "robots": {"r1": {"odometry": {"turn": 0.3}}}}
    scenario = Scenario(tables)
    assert settings_of(scenario, "r1").odometry == OdometrySection(along=0.1, turn=0.3)
    assert settings_of(scenario, "r2").odometry == OdometrySection(along=0.1, turn=0.2)


@pytest.mark.parametrize(
    ("robots", "complaint"),
    [
        ({"r1": {"odometry": {"turn": -1}}}, r"robots\.r1\.odometry\.turn"),
        ({"r9": {}}, r"robots\.r9: no robot of the team has this name"),
        ({"r1": 3}, r"robots\.r1: give tables"),
        (3, "robots: give tables"),
    ],
)
def test_a_mistake_in_the_tables_of_one_robot_is_a_line(robots: object, complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        check_robots(Scenario({"team": {"sub_teams": {"a": ["r1", "r2"]}}, "robots": robots}))
