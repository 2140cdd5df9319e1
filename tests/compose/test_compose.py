"""The team in containers, really run: built offline, brought up, hurt in every way, and judged PASS all the same.

One run for the plain case and one for the injuries, which come one after the other while the world waits for everybody
who lives. The plain run tells how long the second must be on this machine.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
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
    now,
    remove_image,
)

NAME = f"cop-test-{os.getpid()}"
MAX_IMAGE = 350e6  # bytes
MEMBERS = ("board-a", "board-b", "r1", "r2", "r3", "r4", "r5", "r6")
PLAIN = 60  # seconds of team time
HURT = 120  # wall seconds that the injuries need on a quick machine; a slow one slows the run as well

pytestmark = pytest.mark.timeout(500)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Project]:
    """A fresh clone, its image built from the given base and wheels alone; everything is removed at the end."""
    command = compose_command()
    folder = tmp_path_factory.mktemp("clone")
    base = base_image(tmp_path_factory.mktemp("work"))
    image = f"{NAME}:test"
    project = Project(command, folder, NAME, {"IMAGE": image, "BASE": base})
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


@pytest.fixture(scope="module")
def team(project: Project, plain_run: CompletedProcess[str]) -> Iterator[Project]:
    """A run that is long enough for all the injuries below."""
    took = re.search(r"of team time in ([0-9.]+) s$", plain_run.stdout, re.MULTILINE)
    assert took, plain_run.stdout[-5000:] + plain_run.stderr[-1000:]
    project.changes = {"WORLD": f"--seconds {PLAIN * HURT / float(took[1]):.0f}", "HEALTH_EVERY": "5s"}
    try:
        project("up", "--detach", seconds=180)
        project.wait_well(*MEMBERS)
        yield project
        print(project.report())
    finally:
        project.down()


@pytest.mark.parametrize("member", ["r3", "board-a"])
def test_a_member_that_is_killed_comes_back_and_the_others_go_on(team: Project, member: str) -> None:
    team("kill", member)
    assert team.state(member)["Status"] == "exited"
    team.wait_well(*(other for other in MEMBERS if other != member))
    team("start", member)
    team.wait_well(member)


def test_a_process_that_crashes_is_started_again_by_its_restart_policy(team: Project) -> None:
    since = now()
    others = "[int(p) for p in os.listdir('/proc') if p.isdigit() and int(p) not in (1, os.getpid())]"
    crash = f"import os; [os.kill(p, 9) for p in {others}]"
    call("docker", "exec", team.container("r5"), "python", "-c", crash)
    team.wait_start("r5", since)
    team.wait_well("r5")


def test_a_robot_without_network_is_unhealthy_and_recovers(team: Project) -> None:
    container, network, since = team.container("r1"), team.network(), now()
    call("docker", "network", "disconnect", network, container)
    team.wait_unwell("r1", since)
    call("docker", "network", "connect", network, container)
    team.wait_well("r1")


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


def test_after_all_that_it_is_still_a_pass(team: Project) -> None:
    assert team.wait_exit("world", 4 * HURT) == 0, team.log("world")
    assert "PASS" in team.log("world")


def test_everybody_stops_within_five_seconds(team: Project) -> None:
    """After five seconds Docker would have killed them: exit status 137."""
    everybody = ("router", *MEMBERS)
    team("stop")
    assert {name: team.state(name)["ExitCode"] for name in everybody} == dict.fromkeys(everybody, 0)
