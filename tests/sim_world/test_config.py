"""Every key of [world] does something: another value changes what is true or what is measured."""

from pathlib import Path
from typing import Any

import pytest

from blackboard.config import Scenario
from blackboard.config.world import CheckSection, WorldSection
from blackboard.run.overrides import with_settings
from blackboard.wire.messages import Readings, Truth
from sim_world.sources import open_sensor_source
from tests.scenarios import keys_of
from tests.sim_world.datasets import write

SIMULATED: dict[str, Any] = {
    "seed": 2,
    "speed": 0.7,
    "turn_rate": 0.8,
    "lost": ["r1"],
    "objects": {"ball": {"drift": 0.2, "start": [10.0, 10.0]}},
    "vision.preset": "paper",
    "vision.gain": 0.3,
    "vision.floor": 0.9,
    "vision.half_angle": 0.5,
    "odometry.along": 0.6,
    "odometry.turn": 0.1,
    "odometry.compass": 0.1,
    "odometry.reset_after": 1.0,
    "odometry.fix": 0.1,
    "people.count": 2,
    "detector.anonymous": ["robot"],
    "detector.missed": 0.5,
    "detector.clutter": 2.0,
}
RECORDED: dict[str, Any] = {"start": 1001.0, "protocol": "G_wake", "odometry_lag": 0.0, "sighting_latency": 0.1}

#: What is tested elsewhere: which source (test_sources), where a robot of a factor graph starts (test_pyfg), the referee's limits (test_referee), the rest of the detector (test_detector), seconds of waiting (test_world_service).
ELSEWHERE = {
    *("kind", "dir", "gather", "patience", "give_up", "grace", "comeback", "linger"),
    *("start_sigma", "start_heading"),
    *("people.speed", "detector.exchanged", "detector.body"),
    *(f"check.{name}" for name in CheckSection.model_fields),
}


def story(world: dict[str, Any], key: str | None = None, value: Any = None) -> list[tuple[Truth, list[Readings]]]:
    """Twenty ticks of a scenario with one key of [world] changed."""
    team = {"sub_teams": {"a": ["r1", "r2"]}}
    scenario = Scenario({"team": team, "time": {"tick": 0.5, "seconds": 10.0}, "world": world})
    source = open_sensor_source(with_settings(scenario, {} if key is None else {f"world.{key}": value}))
    return [source.advance("run", tick) for tick in range(20)]


def test_every_key_is_here() -> None:
    assert set(keys_of(WorldSection)) == {*SIMULATED, *RECORDED, *ELSEWHERE}


@pytest.mark.parametrize("key", SIMULATED)
def test_another_value_is_another_world(key: str) -> None:
    assert story({}, key, SIMULATED[key]) != story({})


@pytest.mark.parametrize("key", RECORDED)
def test_another_value_is_another_replay(key: str, tmp_path: Path) -> None:
    write(tmp_path)
    world = {"kind": "mrclam", "dir": str(tmp_path)}
    assert story(world, key, RECORDED[key]) != story(world)
    assert story(world) == story(world)
