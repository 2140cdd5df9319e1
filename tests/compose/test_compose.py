"""The team in containers, really run: built offline, brought up, hurt in every way, and judged PASS all the same.

One run for the plain case and one for the injuries, which come one after the other while the world waits for everybody
who lives. The second has no end: the world is stopped once the longest absence of a robot is a small part of it.
"""

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.compose.engine import (
    Project,
    base_image,
    build_offline,
    call,
    compose_command,
    copy_sources,
    download_wheels,
    first_line,
    now,
    remove_image,
)

NAME = f"cop-test-{os.getpid()}"
MAX_IMAGE = 350e6  # bytes
MEMBERS = ("board-a", "board-a2", "board-b", "r1", "r2", "r3", "r4", "r5", "r6")
CHECK, ROUTER = ("blackboard", "health"), "tcp/router:7447"
PLAIN = 60  # seconds of team time
#: How much longer than a robot's longest absence the second run is: of a fifth of a robot's samples missing the world makes a FAIL,
#: and the team may be quicker while one is away.
LONGER = 6

pytestmark = pytest.mark.timeout(500)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Project]:
    """A fresh clone, its image built from the given base and wheels alone; everything is removed at the end."""
    command = compose_command()
    folder = tmp_path_factory.mktemp("clone")
    base = base_image(tmp_path_factory.mktemp("work"))
    image = f"{NAME}:test"
    project = Project(command, folder, NAME, {"IMAGE": image, "BASE": base, "VIEW_PORT": "0"})
    try:
        copy_sources(folder)
        download_wheels(base, folder / "wheels")
        build_offline(base, folder, image)
        yield project
    finally:
        project.down()
        remove_image(image)
        assert project.left_behind() == []


@pytest.fixture(scope="module")
def plain_run(project: Project) -> CompletedProcess[str]:
    """`up --exit-code-from world`, to its end."""
    project.changes = {"WORLD": f"--seconds {PLAIN}"}
    done = project.run("up", "--no-color", "--exit-code-from", "world", seconds=300)
    project.down()
    return done


def test_the_image_is_small_has_no_build_tools_and_is_not_root(project: Project) -> None:
    image = project.environment["IMAGE"]
    assert int(call("docker", "image", "inspect", "--format", "{{.Size}}", image)) < MAX_IMAGE
    look = "id -u; for tool in gcc cc make git hatchling /opt/venv/bin/pip; do command -v $tool; done; true"
    assert call("docker", "run", "--rm", image, "sh", "-c", look).split() == ["65534"]


def test_up_ends_with_the_scorecard_and_pass_as_its_exit_status(plain_run: CompletedProcess[str]) -> None:
    assert plain_run.returncode == 0, plain_run.stdout[-5000:] + plain_run.stderr[-1000:]
    said = plain_run.stdout + plain_run.stderr
    lines = re.findall(r"([a-z][a-z0-9-]*)[-_]1 *\| ?(.*)", said)  # a service, and what it said
    assert [text for service, text in lines if service == "world" and text.startswith("PASS")]
    assert {service for service, _ in lines} >= {"router", "world", *MEMBERS}


def test_behind_a_shut_door_the_team_runs_as_the_owner_of_the_keys(project: Project, tmp_path: Path) -> None:
    """Each container reads its own folder of keys only, with a read-only file system and as a user that is not root."""
    keys, owner = tmp_path / "keys", 4321
    call(sys.executable, "-m", "blackboard", "keys", "init", "demo", "--dir", str(keys), "--name", "router")
    for path in (keys, *keys.rglob("*")):
        os.chown(path, owner, owner)
    project.changes = {
        "COMPOSE_FILE": "docker-compose.yml:secure.yml",
        "KEYS": str(keys),
        "KEYS_USER": f"{owner}:{owner}",
        "WORLD": "--seconds 8",
    }
    done = project.run("up", "--no-color", "--exit-code-from", "world", seconds=200)
    project.down()
    said = done.stdout + done.stderr
    assert re.search(r"world.*of team time in [0-9.]+ s", said), said[-5000:]
    assert "denied" not in said


