"""`blackboard ros --keys`: the team behind a router with certificates, the nodes of ROS on a router of their own."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="no rosbags: pip install '.[ros]'")
from blackboard.access import directory
from blackboard.bridges.ros import convert
from blackboard.bridges.ros.names import POSE, key
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.opinion.belief import Belief
from blackboard.opinion.grid import Grid
from blackboard.process.clock import UnixClock
from blackboard.run.launch import free_port
from blackboard.wire.envelope import Envelope
from tests.access.doors import make_keys, router
from tests.processes import Letters, program, wait_until

pytestmark = pytest.mark.team
SCENARIO = """
[team]
name = "t"
[team.sub_teams]
a = ["r1", "r2"]
b = ["r3"]
"""


def test_a_bridge_with_a_certificate_speaks_for_its_robot_and_for_no_other(tmp_path: Path) -> None:
    keys, nodes, scenario = make_keys(tmp_path / "keys"), f"tcp/127.0.0.1:{free_port()}", tmp_path / "t.toml"
    scenario.write_text(SCENARIO)
    directory.add(keys, "bridge", "r1", ("a",), UnixClock().now(), 30.0)
    grid = Grid((50, 50))
    said = convert.encode(convert.pose(Belief.from_gaussian(grid, (10, 20), np.eye(2)), UnixClock().now(), (0.0, 0.01)))
    plain = ("-m", "blackboard", "router", "-l", nodes)
    with router(keys) as (at, door), program(*plain) as other, Link(LinkConfig(connect=(nodes,)), "node") as node:
        other.says("ready")
        with_keys = ("--scenario", str(scenario), "--keys", str(keys), "-e", at)
        bridge = ("-m", "blackboard", "ros", *with_keys, "--ros-router", nodes)
        with program("-m", "blackboard", "serve", "--sub-team", "a", *with_keys) as board:
            board.says("ready")
            with program(*bridge, "--pose", "r1=/amcl_pose") as running:
                running.says("ready")
                node.subscribe(key(0, "/t/robot/r1/pose", POSE))
                heard = Letters(node)
                wait_until(
                    lambda: node.send(Envelope(key(0, "/amcl_pose", POSE), said)) or heard.take(),
                    lambda: f"what is agreed comes back: {running.err} {board.err} {door.err}",
                )
                place = convert.place(heard.read[0].payload)
                assert (place.x, place.y) == pytest.approx((10, 20), abs=1.0)
        with program(*bridge, "--pose", "r2=/amcl_pose") as another:
            another.ends()
            assert "no certificate of bridge/r2" in another.err
            assert "keys add r2 --kind bridge" in another.err
