"""The bridge to ROS 2 against a node by hiroz, an implementation that shares no code with it."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from tests.files import ROOT
from tests.processes import Letters, Program, command, program, wait_until

pytest.importorskip("rosbags", reason="no rosbags: pip install '.[ros]'")
from blackboard.bridges.ros.names import HASHES, MAP, POSE, gid, key

pytestmark = [pytest.mark.ros, pytest.mark.timeout(3600)]  # seconds: the first build takes minutes

CRATE = ROOT / "tests" / "other" / "ros_node"
R1 = "/demo/robot/r1/pose"


def heard(node: Program) -> list[list[str]]:
    """The messages that a node has printed: key, number, time, publisher, and what is in it."""
    whole, _, _ = node.out.rpartition("\n")
    return [line.split(" ") for line in whole.splitlines() if line != "READY"]


def test_a_node_receives_what_the_running_demo_agrees_on_and_sees_the_bridge(built: Callable[[Path], str]) -> None:
    node, endpoint = built(CRATE), f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as running:
        demo = running.enter_context(program("-m", "blackboard", "demo", "--seconds", "1000", "-l", endpoint))
        demo.says("ready")
        bridge = running.enter_context(program("-m", "blackboard", "ros", "-e", endpoint))
        bridge.says("ready")
        asked = ("pose", R1), ("map", "/demo/object/ball/map"), ("diagnostics", "/diagnostics"), ("graph",)
        poses, maps, states, graph = (running.enter_context(command(node, endpoint, *words)) for words in asked)
        link = running.enter_context(Link(LinkConfig(connect=(endpoint,)), "watcher"))
        link.watch("@ros2_lv/0/**")
        tokens = Letters(link)

        def all_came() -> bool:
            tokens.take()
            processes = "team demo: board board-b=0", "team demo: robot r6=0", "team demo: bridge ros=0"
            return len(heard(poses)) >= 5 and bool(heard(maps)) and all(process in states.out for process in processes)

        wait_until(all_came, lambda: f"{poses.out} {poses.err} {maps.err} {states.out} {bridge.err}", 90.0)

        newest, now = heard(poses), UnixClock().now()
        numbers = [int(message[1]) for message in newest]
        assert numbers[0] >= 1
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        (token,) = {e.key for e in tokens.read if "/MP/" in e.key and "%demo%robot%r1%pose" in e.key}
        for where, _, time, publisher, frame, x, y, xx, yy, yaw, second in newest:
            assert where == key(0, R1, POSE)
            assert where.endswith(f"RIHS01_{HASHES[POSE]}")
            assert now - 100 < int(time) / 1e9 < now + 1
            assert publisher == gid(token).hex()
            assert frame == "map"
            assert 0 <= float(x) <= 50
            assert 0 <= float(y) <= 50
            assert 1 / 12 < float(xx) < 1000
            assert 1 / 12 < float(yy) < 1000
            assert 0 <= float(yaw) < 3.3
            assert now - 100 < int(second) < now + 1
        where, *_, width, height, resolution, column, row, peak = heard(maps)[0]
        assert where == key(0, "/demo/object/ball/map", MAP)
        assert (width, height, resolution, peak) == ("50", "50", "1", "100")
        assert 0 <= int(column) < 50
        assert 0 <= int(row) < 50
        names = "node / cop_blackboard", f"topic {R1} geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"
        wait_until(lambda: all(f"{line}\n" in graph.out for line in names), lambda: f"it sees the bridge: {graph.out}")


def test_a_node_drives_a_robot_by_its_odometry_and_one_that_comes_late_gets_the_last_pose(
    built: Callable[[Path], str], endpoint: str
) -> None:
    node = built(CRATE)
    member = ("--scenario", "demo", "--team", "t", "-e", endpoint)
    with ExitStack() as running:
        board = running.enter_context(program("-m", "blackboard", "serve", "--sub-team", "a", *member))
        agent = running.enter_context(program("-m", "robot_agent", "--id", "r1", *member))
        odometry, fix, other = "r1=/r1/odom", "r1=/initialpose", "r2=/r2/odom"
        inputs = ("--odometry", odometry, "--odometry", other, "--fix", fix)
        bridge = running.enter_context(program("-m", "blackboard", "ros", *member, *inputs))
        for process in (board, agent, bridge):
            process.says("ready")
        poses = running.enter_context(command(node, endpoint, "pose", "/t/robot/r1/pose"))

        def x() -> float:
            return float(heard(poses)[-1][5]) if heard(poses) else -1.0

        with command(node, endpoint, "place", "/initialpose", "10.5", "20.5", "0.25") as place:
            wait_until(
                lambda: abs(x() - 10.5) < 0.5 and float(heard(poses)[-1][7]) < 1,
                lambda: f"the robot knows where it is: {poses.out[-300:]} {place.err} {bridge.err}",
            )
        with command(node, endpoint, "drive", "/r1/odom") as drive:
            wait_until(lambda: x() > 14, lambda: f"it drives along x: {poses.out[-300:]} {drive.err} {bridge.err}")
            assert float(heard(poses)[-1][6]) == pytest.approx(20.5, abs=1.5)
        with command(node, endpoint, "garbage", "/r2/odom"):
            bridge.says("/r2/odom: fields: nav_msgs/msg/Odometry: 8 bytes that are none")

        board.running.terminate()
        board.ends()
        with command(node, endpoint, "diagnostics", "/diagnostics") as states:
            wait_until(lambda: "team t: board board-a=2" in states.out, lambda: f"the board is gone: {states.out}")
            assert "team t: bridge ros=1" in states.out
        late = running.enter_context(command(node, endpoint, "late", "/t/robot/r1/pose"))
        wait_until(lambda: heard(late), lambda: f"the last pose comes without a new one: {late.out} {late.err}")
        assert heard(late) == heard(poses)[-1:]


def test_it_goes_on_when_the_router_is_restarted_and_ends_in_order(built: Callable[[Path], str]) -> None:
    node, endpoint = built(CRATE), f"tcp/127.0.0.1:{free_port()}"
    member = ("--team", "t", "--sub-team", "a", "-e", endpoint)
    robot = str(ROOT / "examples" / "minimal_robot.py")
    with ExitStack() as running:
        with program("-m", "blackboard", "router", "-l", endpoint) as router:
            router.says("ready")
            board = running.enter_context(program("-m", "blackboard", "serve", *member))
            running.enter_context(program(robot, *member, "--id", "w"))
            bridge = running.enter_context(program("-m", "blackboard", "ros", "--team", "t", "-e", endpoint))
            poses = running.enter_context(command(node, endpoint, "pose", "/t/robot/w/pose"))
            wait_until(lambda: len(heard(poses)) > 3, lambda: f"{poses.out} {poses.err} {bridge.err} {board.err}")
        before = len(heard(poses))
        running.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        wait_until(
            lambda: len(heard(poses)) > before + 3, lambda: f"poses go on: {poses.out[-500:]} {bridge.err}", 60.0
        )
        graph = running.enter_context(command(node, endpoint, "graph"))
        wait_until(lambda: "topic /t/robot/w/pose" in graph.out and "cop_blackboard" in graph.out, "it is seen again")
        bridge.running.terminate()
        assert bridge.ends() == 0
        assert "Traceback" not in bridge.err
