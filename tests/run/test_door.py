"""The doors as a person meets them: one clear line, the right status, data and logs apart."""

import os
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from blackboard.errors import UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.run.door import INTERRUPTED, NO_READER, STOPPED
from blackboard.run.launch import free_port
from tests.commands import Ran
from tests.files import ROOT
from tests.processes import IN_THE_BACKGROUND, LONG, children, is_running, program, seconds_to_end, silent_server

pytestmark = pytest.mark.system


@pytest.mark.parametrize(
    ("door", "settings"), [("robot_agent.__main__", {}), ("blackboard.__main__", {"OPENBLAS_NUM_THREADS": "2"})]
)
def test_numpy_has_one_thread_unless_the_environment_says_otherwise(door: str, settings: dict[str, str]) -> None:
    """Boards on hosts with different numbers of cores round alike."""
    asked = "import os, sys; sys.addaudithook(lambda event, found: event == 'import' and found[0] == 'numpy' and "
    asked += f"print(os.environ['OPENBLAS_NUM_THREADS'])); import {door}, numpy"
    environment = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name} | settings
    done = subprocess.run([sys.executable, "-c", asked], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split()[0] == settings.get("OPENBLAS_NUM_THREADS", "1")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("blackboard frobnicate", 'Unknown command "frobnicate"'),
        ("robot_agent --sub-team a --id r/1", "--id 'r/1'"),
        ("sim_world nowhere.toml", "nowhere.toml: cannot be read"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments: str, says: str) -> None:
    with program("-m", *arguments.split()) as door:
        assert (door.ends(), door.out) == (2, "")
        assert door.err.startswith("error: ")
        assert says in door.err
        assert door.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("serve", "serve: --sub-team is missing"),
        ("why", "why: SUBJECT is missing"),
        ("why object/ball tape.mcap more", "why: more is too much; it takes SUBJECT, FILE and flags (--help)"),
        ("demo nothere", "demo: nothere is too much; it takes flags only (--help)"),
        ("health", "health: KIND is missing, one of router, world, board, robot"),
        ("tape mend", 'Unknown command "mend"; there are export, info, recover, cut, table'),
        ("serve --sub-team a/b", "--sub-team 'a/b'"),
        ("serve --sub-team a --mode both", 'Choose from: "client", "peer", "router"'),
        ("serve --sub-team a --cfg lease", "--cfg lease: write KEY:VALUE"),
        ("serve --sub-team a -c nowhere.json5", "--config nowhere.json5: No such file"),
        ("up nowhere.toml", "nowhere.toml: cannot be read (No such file or directory); give"),
        ("demo --robots 1", "--robots 1: at least 2"),
        ("demo --seed one", "--seed one: give a whole number"),
        ("demo --seconds long", "--seconds long: give a number"),
        ("demo --protocol A_all", "--start and --protocol are about a recording"),
        ("chaos --only storm", "--only storm: no such case; choose from calm, "),
        ("chaos --lies --only calm", "--only calm: no such lie; choose from off-2, "),
    ],
)
def test_so_is_every_mistake_that_is_found_before_anything_is_started(
    monkeypatch: pytest.MonkeyPatch, arguments: str, says: str
) -> None:
    # it sets signal handlers of this process
    monkeypatch.setattr("blackboard.run.door.Stop", lambda within: lambda: False)
    ran = Ran(*arguments.split())
    assert (ran.status, ran.out) == (2, "")
    assert ran.err.startswith("error: ")
    assert says in ran.err
    assert ran.err.count("\n") == 1


def test_help_keeps_asterisks_and_has_the_network_s_flags_apart() -> None:
    page = Ran("echo", "--help").out
    assert "cop/*/*/status/*" in page
    assert page.index("--short") < page.index("Network (Zenoh's usual flags)") < page.index("--connect")
    assert "kill-router" in Ran("chaos", "--help").out


