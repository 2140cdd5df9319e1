"""The commands as a person runs them: real processes, real Zenoh, on 127.0.0.1."""

import json
import re
import signal
from pathlib import Path

import pytest

from blackboard.config import load
from blackboard.errors import UserError
from blackboard.lab.team import InProcessTeam
from blackboard.run.door import INTERRUPTED
from blackboard.run.flags import TeamFlags
from tests.commands import blackboard, call
from tests.files import DATASET7, needs_dataset7
from tests.mistakes import one_line
from tests.processes import children, is_running, program, wait_until
from tests.scenarios import patient_demo


def test_the_same_scenario_and_seed_twice_are_identical_to_the_bit(tmp_path: Path) -> None:
    """Once in processes, with samples as a table and pictures, which change nothing, and once in one process."""
    pytest.importorskip("matplotlib", reason="needs the extra `plot`")
    table, folder = tmp_path / "run.jsonl", tmp_path / "pictures"
    words = ("up", patient_demo(tmp_path), "--robots", "2", "--seconds", "2", "--seed", "7", "--json")
    run = blackboard(*words, "--table", str(table), "--plot", str(folder))
    card = json.loads(run.stdout)
    scores = card["scores"]
    assert card["ticks"] == 10
    assert scores["robots"]["agreed"]["n"] == 2 * 10
    assert card["messages"]["refused"] == {}
    assert run.returncode == (0 if card["verdict"] == "PASS" else 1)
    in_one_process = InProcessTeam(
        TeamFlags(robots=2).apply(load("demo")).changed("world", seed=7).changed("time", seconds=2.0)
    ).run()
    assert in_one_process["hash"] == card["hash"]
    assert in_one_process["scores"] == scores
    rows = [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()]
    assert len(rows) == sum(
        scores[group][level]["n"] for group in ("robots", "objects") for level in scores["robots"] if level != "by_name"
    )
    drawn = [line.removeprefix("drawn: ") for line in run.stderr.splitlines() if line.startswith("drawn: ")]
    assert sorted(drawn) == sorted(str(path) for path in folder.iterdir())
    assert len(drawn) == 4


@pytest.mark.long
def test_more_robots_and_real_time() -> None:
    run = blackboard("demo", "--robots", "8", "--seconds", "3", "--realtime", "--json")
    card = json.loads(run.stdout)
    assert card["mode"] == "realtime"
    assert card["ticks"] == 15
    scored = {f"robot/{name}" for name in card["scores"]["robots"]["by_name"]}
    # A slow machine comes too late for some samples, and the card then names the robots that lack them.
    assert scored | card["missing"].keys() >= {f"robot/r{i}" for i in range(1, 9)}


def test_ctrl_c_in_the_middle_gives_the_scorecard_until_then_and_leaves_no_orphan() -> None:
    with program("-m", "blackboard", "demo", "--robots", "2", "--seconds", "20", "--json") as demo:
        wait_until(lambda: len(children(demo.running.pid)) == 6, "a router, two boards, two robots and the world run")
        demo.says("tick 0 of 100")
        wait_until(lambda: "tick 10 of 100" in demo.err, "some ticks are done")
        family = children(demo.running.pid)
        demo.running.send_signal(signal.SIGINT)
        assert demo.ends() == INTERRUPTED, demo.err
        wait_until(lambda: not any(is_running(pid) for pid in family), "all children are gone")
        card = json.loads(demo.out)
        assert 10 <= card["ticks"] < 100
        assert card["verdict"] == "FAIL"
        assert card["reasons"][0] == f"stopped in tick {card['ticks']} of 100"
        assert card["scores"]["robots"]["agreed"]["n"] >= 2 * 9
        assert "Traceback" not in demo.err


def test_no_orphan_is_left_when_the_launcher_is_killed() -> None:
    with program("-m", "blackboard", "demo", "--robots", "2", "--seconds", "600", "--json") as demo:
        wait_until(lambda: len(children(demo.running.pid)) == 6, "six children run")
        family = children(demo.running.pid)
        demo.running.kill()
        wait_until(lambda: not any(is_running(pid) for pid in family), "all children are gone")


@pytest.mark.parametrize(
    ("text", "field"),
    [("[grid]\nshap = [50, 50]", "grid.shap"), ("[team", "TOML"), ("[robot.vision]\ngian = 1", "robot.vision.gian")],
)
def test_a_mistake_in_a_scenario_is_one_line_with_file_and_field(tmp_path: Path, text: str, field: str) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    with one_line(f"^{re.escape(str(file))}.*{re.escape(field)}"):
        call("up", file)


def test_a_folder_without_a_recording_is_one_line(tmp_path: Path) -> None:
    """The launcher passes on what a child says (tests/run/test_launch.py)."""
    with program("-m", "sim_world", "--mrclam", str(tmp_path)) as run:
        assert run.ends() == 2
        assert str(tmp_path) in run.err.strip().splitlines()[-1]


def test_for_a_folder_that_is_not_there_nothing_is_started() -> None:
    with pytest.raises(UserError, match=r"^world.dir: no folder /no/such/folder; .*$"):
        call("demo", "--mrclam", "/no/such/folder")


@pytest.mark.long
@needs_dataset7
def test_the_recorded_team_runs_as_processes() -> None:
    """The first 20 seconds: five real robots, everything over Zenoh; the whole window is in benchmarks."""
    arguments = ("--start", "1248446200", "--seconds", "20", "--protocol", "C_blind12", "--json")
    run = blackboard("demo", "--mrclam", str(DATASET7), *arguments)
    card = json.loads(run.stdout)
    assert card["unit"] == "m"
    assert card["scores"]["robots"]["agreed"]["n"] == 100
    assert card["team_rmse"]["agreed"] < 0.3
    assert card["team_rmse"]["agreed"] < card["team_rmse"]["solo"]
