"""The shared flags: what each sets in a scenario, what is refused, and that every command has the same ones."""

from pathlib import Path

import pytest
from cyclopts import App

import blackboard.__main__
import sim_world.__main__
from blackboard.config import Scenario, load
from blackboard.config.world import WorldSection
from blackboard.errors import UserError
from blackboard.run.flags import RecordingFlags, RunFlags, TeamFlags
from tests.sim_world.datasets import write

TEAM = Scenario({"team": {"sub_teams": {"a": ["x"], "b": ["y"]}}}, "team.toml")


def test_a_run_flag_replaces_what_the_scenario_says() -> None:
    changed = RunFlags(seed=7, seconds=3.0, realtime=True).apply(TEAM)
    assert changed.tables["world"] == {"seed": 7}
    assert (changed.time.seconds, changed.time.mode) == (3.0, "realtime")
    assert RunFlags().apply(TEAM).time == TEAM.time


@pytest.mark.parametrize(
    ("robots", "sub_teams"),
    [
        (2, {"a": ["r1"], "b": ["r2"]}),
        (3, {"a": ["r1", "r2"], "b": ["r3"]}),
        (6, {"a": ["r1", "r2", "r3"], "b": ["r4", "r5", "r6"]}),
    ],
)
def test_robots_are_spread_over_the_sub_teams(robots: int, sub_teams: dict[str, list[str]]) -> None:
    changed = TeamFlags(robots=robots, rule="linear").apply(TEAM)
    assert changed.team.sub_teams == sub_teams
    assert changed.board.rule == "linear"


@pytest.mark.parametrize(
    ("flags", "fusion"),
    [
        (TeamFlags(), "joint"),
        (TeamFlags(fusion="opinions"), "opinions"),
        (TeamFlags(rule="linear"), "opinions"),
        (TeamFlags(rule="linear", fusion="joint"), "joint"),
    ],
)
def test_a_rule_is_for_opinions_unless_a_joint_is_asked_for(flags: TeamFlags, fusion: str) -> None:
    assert flags.apply(load("demo")).board.fusion == fusion


def test_without_a_recording_the_demo_runs() -> None:
    assert RecordingFlags().scenario().name == load("demo").name
    assert RecordingFlags().scenario("paper").name == load("paper").name


