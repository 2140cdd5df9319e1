"""The laboratory as a person runs it: tables, JSON, pictures, mistakes, and Ctrl-C."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from blackboard.run.door import INTERRUPTED
from tests.processes import IN_THE_BACKGROUND, program, wait_until
from tests.system.test_demo import ROOT, blackboard

SMALL = """
[team.sub_teams]
a = ["r1", "r2", "r3"]
[grid]
shape = [24, 24]
[time]
tick = 0.5
seconds = 4
"""


@pytest.fixture
def small(tmp_path: Path) -> str:
    file = tmp_path / "small.toml"
    file.write_text(SMALL)
    return str(file)


def without_time(found: dict[str, Any]) -> dict[str, Any]:
    for trial in found["trials"].values():
        for row in [*trial["rules"].values(), trial["best"]]:
            del row["ms"]
    return found


def test_the_lab_twice_with_one_seed_says_the_same(small: str, tmp_path: Path) -> None:
    picture = tmp_path / "lab.svg"
    arguments = ("lab", small, "--runs", "3", "--variants", "2", "--json", "--picture", str(picture))
    first, second = (blackboard(*arguments) for _ in range(2))
    assert (first.returncode, first.stderr) == (0, "")
    found = json.loads(first.stdout)
    assert without_time(found) == without_time(json.loads(second.stdout))
    assert len(found["trials"]) == 8  # five trials, the team, its robots, its objects
    assert found["trials"]["team scenario"]["runs"] == 2
    assert found["trials"]["team scenario"]["cases"] > 10
    assert picture.stat().st_size > 10_000


def test_the_lab_shows_a_table_to_people() -> None:
    told = blackboard("lab", "--runs", "2")
    assert told.returncode == 0
    assert "two collude: 2 runs, 2 fusions" in told.stdout
    assert "> coalition" in told.stdout


def test_tuning_gives_a_board_table_and_its_verdict(small: str, tmp_path: Path) -> None:
    done = blackboard("tune", small, "--variants", "2", "--held-out", "2", "--every", "1", "--json")
    assert done.returncode in (0, 1), done.stderr
    found = json.loads(done.stdout)
    assert done.returncode == 1  # two held-out runs cannot tell
    assert found["gain_over_default"]["low"] is None
    assert found["recommended"]["which"] == "default"
    assert set(found["held_out"]) == {"tuned", "default", "paper"}
    assert found["held_out"]["paper"]["rule"] == {"rule": "cooperative", "k": 2.0, "gamma": 0.5}
    assert len(found["team"]["gains"]) == 2
    for choice in found["choices"].values():
        assert all(e["low"] is None for e in choice["parameters"].values())
    scenario = tmp_path / "tuned.toml"
    scenario.write_text(SMALL + found["board"])
    team = blackboard("up", str(scenario), "--seconds", "1", "--json")
    assert json.loads(team.stdout)["rule"] == found["recommended"]["rule"], team.stderr


def test_a_sweep_has_the_numbers_of_the_same_runs_as_processes(tmp_path: Path) -> None:
    team = ("--robots", "2", "--seconds", "2", "--json")
    kept = tmp_path / "runs.jsonl"
    arguments = ("demo", "--seeds", "7", "--set", "board.rule=coalition,cooperative", "--runs", str(kept), *team)
    done = blackboard("sweep", *arguments)
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["combinations"]
    for found, rule in ((first, ()), (second, ("--rule", "cooperative", "--fusion", "joint"))):
        card = json.loads(blackboard("demo", "--seed", "7", *rule, *team).stdout)
        assert found["hashes"] == {"7": card["hash"]}
        assert found["scores"]["robots"]["agreed"]["rmse"]["value"] == card["scores"]["robots"]["agreed"]["rmse"]
    again = blackboard("sweep", *arguments)
    assert again.stdout == done.stdout
    assert (again.stderr, len(kept.read_text().splitlines())) == ("", 2)


def test_the_figures_twice_are_the_same_bytes(tmp_path: Path) -> None:
    small = ("--seeds", "2", "--robots", "3", "--grids", "20", "--grids", "30", "--seconds", "4", "--every", "2")
    said = []
    for name in ("first", "second"):
        done = blackboard("figures", "--out", str(tmp_path / name), *small, *(["--json"] if name == "first" else []))
        assert done.returncode == 0, done.stderr
        said.append(done.stdout)
    told = json.loads(said[0])
    assert set(told) == {"files", *(f"fig{n}" for n in range(1, 8))}
    assert told["files"] == sorted(told["files"], key=lambda name: (name[:-4], name[-4:] != ".svg"))
    assert sorted(told["files"]) == sorted(str(path) for path in (tmp_path / "first").iterdir())
    assert said[1].splitlines() == [name.replace("/first/", "/second/") for name in told["files"]]
    files = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert files == [f"fig{n}.{ending}" for n in range(1, 8) for ending in ("png", "svg")]
    for file in files:
        assert (tmp_path / "first" / file).read_bytes() == (tmp_path / "second" / file).read_bytes(), file


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lab", "--runs", "-1"), "--runs -1: give at least 0"),
        (("lab", "--runs", "0"), "--runs 0: nothing is left to judge"),
        (("lab", "--ideal", "--runs", "1"), "--ideal and --agreed are about a team"),
        (("lab", "--protocol", "A_all"), "name its folder with --mrclam"),
        (("lab", "nowhere"), "no scenario of this name"),
        (("lab", "--runs", "1", "--picture", "lab.jpg"), "choose one of these endings"),
        (("tune", "demo", "--mrclam", "nowhere"), "give one of the two"),
        (("tune", "--mrclam", "nowhere"), "nowhere"),
        (("tune", "--seconds", "1", "--variants", "1"), "give a longer run"),
        (("tune", "--coverage", "2"), "--coverage 2: give a share of at most 1"),
        (("lab", "--every", "-1"), "--every -1: give at least 0"),
        (("figures", "--grids", "3"), "--grids 3: give at least 20"),
    ],
)
def test_mistakes_are_one_clear_line(arguments: tuple[str, ...], message: str) -> None:
    done = blackboard(*arguments)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert done.stdout == ""
    assert len(done.stderr.strip().splitlines()) == 1


def workers(pid: int) -> list[int]:
    """The processes that a process has started."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue
            state, parent = stat.rpartition(")")[2].split()[:2]
            if int(parent) == pid and state != "Z":
                found.append(int(entry.name))
    return found


@pytest.fixture
def long_run(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "blackboard", "figures", "--out", str(tmp_path), "--seconds", "500"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_it_is_stopped(long_run: subprocess.Popen[str], how: signal.Signals) -> None:
    wait_until(lambda: len(workers(long_run.pid)) > 1, "workers")
    started = workers(long_run.pid)
    long_run.send_signal(how)
    long_run.wait(20)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in started), "no worker left")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_sigint_stops_it_also_where_a_script_has_started_it_in_the_background(tmp_path: Path) -> None:
    arguments = ("-m", "blackboard", "figures", "--out", str(tmp_path), "--seconds", "500")
    with program("-c", IN_THE_BACKGROUND, *arguments) as figures:
        wait_until(lambda: len(workers(figures.running.pid)) > 1, "workers")
        figures.running.send_signal(signal.SIGINT)
        assert figures.ends() == INTERRUPTED