def test_what_only_a_child_can_find_is_one_line_too(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text("[team]\nsub_teams = { a = ['r1'] }\n[robot]\nlegs = 4\n")
    with program("-m", "blackboard", "up", str(file)) as door:
        assert door.ends() == 2
        said = [line for line in door.err.splitlines() if "waiting for a router" not in line]  # on a slow machine
        known = "coding, headings, landmarks, localizer, objects, odometry, patience, ranging, send, vision"
        assert said == [f"error: {file}: robot.legs: no such key; known are {known}"]


def test_a_router_says_that_its_port_is_in_use(endpoint: str) -> None:
    with program("-m", "blackboard", "router", "-l", endpoint) as second:
        assert second.ends() == 2
        assert "Address already in use" in second.err


@pytest.mark.parametrize("door", ["blackboard", "robot_agent", "sim_world"])
def test_a_door_prints_the_version_of_the_package(door: str) -> None:
    with program("-m", door, "--version") as running:
        assert running.ends() == 0
        assert running.out == f"{version('cop-blackboard')}\n"


ENDLESS = """
from itertools import count
from blackboard.run import door
app = door.new_app("endless")
@app.default
def endless() -> int:
    for number in count():
        print(number, flush=True)
door.main(app)
"""


@pytest.mark.parametrize("arguments", [("-c", ENDLESS), ("-m", "blackboard", "scenario")])
def test_a_reader_that_has_enough_ends_a_command_quietly(arguments: tuple[str, ...]) -> None:
    command = [sys.executable, *arguments]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        if arguments[0] == "-c":
            assert running.stdout.readline() == "0\n"
        running.stdout.close()
        assert running.stderr.read() == ""
        assert running.wait(LONG) == NO_READER


def test_another_broken_pipe_is_a_fault() -> None:
    script = "from blackboard.run import door; door.main(lambda **_: (_ for _ in ()).throw(BrokenPipeError()))"
    ran = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert "BrokenPipeError" in ran.stderr


def test_sigint_stops_a_run_that_a_script_has_started_in_the_background() -> None:
    with silent_server() as (silent, where):
        arguments = ("-m", "blackboard", "demo", "--json", "-e", where)
        with program("-c", IN_THE_BACKGROUND, *arguments) as demo:
            silent.accept()[0].close()  # it tries to connect
            demo.running.send_signal(signal.SIGINT)
            assert demo.ends() == INTERRUPTED


def test_the_children_of_such_a_run_do_not_ignore_sigint(endpoint: str) -> None:
    arguments = ("-m", "blackboard", "demo", "--robots", "2", "--seconds", "600", "-e", endpoint)
    with program("-c", IN_THE_BACKGROUND, *arguments) as demo:
        demo.says("tick 0 of")
        family = children(demo.running.pid)
        assert len(family) == 5
        assert not any(ignores(pid, signal.SIGINT) for pid in family)
        demo.running.send_signal(signal.SIGINT)
        assert demo.ends() == INTERRUPTED
        assert not any(is_running(pid) for pid in family)


def ignores(pid: int, number: signal.Signals) -> bool:
    """Whether a process ignores a signal."""
    (mask,) = (line.split()[1] for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "SigIgn" in line)
    return bool(int(mask, 16) >> (number - 1) & 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_board_ends_in_order_at_a_signal(endpoint: str, number: signal.Signals) -> None:
    with program("-m", "blackboard", "serve", "--sub-team", "a", "-e", endpoint) as board:
        board.says("ready")
        board.running.send_signal(number)
        assert board.ends() == 0
        assert "Traceback" not in board.err
        assert board.out == ""


#: A process whose service never comes back from what was due, as a board in an endless tick.
BUSY = """
import sys
from blackboard.run import door, logs
logs.set_up("INFO", as_json=False)

class Busy:
    tokens, listens, watches, done = ("cop/t/a/member/r1",), (), (), False
    def wake_at(self, now): return 0.0
    def record_link_counters(self, counters): pass
    def wake(self, now):
        door.say("spins")
        while True:
            pass

door.serve(Busy(), "busy", door.ZenohFlags(connect=[sys.argv[1]]), within=door.PROMPT)
"""


def test_whoever_does_not_end_in_order_is_gone_within_two_seconds(endpoint: str) -> None:
    with program("-c", BUSY, endpoint) as busy:
        busy.says("spins")
        assert seconds_to_end(busy) < 2.0
        assert busy.ends() == STOPPED


def test_a_board_that_waits_for_a_router_ends_at_a_signal() -> None:
    with (
        silent_server() as (silent, where),
        program("-m", "blackboard", "serve", "--sub-team", "a", "-e", where) as board,
    ):
        silent.accept()[0].close()  # it tries to connect
        board.running.send_signal(signal.SIGTERM)
        assert board.ends() in (0, STOPPED)  # one try to connect takes a second and cannot be interrupted
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
        with pytest.raises(UserError, match="no Zenoh router answers"):
            Link(LinkConfig(connect=(where,)), "r2", patience=0.0)
