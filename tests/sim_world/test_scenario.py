"""The [world] tables: what ships is sound, and a fault is one line with file, field and cure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from blackboard.config import Scenario, load
from blackboard.config.protocols import PROTOCOLS
from blackboard.config.world import GAINS, WorldSection
from blackboard.errors import UserError
from blackboard.run.flags import RecordingFlags, RunFlags
from robot_agent.config import RobotSection
from sim_world.__main__ import sim_world
from sim_world.sources import open_sensor_source
from sim_world.world import World
from tests.mistakes import one_line
from tests.sim_world.datasets import write

SHIPPED = ("demo", "paper", "mrclam")


@pytest.mark.parametrize("name", SHIPPED)
def test_what_ships_is_sound(name: str) -> None:
    scenario = load(name)
    assert scenario.name == scenario.team.name == name
    assert scenario.board.rule
    world, robot = scenario.section("world", WorldSection), scenario.section("robot", RobotSection)
    assert (world.kind == "mrclam") == (robot.localizer == "pose") == (scenario.grid.unit == "m")
    assert scenario.time.mode == "lockstep"
    if world.kind == "simulated":
        assert isinstance(open_sensor_source(scenario), World)
        assert robot.vision.gain == world.vision.scale  # by default a robot's model is right
        assert robot.odometry.along == world.odometry.along * world.speed**0.5


def test_the_demo_is_the_demo() -> None:
    scenario = load("demo")
    assert {team: len(robots) for team, robots in scenario.team.sub_teams.items()} == {"a": 3, "b": 3}
    assert len(scenario.section("world", WorldSection).objects) == 2
    assert (scenario.grid.shape, scenario.time.seconds) == ((50, 50), 60.0)


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"sed": 1}, r"it\.toml: world\.sed: no such key; did you mean seed\?; known are check, comeback, detector"),
        (
            {"vision": {"presett": "paper"}},
            r"it\.toml: world\.vision\.presett: no such key; did you mean preset\?; known are floor, gain, half_angle",
        ),
        (
            {"vision": {"preset": "sonar"}},
            r"it\.toml: world\.vision\.preset: give \"paper\" or \"camera\" \(got 'sonar'\)",
        ),
        ({"objects": {"a b": {}}}, r"it\.toml: world\.objects\.a b: give a name of up to 64 letters"),
        ({"speed": -1}, r"it\.toml: world\.speed: give a number above 0 \(got -1\)"),
        ({"protocol": "Z"}, r"it\.toml: world\.protocol: .*no protocol of this name; use one of A_all, B_turns"),
        ({"protocol": "O1_landmark"}, r"it\.toml: world\.protocol: .*a run for each object; use one of O1_landmark6"),
    ],
)
def test_a_fault_names_file_field_and_cure(table: Mapping[str, Any], text: str) -> None:
    with one_line(text):
        Scenario({"world": table}, "it.toml").section("world", WorldSection)


def test_presets_set_the_gain_unless_one_is_given() -> None:
    def gain(**vision: object) -> float:
        return WorldSection.model_validate({"vision": vision}).vision.scale

    assert gain(preset="paper") == GAINS["paper"] == 1.0
    assert gain() == GAINS["camera"]
    assert gain(preset="paper", gain=0.3) == 0.3


def test_who_is_lost() -> None:
    everybody = range(1, 6)
    lost = {name: [robot for robot in everybody if protocol.lost(robot)] for name, protocol in PROTOCOLS.items()}
    assert {name: who for name, who in lost.items() if who} == {"G_wake": [1, 2, 3, 4, 5], "H_lost12": [1, 2]}


def test_the_door_turns_flags_into_a_scenario(tmp_path: Path) -> None:
    write(tmp_path)
    with pytest.raises(UserError, match=r"world\.dir: .*--mrclam DIR"):
        sim_world("mrclam")
    with pytest.raises(UserError, match=r"team\.sub_teams: .* has no robot r3"):
        sim_world("mrclam", recording=RecordingFlags(mrclam=str(tmp_path)))
    with pytest.raises(UserError, match=r"time\.seconds: 600 s reach beyond the recording; use at most 20"):
        sim_world(recording=RecordingFlags(mrclam=str(tmp_path)))
    with pytest.raises(UserError, match=r"world\.protocol"):
        sim_world(recording=RecordingFlags(mrclam=str(tmp_path), protocol="X"))
    with pytest.raises(UserError, match=r"nowhere\.toml: cannot be read .*; give"):
        sim_world(str(tmp_path / "nowhere.toml"))
    with pytest.raises(UserError, match=r"time\.seconds: give a number above 0 "):
        sim_world("demo", run=RunFlags(seconds=-1.0))
    with pytest.raises(UserError, match=r"world\.seed"):
        sim_world("demo", run=RunFlags(seed=-1))
