"""Robots of three kinds share one board: by the client, by the wire page alone, and `robot-agent`; each is in the consensus."""

from __future__ import annotations

import re
from contextlib import ExitStack

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import free_port
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus
from tests.files import ROOT
from tests.processes import program, wait_until

GRID = '{"shape": [50, 50], "cell": 1.0, "origin": [0.0, 0.0]}'


def test_a_client_a_wire_robot_and_robot_agent_share_one_board() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    member = ("--team", "t", "--sub-team", "a", "-e", endpoint)
    examples = ROOT / "examples"
    with ExitStack() as running:
        running.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        board = running.enter_context(program("-m", "blackboard", "serve", *member))
        board.says("ready")
        running.enter_context(program("-m", "robot_agent", "--id", "agent", *member))
        running.enter_context(program(str(examples / "feed_robot.py"), "t", "agent", endpoint))
        running.enter_context(program(str(examples / "minimal_robot.py"), *member, "--id", "wire", "--grid", GRID))
        client = running.enter_context(program(str(examples / "client_robot.py"), "--id", "client", "-e", endpoint))
        link = running.enter_context(Link(LinkConfig(connect=(endpoint,)), "watcher", patience=30.0))
        link.subscribe("cop/t/a/consensus/**")
        used: dict[str, set[str]] = {}

        def all_of_them() -> bool:
            for c in (decode(Consensus, e.payload) for e in link.receive(0.1)):
                used[c.subject] = {one.source for one in c.used}
            everybody = {"agent", "wire", "client"}
            return used.get("object/ball") == everybody and all(used.get(f"robot/{r}") == {r} for r in everybody)

        wait_until(all_of_them, lambda: f"each is in the consensus; used are {used}; client: {client.err}")
        wait_until(lambda: "object/ball" in client.out, lambda: f"the client prints what is agreed: {client.out}")
        assert "refused" not in board.err + client.err


def test_the_robots_of_the_field_find_themselves() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    scenario = str(ROOT / "examples" / "field" / "field.toml")
    with ExitStack() as running:
        running.enter_context(program("-m", "blackboard", "router", "-l", endpoint))
        board = program("-m", "blackboard", "serve", "--scenario", scenario, "--sub-team", "a", "-e", endpoint)
        running.enter_context(board).says("ready")
        client = running.enter_context(program("-m", "examples.field.client", "-e", endpoint, "--seconds", "10"))
        assert client.ends() == 0, client.err
    off = [float(it) for it in re.findall(r"^r\d: RMSE ([\d.]+) m; ball at \[", client.out, re.MULTILINE)]
    assert len(off) == 3, client.out
    assert max(off) < 0.5
