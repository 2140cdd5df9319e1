"""A real robot, as docs/hosts.md says: sensors are fed to `robot-agent`, and no world runs."""

from contextlib import ExitStack

import pytest

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus
from tests.files import ROOT
from tests.processes import program, wait_until


def test_readings_reach_the_team_with_no_world_running(endpoint: str) -> None:
    example = ROOT / "examples" / "feed_robot.py"
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 25
    member = ("--team", "t", "--sub-team", "a", "-e", endpoint)
    with ExitStack() as running:
        running.enter_context(program("-m", "blackboard", "serve", *member))
        agent = running.enter_context(program("-m", "robot_agent", "--id", "r1", *member))
        agent.says("ready")
        running.enter_context(program(str(example), "t", "r1", endpoint))
        link = running.enter_context(Link(LinkConfig(connect=(endpoint,)), "watcher", patience=30.0))
        link.subscribe("cop/t/a/agreed/**")
        newest: dict[str, Consensus] = {}

        def agreed() -> bool:
            newest.update({c.subject: c for c in (decode(Consensus, e.payload) for e in link.receive(0.1))})
            return {"robot/r1", "object/ball"} <= newest.keys() and all(c.entropy < 5 for c in newest.values())

        wait_until(agreed, lambda: f"the team agrees on what the robot reports; heard {newest.keys()}")
        place, ball = (unpack(newest[subject].belief) for subject in ("robot/r1", "object/ball"))
        assert place.mean() == pytest.approx((10, 20), abs=1.5)
        assert ball.mean() == pytest.approx((14.2, 24.3), abs=2.5)
        agent.says("no world gives the clock")
