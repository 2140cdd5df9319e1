"""The robot in Rust shares a board with robots by the client, by the wire page in Python, and `robot-agent`; each is in the consensus."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.wire.arrays import unpack, unpacked_grid
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Report
from tests.files import ROOT
from tests.processes import Letters, command, program, wait_for_consensus, wait_until

pytestmark = [pytest.mark.rust, pytest.mark.timeout(1800)]  # seconds: the first build takes minutes

CRATE = ROOT / "examples" / "robot_rust"


def test_the_robot_in_rust_is_in_the_consensus_of_a_board_with_robots_of_three_other_kinds(
    built: Callable[[Path], str], endpoint: str
) -> None:
    robot = built(CRATE)
    member = ("--team", "t", "--sub-team", "a", "-e", endpoint)
    examples = ROOT / "examples"
    with ExitStack() as running:
        board = running.enter_context(program("-m", "blackboard", "serve", *member))
        running.enter_context(program("-m", "robot_agent", "--id", "agent", *member))
        running.enter_context(program(str(examples / "feed_robot.py"), "t", "agent", endpoint))
        running.enter_context(program(str(examples / "minimal_robot.py"), *member, "--id", "wire"))
        running.enter_context(program(str(examples / "client_robot.py"), "--id", "client", "-e", endpoint))
        rust = running.enter_context(command(robot, "t", "a", "rust", endpoint))
        link = running.enter_context(Link(LinkConfig(connect=(endpoint,)), "watcher", patience=30.0))
        wait_for_consensus(link, {"agent", "wire", "client", "rust"}, lambda: f"it said {rust.err}")
        wait_until(
            lambda: " object/ball 15.500 15.500\n" in rust.out,
            lambda: f"it prints what is agreed: {rust.out} {rust.err}",
        )
        assert "refused" not in board.err

        # it answers for its own keys, and the belief is the one that its source says: sigma 1 about (10, 10)
        (answer,) = link.get("cop/t/*/report/rust/robot/rust")
        report = decode(Report, answer.payload)
        belief = unpack(report.belief, unpacked_grid(report.belief.grid))
        assert belief.mean() == pytest.approx([10.0, 10.0], abs=0.05)
        assert belief.covariance().diagonal() == pytest.approx([1.0, 1.0], rel=0.05)

        token, letters = "cop/t/a/member/rust", Letters(link)
        link.watch(token)
        # Of a token that is gone before the subscription reaches its holder Zenoh tells nothing.
        letters.until(Envelope(token, kind=Kind.ALIVE))
        rust.running.terminate()
        letters.until(Envelope(token, kind=Kind.GONE))


LOCKSTEP = """
[team]
name = "t"

[team.sub_teams]
a = ["rust"]

[grid]
shape = [50, 50]

[time]
tick = 0.2
seconds = 60 # 300 ticks, more messages than a queue of Zenoh's holds
mode = "lockstep"

[world]
kind = "simulated"
"""


def test_it_answers_every_tick_of_a_world_that_waits(
    built: Callable[[Path], str], endpoint: str, tmp_path: Path
) -> None:
    scenario = tmp_path / "lockstep.toml"
    scenario.write_text(LOCKSTEP)
    with ExitStack() as running:
        running.enter_context(
            program("-m", "blackboard", "serve", "--scenario", str(scenario), "--sub-team", "a", "-e", endpoint)
        )
        rust = running.enter_context(command(built(CRATE), "t", "a", "rust", endpoint))
        world = running.enter_context(program("-m", "sim_world", str(scenario), "-e", endpoint, "--json"))
        world.ends()
        assert "no longer waited for" not in world.err
        wait_until(
            lambda: "\n299 robot/rust 10.500 10.500\n" in rust.out, lambda: f"it follows to the end: {rust.out[-500:]}"
        )
        assert json.loads(world.out)["scores"]["robots"]["by_name"]["rust"]["solo"]["n"] == 300


def test_it_is_short() -> None:
    assert len((CRATE / "src" / "main.rs").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("arguments", [(), ("t", "a", "rust", "nonsense")])
def test_a_mistake_on_its_command_line_is_one_line(built: Callable[[Path], str], arguments: tuple[str, ...]) -> None:
    with command(built(CRATE), *arguments) as rust:
        assert rust.ends() == 1
        assert len(rust.err.splitlines()) == 1
        assert rust.err.startswith("Error: ")
