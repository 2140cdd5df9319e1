"""`blackboard calibrate`: on a tape of simulated readings, and on the recording whose numbers are known."""

import io
import json
import statistics
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from blackboard.config import Scenario, load
from blackboard.tape.file import TapeWriter
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from robot_agent.config import check_robots, settings_of
from tests.calibrate.teams import Robot, team
from tests.commands import Ran, blackboard
from tests.files import DATASET7

DATASET9 = DATASET7.with_name("dataset9")


def taped(
    path: Path, readings: bool = True, seconds: float = 90.0, stamped: Callable[[float], float] = lambda time: time
) -> Path:
    """A tape with what two robots measured, and their scenario."""
    file, scenario = io.BytesIO(), load("mrclam").changed("team", sub_teams={"a": ["r1", "r2"]})
    writer = TapeWriter(file, {"team": "mrclam", "scenario": scenario.to_json()})
    for measured in team([Robot(arc_turn=0.6), Robot()], seconds, 1) if readings else ():
        said = measured.model_copy(update={"time": stamped(measured.time)})
        writer.write(1e9 + measured.time, Envelope(keys.READING.key(team="mrclam", robot=said.robot), encode(said)))
    writer.close()
    path.write_bytes(file.getvalue())
    return path


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taped(tmp_path_factory.mktemp("tape") / "run.mcap")


def test_a_tape_gives_tables_that_a_scenario_takes(tape: Path) -> None:
    ran = Ran("calibrate", str(tape))
    assert ran.status == 0, ran.err
    text, _, tables = ran.out.partition("# Found by blackboard calibrate")
    assert "turn, arc" in text
    assert "nats for each reading" in text
    pasted = Scenario({**load("mrclam").tables, **tomllib.loads("#" + tables)})
    check_robots(pasted)
    odometry = settings_of(pasted, "r1").odometry
    assert odometry.measured
    assert odometry.curve_turn_scale == pytest.approx(0.6, abs=0.05)
    assert settings_of(pasted, "r2").odometry.curve_turn_scale == pytest.approx(1.0, abs=0.05)


def test_as_json_there_is_nothing_else_also_where_residuals_are_drawn(tape: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra `plot`")
    ran = Ran("calibrate", str(tape), "--json", "--plot", str(tmp_path))
    report = json.loads(ran.out)
    assert list(report["robots"]) == ["r1", "r2"]
    assert report["nats"]["found"] > report["nats"]["the scenario's"]
    assert {file.name for file in tmp_path.glob("*.png")} == {"residuals-r1.png", "residuals-r2.png", "ways.png"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((), "give either a tape or a recording"),
        (("{tape}", "--mrclam", "x"), "give either a tape or a recording"),
        (("{tape}", "--track", "0"), "--track 0: give the distance"),
        (("{empty}",), "no readings are on it"),
        (("{short}",), "nothing says where the robots are"),
        (("{far}",), "the times of the readings jump by 1e+11 s"),
    ],
)
def test_a_mistake_is_a_line(words: tuple[str, ...], complaint: str, tape: Path, tmp_path: Path) -> None:
    empty = taped(tmp_path / "empty.mcap", readings=False)
    short = taped(tmp_path / "short.mcap", seconds=0.0)  # one tick
    far = taped(tmp_path / "far.mcap", stamped=lambda time: time + 1e11 * (time > 20.0))
    made = {"tape": tape, "empty": empty, "short": short, "far": far}
    ran = Ran("calibrate", *(word.format(**made) for word in words))
    assert ran.status != 0
    assert complaint in ran.err
    assert len(ran.err.strip().splitlines()) == 1


def test_a_tick_that_ends_before_others_is_left_out(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        back = taped(tmp_path / "x.mcap", stamped=lambda time: time - 20.0 * (40.0 < time < 41.0))
        ran = Ran("calibrate", str(back), "--json")
    assert ran.status == 0, ran.err
    numbers = json.loads(ran.out)["robots"]["r1"]["numbers"]
    assert numbers["turn, arc"]["value"] == pytest.approx(0.6, abs=0.05)


@pytest.mark.skipif(not DATASET9.is_dir(), reason="needs the MRCLAM recording in ../shared/mrclam/dataset9")
def test_what_the_recorded_robots_do_of_what_they_are_told_is_found() -> None:
    """Against what the recording's page measured with the truth: to 10 %, half of the window and no truth."""
    flags = ("--mrclam", str(DATASET9), "--start", "1288972460", "--seconds", "400", "--json")
    run = blackboard("calibrate", *flags, timeout=300)
    assert run.returncode == 0, run.stderr
    report = json.loads(run.stdout)
    numbers = [robot["numbers"] for robot in report["robots"].values()]
    drifts = [robot["drift"]["value"] for robot in numbers]
    pasted = [tables["odometry"]["drift"] for tables in report["scenario"]["robots"].values()]
    assert pasted == pytest.approx(drifts, abs=1e-4), (
        "all robots drift to one side: a team without landmarks cannot see it"
    )
    for name, low, high in (("turn, arc", 0.58, 0.66), ("turn, spin", 1.02, 1.06), ("way, straight", 1.02, 1.05)):
        values = [robot[name]["value"] for robot in numbers if robot[name] is not None and robot[name]["within"] < 0.1]
        assert values, name
        assert all(0.9 * low < value < 1.1 * high for value in values), (name, values)
    lags = [robot["lag"]["value"] for robot in numbers]
    assert statistics.mean(lags) == pytest.approx(0.10, rel=0.15)