@pytest.fixture(scope="module")
def team(project: Project, plain_run: CompletedProcess[str]) -> Iterator[Project]:
    """A run without an end, for all the injuries below."""
    project.changes = {"WORLD": "--seconds inf", "HEALTH_EVERY": "10s", "GUESTS": "vote"}
    try:
        project("up", "--detach", seconds=180)
        project.wait_well(*MEMBERS)
        yield project
        print(project.report())
    finally:
        project.down()


@pytest.fixture(scope="module")
def absent() -> list[int]:
    """Each time that a robot was away for long: for how many ticks."""
    return []


@pytest.mark.parametrize("member", ["r3", "board-a"])
def test_a_member_that_is_killed_comes_back_and_the_others_go_on(team: Project, member: str) -> None:
    team("kill", member)
    assert team.state(member)["Status"] == "exited"
    team.wait_well(*(other for other in MEMBERS if other != member))
    team("start", member)
    team.wait_well(member)


def test_the_second_board_of_a_sub_team_leads_once_the_first_is_killed(team: Project) -> None:
    first, second = sorted(("board-a", "board-a2"), key=lambda board: "follows" in said_of_health(team, board))
    assert ["follows" in said_of_health(team, board) for board in (first, second)] == [False, True]
    team("kill", first)
    assert team.state(first)["Status"] == "exited"
    team.wait_well(second)  # this check may have begun before
    team.wait_well(second)
    assert "follows" not in said_of_health(team, second)
    team("start", first)
    team.wait_well(first, second)
    assert ["follows" in said_of_health(team, board) for board in (first, second)] == [True, False]


def said_of_health(team: Project, board: str) -> str:
    return call("docker", "exec", team.container(board), *CHECK, "board", "--connect", ROUTER)


def test_a_process_that_crashes_is_started_again_by_its_restart_policy(team: Project) -> None:
    since = now()
    others = "[int(p) for p in os.listdir('/proc') if p.isdigit() and int(p) not in (1, os.getpid())]"
    crash = f"import os; [os.kill(p, 9) for p in {others}]"
    call("docker", "exec", team.container("r5"), "python", "-c", crash)
    team.wait_start("r5", since)
    team.wait_well("r5")


def test_a_robot_without_network_is_unhealthy_and_recovers(team: Project, absent: list[int]) -> None:
    container, network, since, begun = team.container("r1"), team.network(), now(), tick(team)
    call("docker", "network", "disconnect", network, container)
    team.wait_unwell("r1", since)
    call("docker", "network", "connect", network, container)
    team.wait_well("r1")
    absent.append(tick(team) - begun)


def test_the_router_comes_back_and_everybody_with_it(team: Project) -> None:
    team("kill", "router")
    team("start", "router")
    team.wait_well("router", *MEMBERS, since=now())


def test_more_robots_are_welcome_and_may_leave(team: Project) -> None:
    team("up", "--detach", "--scale", "robot=3")
    assert len(team.containers("robot")) == 3
    team.wait_well("robot")
    team("up", "--detach", "--scale", "robot=1")
    assert len(team.containers("robot")) == 1


@pytest.mark.timeout(1500)
def test_after_all_that_it_is_still_a_pass(team: Project, absent: list[int]) -> None:
    far = LONGER * max(absent)
    command = ["docker", "logs", "--follow", team.container("world")]
    first_line(
        command,
        lambda line: (match := re.search(r" tick (\d+)$", line.strip())) is not None and int(match[1]) >= far,
        1400,
        f"tick {far}",
    )
    team("stop", "world")
    assert team.state("world")["ExitCode"] == 0, team.log("world")
    assert "PASS" in team.log("world")


def tick(team: Project) -> int:
    """The tick that the world is in."""
    said = call("docker", "exec", team.container("world"), *CHECK, "world", "--connect", ROUTER)
    match = re.search(r", tick (\d+)$", said.strip())
    assert match, said
    return int(match[1])


def test_everybody_stops_within_five_seconds(team: Project) -> None:
    """After five seconds Docker would have killed them: exit status 137."""
    everybody = ("router", *MEMBERS)
    team("stop")
    assert {name: team.state(name)["ExitCode"] for name in everybody} == dict.fromkeys(everybody, 0)
