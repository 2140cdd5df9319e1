"""The laboratory as a person runs it: tables, JSON, pictures, mistakes, and Ctrl-C."""

import json
import re
import signal
import sys
from pathlib import Path

import pytest

from blackboard.run.door import INTERRUPTED
from tests.commands import blackboard, call
from tests.mistakes import one_line
from tests.processes import IN_THE_BACKGROUND, program, wait_until
from tests.scenarios import SMALL_FILE


@pytest.fixture
def small(tmp_path: Path) -> str:
    file = tmp_path / "small.toml"
    file.write_text(SMALL_FILE)
    return str(file)


def test_the_lab_shows_a_table_to_people() -> None:
    ran = blackboard("lab", "--runs", "2")
    assert ran.returncode == 0
    assert "two collude: 2 runs, 2 fusions" in ran.stdout
    assert "> coalition" in ran.stdout


@pytest.mark.long
def test_tuning_gives_a_board_table_and_its_verdict(small: str, tmp_path: Path) -> None:
    done = blackboard("tune", small, "--variants", "2", "--held-out", "2", "--every", "1", "--json")
    assert done.returncode in (0, 1), done.stderr
    report = json.loads(done.stdout)
    assert done.returncode == 1  # two held-out runs cannot tell
    assert report["gain_over_default"]["low"] is None
    assert report["recommended"]["which"] == "default"
    assert set(report["held_out"]) == {"tuned", "default", "paper"}
    assert report["held_out"]["paper"]["rule"] == {"rule": "cooperative", "k": 2.0, "gamma": 0.5}
    assert len(report["team"]["gains"]) == 2
    for choice in report["choices"].values():
        assert all(e["low"] is None for e in choice["parameters"].values())
    scenario = tmp_path / "tuned.toml"
    scenario.write_text(SMALL_FILE + report["board"])
    team = blackboard("up", str(scenario), "--seconds", "1", "--json")
    assert json.loads(team.stdout)["rule"] == report["recommended"]["rule"], team.stderr


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
    with one_line(re.escape(message)):
        call(*arguments)


def workers(pid: int) -> list[int]:
    """The processes that a process has started."""
    pids = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text()
            except OSError:
                continue
            state, parent = stat.rpartition(")")[2].split()[:2]
            if int(parent) == pid and state != "Z":
                pids.append(int(entry.name))
    return pids


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL, signal.SIGINT])
def test_nothing_is_left_when_it_is_stopped(how: signal.Signals) -> None:
    """Also by SIGINT where a script has started it in the background."""
    arguments = ("-m", "blackboard", "lab", "demo", "--runs", "0", "--seconds", "500")
    with program("-c", IN_THE_BACKGROUND, *arguments) as lab:
        wait_until(lambda: len(workers(lab.running.pid)) > 1, "workers")
        started = workers(lab.running.pid)
        lab.running.send_signal(how)
        wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in started), "no worker left")
        assert lab.ends() == {signal.SIGKILL: -how, signal.SIGINT: INTERRUPTED}.get(how, 128 + how)
