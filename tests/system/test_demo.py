"""The commands as a person runs them: real processes, real Zenoh, on 127.0.0.1."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from blackboard.config import load
from blackboard.lab.bench import SOLO
from blackboard.lab.team import Team
from blackboard.run.door import INTERRUPTED
from tests.processes import children, is_running, program, wait_until

ROOT = Path(__file__).parents[2]
RECORDING = ROOT.parent / "shared" / "mrclam" / "dataset7"
PYTHON = (sys.executable, "-m")


def blackboard(*arguments: str, timeout: float = 110) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PYTHON, "blackboard", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=timeout, check=False
    )


@pytest.fixture
def launched() -> Iterator[subprocess.Popen[str]]:
    """A long run, killed at the end whatever happens."""
    command = [*PYTHON, "blackboard", "demo", "--seconds", "600", "--json"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        left = children(process.pid)
        for pid in [process.pid, *left]:
            if is_running(pid):
                os.kill(pid, signal.SIGKILL)
        process.communicate()


def test_the_same_scenario_and_seed_twice_are_identical_to_the_bit() -> None:
    runs = [blackboard("demo", "--seconds", "4", "--seed", "7", "--json") for _ in range(2)]
    first, second = (json.loads(run.stdout) for run in runs)
    assert first["hash"] == second["hash"]
    assert first["ticks"] == 20
    assert first["scores"]["robots"]["agreed"]["n"] == 6 * 20
    assert first["messages"]["refused"] == {}
    assert {run.returncode for run in runs} <= {0, 1}
    assert (runs[0].returncode == 0) == (first["verdict"] == "PASS")
    in_one_process = Team(load("demo").changed("world", seed=7).changed("time", seconds=4.0)).run()
    assert in_one_process["hash"] == first["hash"]
    assert in_one_process["scores"] == first["scores"]


def test_the_samples_of_a_run_come_out_as_a_table_and_pictures(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra `plot`")
    table, folder = tmp_path / "run.jsonl", tmp_path / "pictures"
    run = blackboard("demo", "--seconds", "2", "--json", "--table", str(table), "--plot", str(folder))
    scores = json.loads(run.stdout)["scores"]
    rows = [json.loads(line) for line in table.read_text(encoding="utf-8").splitlines()]
    assert len(rows) == sum(
        scores[group][level]["n"] for group in ("robots", "objects") for level in scores["robots"] if level != "by_name"
    )
    drawn = [line.removeprefix("drawn: ") for line in run.stderr.splitlines() if line.startswith("drawn: ")]
    assert sorted(drawn) == sorted(str(path) for path in folder.iterdir())
    assert len(drawn) == 4


def test_more_robots_and_real_time() -> None:
    run = blackboard("demo", "--robots", "8", "--seconds", "3", "--realtime", "--json")
    card = json.loads(run.stdout)
    assert set(card["scores"]["robots"]["by_name"]) == {f"r{i}" for i in range(1, 9)}
    assert card["mode"] == "realtime"


def test_ctrl_c_stops_all_and_leaves_no_orphan(launched: subprocess.Popen[str]) -> None:
    wait_until(lambda: len(children(launched.pid)) == 10, "ten children run")
    family = children(launched.pid)
    launched.send_signal(signal.SIGINT)
    launched.communicate(timeout=30)
    wait_until(lambda: not any(is_running(pid) for pid in family), "all children are gone")


def test_ctrl_c_in_the_middle_gives_the_scorecard_until_then() -> None:
    with program("-m", "blackboard", "demo", "--robots", "2", "--seconds", "120", "--json") as demo:
        wait_until(lambda: len(children(demo.running.pid)) == 6, "a router, two boards, two robots and the world run")
        demo.says("tick 0 of 600")
        wait_until(lambda: "tick 60 of 600" in demo.err, "some ticks are done")
        demo.running.send_signal(signal.SIGINT)
        assert demo.ends() == INTERRUPTED, demo.err
        card = json.loads(demo.out)
        assert 60 <= card["ticks"] < 600
        assert card["verdict"] == "FAIL"
        assert card["reasons"][0] == f"stopped in tick {card['ticks']} of 600"
        assert card["scores"]["robots"]["agreed"]["n"] >= 2 * 59
        assert "Traceback" not in demo.err


def test_no_orphan_is_left_when_the_launcher_is_killed(launched: subprocess.Popen[str]) -> None:
    wait_until(lambda: len(children(launched.pid)) == 10, "ten children run")
    family = children(launched.pid)
    launched.kill()
    wait_until(lambda: not any(is_running(pid) for pid in family), "all children are gone")


@pytest.mark.parametrize(
    ("text", "field"),
    [("[grid]\nshap = [50, 50]", "grid.shap"), ("[team", "TOML"), ("[robot.vision]\ngian = 1", "robot.vision.gian")],
)
def test_a_mistake_in_a_scenario_is_one_line_with_file_and_field(tmp_path: Path, text: str, field: str) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    run = blackboard("up", str(file))
    assert run.returncode == 2
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("error: ")
    assert field in last
    assert run.stdout == ""


@pytest.mark.parametrize("folder", ["", "/no/such/folder"])
def test_a_missing_recording_is_one_line(folder: str, tmp_path: Path) -> None:
    run = blackboard("demo", "--mrclam", folder or str(tmp_path))
    assert run.returncode == 2
    assert (folder or str(tmp_path)) in run.stderr.strip().splitlines()[-1]


def test_the_recorded_team_runs_as_processes() -> None:
    """The first 20 seconds: five real robots, everything over Zenoh; the whole window is in benchmarks."""
    if not RECORDING.is_dir():
        pytest.skip("needs the MRCLAM recording in ../shared/mrclam/dataset7")
    arguments = ("--start", "1248446200", "--seconds", "20", "--protocol", "C_blind12", "--json")
    run = blackboard("demo", "--mrclam", str(RECORDING), *arguments)
    card = json.loads(run.stdout)
    assert card["unit"] == "m"
    assert card["scores"]["robots"]["agreed"]["n"] == 100
    assert card["team_rmse"]["agreed"] < 0.3
    assert card["team_rmse"]["agreed"] < card["team_rmse"]["solo"]


def test_the_recorded_team_is_scored(tmp_path: Path) -> None:
    """Ten seconds of each fusion, as processes: the numbers of the table are the scorecards' own."""
    if not RECORDING.is_dir():
        pytest.skip("needs the MRCLAM recording in ../shared/mrclam/dataset7")
    arguments = (
        "--start",
        "1248446200",
        "--seconds",
        "10",
        "--protocol",
        "C_blind12",
        "--json",
        "--runs",
        str(tmp_path),
    )
    run = blackboard("score", "--mrclam", str(RECORDING), *arguments)
    assert run.returncode == 0, run.stderr
    scores = json.loads(run.stdout)["protocols"]["C_blind12"]["scores"]
    assert list(scores) == ["team", "r1", "r2", "r3", "r4", "r5"]
    for fusion in ("opinions", "joint"):
        card = json.loads((tmp_path / f"C_blind12-{fusion}.json").read_text())["card"]
        assert card["fusion"] == fusion
        for level, way in (("solo", SOLO[fusion]), ("agreed", fusion)):
            told, found = card["scores"]["robots"][level], scores["team"][way]
            for name in ("n", "rmse", "mean", "p95", "max", "log_score"):
                assert found[name] == pytest.approx(told[name])
            assert {k: c["value"] for k, c in found["coverage"].items()} == pytest.approx(told["coverage"])
