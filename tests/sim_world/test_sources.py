"""Which source a scenario asks for, and that chance comes in from outside."""

from pathlib import Path

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.errors import UserError
from sim_world.mrclam.replay import MrclamSource
from sim_world.sources import open_sensor_source, seeded_streams
from sim_world.world import World
from tests.sim_world.datasets import write

SCENARIO = Scenario({"team": {"sub_teams": {"a": ["r1", "r2"]}}, "time": {"tick": 0.5, "seconds": 4.0}})


def test_by_default_the_world_is_simulated() -> None:
    asked: list[str] = []

    def streams(name: str) -> np.random.Generator:
        asked.append(name)
        return np.random.default_rng(len(asked))

    source = open_sensor_source(SCENARIO, streams)
    assert isinstance(source, World)
    assert (source.robots, source.dt) == (("r1", "r2"), 0.5)
    source.advance("x", 0)
    assert {"robot/r1", "robot/r2", "odometer/r1", "start/ball"} <= set(asked)
    assert len(asked) == len(set(asked))  # each is taken up once


def test_a_recording_needs_no_chance(tmp_path: Path) -> None:
    write(tmp_path)

    def streams(name: str) -> np.random.Generator:
        raise AssertionError(name)

    source = open_sensor_source(SCENARIO.changed("world", kind="mrclam", dir=str(tmp_path), start=1001.0), streams)
    assert isinstance(source, MrclamSource)
    assert (source.robots, source.start, source.dt) == (("r1", "r2"), 1001.0, 0.5)
    source.advance("x", 0)
    with pytest.raises(UserError, match=r"time\.seconds: 40 s reach beyond the recording"):
        open_sensor_source(
            SCENARIO.changed("world", kind="mrclam", dir=str(tmp_path)).changed("time", seconds=40.0), streams
        )


def test_the_doors_streams_depend_on_seed_and_name() -> None:
    first, same = seeded_streams(1), seeded_streams(1)
    other = seeded_streams(2)
    assert first("a").random() == same("a").random() == first("a").random()
    assert len({first("a").random(), first("b").random(), other("a").random()}) == 3