def test_the_robots_and_the_arena_are_those_of_the_recording(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The second one drives 12 m along x, our own scenario's arena ends at 6."""
    ours = load("mrclam").grid
    write(tmp_path)
    scenario = RecordingFlags(str(tmp_path)).scenario()
    assert scenario.team.sub_teams == {"a": ["r1", "r2"]}
    assert scenario.grid == ours
    write(tmp_path, until=1120.0)
    grid = RecordingFlags(str(tmp_path)).scenario().grid
    for place in ((0.0, 0.0), (12.0, 0.0), (0.0, 1.0), (1.0, 2.0), (-1.0, 0.5)):
        assert grid.index(place) is not None
    assert max(grid.shape) <= 121
    assert not caplog.messages
    scenario = RecordingFlags(str(tmp_path)).scenario("mrclam")
    assert (scenario.grid, len(scenario.team.robots)) == (ours, 5)
    (warning,) = caplog.messages
    assert warning == f"[grid] of mrclam: robots of {tmp_path} leave it, and are lost there; enlarge it"
    for robot in (1, 2):  # the world says that these are empty
        (tmp_path / f"Robot{robot}_Groundtruth.dat").write_text("# nothing\n")
    assert (
        RecordingFlags(str(tmp_path)).scenario().grid == RecordingFlags(str(tmp_path)).scenario("mrclam").grid == ours
    )


def test_a_recording_is_replayed() -> None:
    scenario = RecordingFlags("folder", 5.0, "A_all").scenario()
    assert scenario.name == "mrclam"
    world = scenario.tables["world"]
    assert (world["kind"], world["dir"], world["start"], world["protocol"]) == ("mrclam", "folder", 5.0, "A_all")


def test_a_scenario_of_a_recording_takes_another_start() -> None:
    assert RecordingFlags(start=5.0).scenario("mrclam").tables["world"]["start"] == 5.0


@pytest.mark.parametrize("flags", [RecordingFlags(start=5.0), RecordingFlags(protocol="A_all")])
def test_where_nothing_is_replayed_its_flags_are_a_mistake(flags: RecordingFlags) -> None:
    for name in (None, "paper"):
        with pytest.raises(UserError, match="--start and --protocol are about a recording"):
            flags.scenario(name)


def test_the_barcodes_of_mates_are_stripped_where_a_recording_is_replayed() -> None:
    scenario = RecordingFlags("folder", anonymous="mates").scenario()
    assert scenario.section("world", WorldSection).detector.anonymous == ("robot",)
    with pytest.raises(UserError, match="--anonymous is about a recording; for a simulated world set world.detector"):
        RecordingFlags(anonymous="mates").scenario()
    with pytest.raises(
        UserError, match="--anonymous all: the map of a recording is in its folder; name it with --mrclam"
    ):
        RecordingFlags(pyfg="file", anonymous="all").scenario()


COMMANDS = [
    ("demo", blackboard.__main__.app, "seed seconds realtime series mrclam start protocol robots rule json"),
    ("up team.toml", blackboard.__main__.app, "seed seconds realtime table robots rule json"),
    ("lab", blackboard.__main__.app, "seed seconds mrclam start protocol json"),
    ("tune", blackboard.__main__.app, "seed seconds mrclam start protocol json"),
    ("", sim_world.__main__.app, "seed seconds realtime series mrclam start protocol json"),
    ("score", blackboard.__main__.app, "seconds mrclam start protocol json"),
]
VALUES = dict.fromkeys(("seed", "seconds", "mrclam", "start", "protocol"), "1")
VALUES |= {"robots": "2", "rule": "linear", "series": "x.csv", "table": "x.parquet"}


@pytest.mark.parametrize(("command", "app", "flags"), COMMANDS, ids=["demo", "up", "lab", "tune", "sim-world", "score"])
def test_a_command_takes_the_shared_flags(command: str, app: App, flags: str) -> None:
    words = [word for flag in flags.split() for word in (f"--{flag}", VALUES.get(flag)) if word is not None]
    app.parse_args([*command.split(), *words], exit_on_error=False, print_error=False)


FRACTIONS = [
    (blackboard.__main__.app, "demo --seed 1.5", "--seed 1.5"),
    (blackboard.__main__.app, "demo --robots 3.6", "--robots 3.6"),
    (blackboard.__main__.app, "echo cop/** --count=60.7", "--count 60.7"),
    (blackboard.__main__.app, "figures --grids 50 --grids 99.5", "--grids 99.5"),
    (blackboard.__main__.app, "replay x.mcap --seed -1.5", "--seed -1.5"),
    (blackboard.__main__.app, "keys init --robots 2.5", "--robots 2.5"),
    (blackboard.__main__.app, "chaos --seed 1.5e0", "--seed 1.5e0"),
    (sim_world.__main__.app, "--seed 0.5", "--seed 0.5"),
]


@pytest.mark.parametrize(("app", "command", "says"), FRACTIONS)
def test_a_fraction_is_no_whole_number(app: App, command: str, says: str) -> None:
    with pytest.raises(UserError) as error:
        app.parse_args(command.split(), exit_on_error=False, print_error=False)
    assert str(error.value) == f"{says}: give a whole number"


def test_a_whole_number_and_a_length_with_a_fraction_are_taken() -> None:
    _, bound, _ = blackboard.__main__.app.parse_args("demo --robots 3.0 --seconds 1.5", exit_on_error=False)
    how = bound.arguments["how"]
    assert (how.team.robots, how.run.seconds) == (3, 1.5)
