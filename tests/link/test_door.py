"""The doors as a person meets them: one clear line, the right status, data and logs apart."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from blackboard.errors import Mistake
from blackboard.launch import free_port
from blackboard.link import Link, LinkConfig
from tests.link.net import mute_server, program

pytestmark = pytest.mark.system


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("blackboard frobnicate", 'Unknown command "frobnicate"'),
        ("blackboard serve", "--sub-team requires an argument"),
        ("blackboard serve --sub-team a/b", "--sub-team 'a/b'"),
        ("blackboard serve --sub-team a --mode both", 'Choose from: "client", "peer", "router"'),
        ("blackboard serve --sub-team a --cfg lease", "--cfg lease: write KEY:VALUE"),
        ("blackboard serve --sub-team a -c nowhere.json5", "--config nowhere.json5: No such file"),
        ("blackboard up nowhere.toml", "nowhere.toml: cannot be read"),
        ("blackboard demo --robots 1", "--robots 1: at least 2"),
        ("robot_agent --sub-team a --id r/1", "--id 'r/1'"),
        ("sim_world nowhere.toml", "nowhere.toml: cannot be read"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments: str, says: str) -> None:
    with program("-m", *arguments.split()) as door:
        assert door.ends() == 2
        assert door.out == ""
        assert door.err.startswith("error: ")
        assert says in door.err
        assert door.err.count("\n") == 1


def test_what_only_a_child_can_find_is_one_line_too(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("[team]\nsub_teams = { a = ['r1'] }\n[robot]\nlegs = 4\n")
    with program("-m", "blackboard", "up", str(file)) as door:
        assert door.ends() == 2
        said = [line for line in door.err.splitlines() if "waiting for a router" not in line]  # on a slow machine
        assert said == [f"error: {file}: robot.legs: no such key; remove it or mend its spelling"]


def test_a_router_says_that_its_port_is_in_use(endpoint: str) -> None:
    with program("-m", "blackboard", "router", "-l", endpoint) as second:
        assert second.ends() == 2
        assert "Address already in use" in second.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_board_ends_in_order_at_a_signal(endpoint: str, number: signal.Signals) -> None:
    with program("-m", "blackboard", "serve", "--sub-team", "a", "-e", endpoint) as board:
        board.says("ready")
        board.running.send_signal(number)
        assert board.ends() == 0
        assert "Traceback" not in board.err
        assert board.out == ""


def test_a_board_that_waits_for_a_router_ends_at_a_signal() -> None:
    with mute_server() as (mute, where), program("-m", "blackboard", "serve", "--sub-team", "a", "-e", where) as board:
        mute.accept()[0].close()  # it tries to connect
        board.running.send_signal(signal.SIGTERM)
        assert board.ends() == 0
        assert board.err == ""


def test_the_admin_space_of_a_router_can_be_read_by_whoever_asks(endpoint: str) -> None:
    with Link(LinkConfig(connect=(endpoint,)), "operator") as link:
        (router,) = link.get("@/*/router")
    assert b"tcp/127.0.0.1" in router.payload


def test_zenohs_own_log_stays_off_standard_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RUST_LOG", "zenoh=info")
    where = f"tcp/127.0.0.1:{free_port()}"
    with program("-m", "blackboard", "router", "-l", where, keep=("RUST_LOG",)) as router:
        router.says("ready")
        router.running.send_signal(signal.SIGTERM)
        assert router.ends() == 0
        assert router.out == ""
        assert "Zenoh can be reached at" in router.err


def test_a_configuration_file_of_zenoh_is_taken(tmp_path: Path) -> None:
    """A router with a list of users: who has no password of it is refused, and who has one in a file comes in."""
    where = f"tcp/127.0.0.1:{free_port()}"
    users, routers, robots = tmp_path / "users.txt", tmp_path / "router.json5", tmp_path / "robot.json5"
    users.write_text("r1:secret\n")
    routers.write_text(
        f"{{listen: {{endpoints: ['{where}']}}, transport: {{auth: {{usrpwd: {{dictionary_file: '{users}'}}}}}}}}"
    )
    robots.write_text(
        f"{{connect: {{endpoints: ['{where}']}}, transport: {{auth: {{usrpwd: {{user: 'r1', password: 'secret'}}}}}}}}"
    )
    with program("-m", "blackboard", "router", "-c", str(routers)) as router:
        router.says("ready")
        with Link(LinkConfig(file=str(robots)), "r1") as link:
            assert link.get("x") == []
        with pytest.raises(Mistake, match="no Zenoh router answers"):
            Link(LinkConfig(connect=(where,)), "r2", patience=0.0)
