"""Robots of three kinds share one board: by the client, by the wire page alone, and `robot-agent`; each is in the consensus."""

import re
from contextlib import ExitStack

import pytest

from blackboard.client import Robot
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus
from tests.files import ROOT
from tests.present import present
from tests.processes import program, wait_for_consensus, wait_until

GRID = '{"shape": [50, 50], "cell": 1.0, "origin": [0.0, 0.0]}'


def test_a_client_a_wire_robot_and_robot_agent_share_one_board(endpoint: str) -> None:
    member = ("--team", "t", "--sub-team", "a", "-e", endpoint)
    examples = ROOT / "examples"
    with ExitStack() as running:
        board = running.enter_context(program("-m", "blackboard", "serve", *member))
        board.says("ready")
        running.enter_context(program("-m", "robot_agent", "--id", "agent", *member))
        running.enter_context(program(str(examples / "feed_robot.py"), "t", "agent", endpoint))
        minimal = (str(examples / "minimal_robot.py"), *member, "--id", "wire", "--grid", GRID)
        wire = running.enter_context(program(*minimal))
        client = running.enter_context(program(str(examples / "client_robot.py"), "--id", "client", "-e", endpoint))
        link = running.enter_context(Link(LinkConfig(connect=(endpoint,)), "watcher", patience=30.0))
        wait_for_consensus(link, {"agent", "wire", "client"}, lambda: f"client: {client.err}")
        wait_until(lambda: "object/ball" in client.out, lambda: f"the client prints what is agreed: {client.out}")
        wait_until(lambda: "robot/wire" in wire.out, lambda: f"so does the one by the wire page: {wire.out}")
        (late,) = link.get("cop/t/a/agreed/robot/wire")
        assert decode(Consensus, late.payload).ancestors.keys() == {"wire"}
        assert "refused" not in board.err + client.err


@pytest.mark.parametrize("example", ["client", "own_filter"])
def test_the_robots_of_the_field_find_themselves(example: str, endpoint: str) -> None:
    scenario = str(ROOT / "examples" / "field" / "field.toml")
    with ExitStack() as running:
        board = program("-m", "blackboard", "serve", "--scenario", scenario, "--sub-team", "a", "-e", endpoint)
        running.enter_context(board).says("ready")
        client = running.enter_context(program("-m", f"examples.field.{example}", "-e", endpoint, "--seconds", "10"))
        assert client.ends() == 0, client.err
    off = [float(rmse) for rmse in re.findall(r"^r\d: RMSE ([\d.]+) m; ball at \[", client.out, re.MULTILINE)]
    assert len(off) == 3, client.out
    assert max(off) < 0.5


def test_a_robot_by_the_client_one_with_a_filter_and_one_of_ros_are_a_team(endpoint: str) -> None:
    pytest.importorskip("rosbags", reason="no rosbags: pip install '.[ros]'")
    member = ("--scenario", str(ROOT / "examples" / "field" / "field.toml"), "-e", endpoint)
    topics = ["--odometry", "r3=/r3/odom", "--fix", "r3=/r3/fix"]
    for subject in ("robot/r1", "robot/r2", "object/ball"):
        topics += ["--sees", f"r3:{subject}=/r3/sees/{subject}"]
    with ExitStack() as running:
        served = ("serve", "--sub-team", "a"), ("ros", *topics)
        services = [running.enter_context(program("-m", "blackboard", *words, *member)) for words in served]
        services.append(running.enter_context(program("-m", "robot_agent", "--id", "r3", *member)))
        for service in services:
            service.says("ready")
        common = ("-e", endpoint, "--seconds", "10", "--begin", str(UnixClock().now() + 20.0))
        examples = [("client", "r1"), ("own_filter", "r2"), ("ros", "r3")]
        robots = [
            running.enter_context(program("-m", f"examples.field.{name}", *common, "--robots", robot))
            for name, robot in examples
        ]
        assert [robot.ends() for robot in robots] == [0, 0, 0], [robot.err for robot in robots]
        refused = [service.err for service in services if "refused" in service.err]
    assert not refused
    printed = "".join(robot.out for robot in robots)
    off = {
        name: float(rmse) for name, rmse in re.findall(r"^(r\d): RMSE ([\d.]+) m; ball at \[", printed, re.MULTILINE)
    }
    assert sorted(off) == ["r1", "r2", "r3"], printed
    assert max(off.values()) < 1.0  # who is late to begin has to catch up


def test_a_robot_goes_on_when_the_board_and_the_router_are_started_again_and_one_comes_late() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    scenario = str(ROOT / "examples" / "field" / "field.toml")
    router = ("-m", "blackboard", "router", "-l", endpoint)
    board = ("-m", "blackboard", "serve", "--scenario", scenario, "--sub-team", "a", "-e", endpoint)
    with ExitStack() as running:
        first = running.enter_context(program(*router))
        serving = running.enter_context(program(*board))
        serving.says("ready")
        robots = [running.enter_context(Robot("r1", scenario, endpoint=endpoint))]
        robots[0].fix((2.0, 3.0), 0.05, 0.0, 0.02)

        def goes_on(since: float) -> bool:
            for robot in robots:  # the program: the same all the time
                robot.odometry(0.0, 0.0, 0.05)
                if robot is not robots[0]:
                    robots[0].see(f"robot/{robot.robot}", 1.0, 0.0, 0.05, 0.02)
                assert robot.step() is not None
            known = robots[0].agreed
            return all(
                f"robot/{client.robot}" in known and known[f"robot/{client.robot}"].time > since for client in robots
            )

        def agreed_again() -> None:
            since = robots[0].time
            wait_until(lambda: goes_on(since), lambda: f"the team agrees again: {robots[0].agreed}")

        agreed_again()
        serving.running.kill()
        serving.ends()
        running.enter_context(program(*board)).says("ready")
        agreed_again()
        robots.append(running.enter_context(Robot("r2", scenario, endpoint=endpoint)))  # late
        robots[1].fix((3.0, 3.0), 0.5, 0.0, 0.1)
        agreed_again()
        first.running.kill()
        first.ends()
        goes_on(0.0)  # alone, meanwhile
        running.enter_context(program(*router))
        agreed_again()
        pose = present(robots[0].pose)
        assert abs(pose.mean[0] - 2.0) < 0.1
