"""The commands as a person runs them: a whole team behind its door, and a team's keys made, added to, renewed and revoked."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from blackboard.config import Scenario, load
from blackboard.lab.team import InProcessTeam
from blackboard.net.settings import LinkConfig
from blackboard.run.flags import TeamFlags
from blackboard.run.launch import process_table
from tests.commands import blackboard, call
from tests.mistakes import one_line
from tests.scenarios import patient_demo

SHORT = ("--robots", "3", "--seconds", "2", "--json")


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("team") / "keys"
    made = blackboard("keys", "init", "demo", "--robots", "3", "--dir", str(where))
    assert made.returncode == 0, made.stderr
    assert "an authority for team demo and 12 certificates" in made.stdout
    return where


@pytest.mark.system
def test_with_keys_the_hash_of_an_undisturbed_demo_is_the_same_and_nobody_is_denied(
    directory: Path, tmp_path: Path
) -> None:
    run = blackboard("up", patient_demo(tmp_path), *SHORT, "--keys", str(directory))
    secure = json.loads(run.stdout)
    # in one process, which has the hash of the processes without keys (tests/system/test_demo.py)
    plain = InProcessTeam(TeamFlags(robots=3).apply(load("demo")).changed("time", seconds=2.0)).run()
    assert secure["hash"] == plain["hash"]
    assert secure["messages"]["refused"] == plain["messages"]["refused"] == {}
    assert "denied" not in run.stdout + run.stderr
    assert "tls/127.0.0.1" in run.stderr


@pytest.mark.system
def test_a_robot_without_a_certificate_ends_the_run_in_one_line(directory: Path) -> None:
    done = blackboard("demo", "--robots", "4", "--seconds", "4", "--keys", str(directory))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1, done.stderr
    line = done.stderr
    # r3 in a sub-team that its certificate does not name, or r4 without one: who is read first
    assert line.startswith("error: ")
    assert "robot/r3: its certificate" in line or "no certificate of robot/r4" in line


def test_what_must_be_restarted_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = str(tmp_path / "keys")

    def say(*arguments: str) -> str:
        assert call("keys", *arguments, "--dir", where) == 0
        return capsys.readouterr().out

    assert "an authority for team demo and 12 certificates" in say(
        "init", "demo", "--robots", "3", "--name", "base.local"
    )
    added = say("add", "r9", "--sub-team", "b")
    assert "a certificate for robot/r9 in sub-team b" in added
    assert f"restart the router with {where}/router" in added
    assert "restart, with their new folders: robot/r9\n" in say("renew", "r9")
    revoked = say("revoke", "r9")
    assert "UNTIL THEN ROBOT/R9 MAY STILL DO EVERYTHING IT COULD" in revoked
    assert "nobody else" in revoked
    listed = say("list")
    assert ["robot/r9/1", "revoked"] in [line.split() for line in listed.splitlines()]
    assert "(365 days)" in listed


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("init",), "has an authority already"),
        (("add", "r1"), "r1 has a certificate already"),
        (("add", "x", "--kind", "viewer"), "a team has one viewer"),
        (("renew", "--days", "0"), "--days 0: give 0.04 to 3650"),
        (("revoke", "r77"), "r77: nobody of this name"),
    ],
)
def test_a_mistake_is_one_line(keys: Path, arguments: Sequence[str], says: str) -> None:
    with one_line(says):
        call("keys", *arguments, "--dir", str(keys))


def test_every_process_of_a_launch_is_told_where_the_keys_are() -> None:
    scenario = Scenario({"team": {"name": "t", "sub_teams": {"a": ["r1"]}}}, "team.toml")
    config = LinkConfig(keys="keys")
    rows = process_table(scenario, "s.json", config, "tls/127.0.0.1:1", None, Path("x.mcap"), view=True)
    for process in (*rows.routers, *rows.members, *rows.viewers, rows.world, rows.recorder):
        assert process is not None
        said = list(process.arguments)
        assert said[said.index("--keys") + 1] == "keys", process.name
