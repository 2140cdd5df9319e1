"""The process table of a scenario, and how a run starts, ends and fails; the processes are small stand-ins."""

import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from cyclopts import App

import blackboard.__main__
import robot_agent.__main__
import sim_world.__main__
from blackboard.config import Scenario
from blackboard.errors import RunFailed, UserError
from blackboard.net.settings import LinkConfig
from blackboard.run import launch
from blackboard.run.door import INTERRUPTED
from blackboard.run.launch import ProcessTable, process_table, run_scenario
from blackboard.run.supervisor import ProcessRow
from tests.processes import children, program, silent_server

TEAM = {"name": "t", "sub_teams": {"a": ["r1", "r2"], "b": ["r2"]}}
SCENARIO = Scenario({"team": TEAM, "time": {"tick": 0.5, "seconds": 10.0}}, "team.toml")
APPS: dict[str, App] = {
    "blackboard": blackboard.__main__.app,
    "robot_agent": robot_agent.__main__.app,
    "sim_world": sim_world.__main__.app,
}


def arguments(process: ProcessRow) -> list[str]:
    """What follows `python -m`."""
    assert list(process.arguments[:2]) == [sys.executable, "-m"]
    return list(process.arguments[2:])


def everybody(rows: ProcessTable) -> list[ProcessRow]:
    return [*rows.routers, *rows.members, *rows.viewers, rows.world]


def test_the_table_lists_router_boards_robots_and_the_world() -> None:
    rows = process_table(SCENARIO, "s.json", LinkConfig(), "tcp/127.0.0.1:1")
    assert [process.name for process in everybody(rows)] == ["router", "board-a", "board-b", "r1", "r2", "world"]
    assert " ".join(arguments(rows.routers[0])) == "blackboard router --listen tcp/127.0.0.1:1"
    assert " ".join(arguments(rows.members[0])) == (
        "blackboard serve --team t --sub-team a --id board-a --scenario s.json --connect tcp/127.0.0.1:1"
    )
    assert " ".join(arguments(rows.members[3])) == (
        "robot_agent --team t --id r2 --sub-team a --sub-team b --scenario s.json --connect tcp/127.0.0.1:1"
    )
    assert " ".join(arguments(rows.world)) == "sim_world s.json --json --connect tcp/127.0.0.1:1"
    assert rows.members[3].tokens == {"cop/t/a/member/r2", "cop/t/b/member/r2"}
    assert rows.tokens >= {"cop/t/a/board/board-a", "cop/t/b/board/board-b", "cop/t/a/member/r1"}


def test_the_world_writes_the_series() -> None:
    rows = process_table(SCENARIO, "s.json", LinkConfig(), "tcp/127.0.0.1:1", Path("x.csv"))
    assert " ".join(arguments(rows.world)) == "sim_world s.json --json --table x.csv --connect tcp/127.0.0.1:1"
    assert not any("--table" in process.arguments for process in rows.members)


def test_the_live_page_is_a_process_of_its_own_where_it_is_asked_for() -> None:
    rows = process_table(SCENARIO, "s.json", LinkConfig(), "tcp/127.0.0.1:1", view=True)
    (page,) = rows.viewers
    assert " ".join(arguments(page)) == "blackboard view --team t --port 0 --connect tcp/127.0.0.1:1"
    assert not page.tokens
    (opened,) = process_table(SCENARIO, "s.json", LinkConfig(), "tcp/127.0.0.1:1", view=True, open_page=True).viewers
    assert " ".join(arguments(opened)) == "blackboard view --team t --port 0 --open --connect tcp/127.0.0.1:1"
    assert process_table(SCENARIO, "s.json", LinkConfig(), "tcp/127.0.0.1:1").viewers == ()


def test_on_a_given_network_there_is_no_router_and_its_flags_are_passed_on() -> None:
    given = LinkConfig(mode="peer", connect=("tcp/h:1", "tcp/h:2"), file="z.json5", multicast=False, cfg=("a:1",))
    rows = process_table(SCENARIO, "s.json", given, None)
    assert rows.routers == ()
    flags = "--mode peer --config z.json5 --connect tcp/h:1 --connect tcp/h:2 --cfg a:1 --no-multicast-scouting"
    assert all(" ".join(process.arguments).endswith(flags) for process in everybody(rows))


def test_the_router_of_its_own_listens_for_guests_where_it_is_told_to() -> None:
    rows = process_table(SCENARIO, "s.json", LinkConfig(listen=("tcp/0.0.0.0:7",), multicast=True), "tcp/127.0.0.1:1")
    flags = "--listen tcp/127.0.0.1:1 --listen tcp/0.0.0.0:7 --multicast-scouting"
    assert " ".join(arguments(rows.routers[0])) == f"blackboard router {flags}"
    assert "--listen" not in rows.world.arguments


@pytest.mark.parametrize("own_endpoint", ["tcp/127.0.0.1:1", None])
def test_every_door_understands_its_row(own_endpoint: str | None) -> None:
    config = LinkConfig(mode="client", connect=("tcp/h:1",), file="z.json5", multicast=True, cfg=("a:1",))
    for process in everybody(process_table(SCENARIO, "s.json", config, own_endpoint)):
        name, *rest = arguments(process)
        _, bound, _ = APPS[name].parse_args(rest, exit_on_error=False, print_error=False)
        flags = bound.arguments["flags"]
        assert (flags.mode, flags.config, flags.cfg, flags.multicast_scouting) == (
            None if name == "blackboard" and rest[0] == "router" else "client", "z.json5", ["a:1"], True,
        )  # fmt: skip


# --- runs with stand-ins -------------------------------------------------------------------------------------------------

MEMBER = """
import signal, sys, threading
from blackboard.run.door import follow_parent
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
follow_parent()
stop = threading.Event()
signal.signal(signal.SIGTERM, lambda *_: stop.set())
with Link(LinkConfig(connect=(sys.argv[1],)), "member") as link:
    link.token("cop/t/a/member/r1")
    print("up", file=sys.stderr, flush=True)
    stop.wait()
"""
WORLD = """
import os, sys, threading
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Clock
with Link(LinkConfig(connect=(sys.argv[1],)), "world") as link:
    link.watch("cop/t/a/member/*")
    assert link.receive(30.0), "the members come first"
    for tick in (1, 2, 3):
        link.send(Envelope("cop/t/world/clock", encode(Clock(run="1", tick=tick, time=0.5, mode="lockstep"))))
    while not os.path.exists(os.environ.get("SEEN", "/")):
        threading.Event().wait(0.01)
print("a log", file=sys.stderr)
print('{"verdict": "FAIL"}')
sys.exit(1)
"""
UNREADY = "import threading; threading.Event().wait()"

Run = Callable[..., tuple[int, object]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, endpoint: str) -> Run:
    """Run stand-ins for a robot and a world over the router of the test."""

    def run(member: str, world: str = WORLD, **more: object) -> tuple[int, object]:
        def rows(
            scenario: Scenario,
            file: str,
            config: LinkConfig,
            own_endpoint: str | None,
            series: None,
            record: None,
            view: bool,
            open_page: bool,
        ) -> ProcessTable:
            assert own_endpoint is None
            row = ProcessRow("r1", (sys.executable, "-c", member, endpoint, file), frozenset({"cop/t/a/member/r1"}))
            return ProcessTable((), (row,), ProcessRow("world", (sys.executable, "-c", world, endpoint, file)))

        monkeypatch.setattr(launch, "process_table", rows)
        return run_scenario(SCENARIO, config=LinkConfig(connect=(endpoint,)), **more)  # type: ignore[arg-type]

    return run


@pytest.mark.system
def test_the_worlds_scorecard_and_status_are_the_result(
    run: Run, capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEEN", str(tmp_path / "seen"))  # the world waits until its clock was seen
    counts: list[tuple[int, int]] = []

    def progress(done: int, total: int) -> None:
        counts.append((done, total))
        if done == 3:
            (tmp_path / "seen").touch()

    assert run(MEMBER, progress=progress) == (1, {"verdict": "FAIL"})
    assert counts == [(1, 20), (2, 20), (3, 20)]
    out, err = capfd.readouterr()
    assert out == ""
    assert {"      r1 | up", "   world | a log"} <= set(err.splitlines())


@pytest.mark.system
@pytest.mark.parametrize(
    ("world", "how"),
    [
        ("raise SystemExit(0)", "ended with status 0, without a scorecard"),
        ("import os; os.kill(os.getpid(), 9)", "was killed by SIGKILL, without a scorecard; .* short of memory"),
        ("import os; os.kill(os.getpid(), 11)", "was killed by SIGSEGV, without a scorecard"),
        ("print('no JSON')", "ended with status 0, without a scorecard"),
    ],
)
def test_a_world_without_a_scorecard_is_a_failed_run(run: Run, world: str, how: str) -> None:
    with pytest.raises(RunFailed, match=f"the world {how}"):
        run(MEMBER, world)


@pytest.mark.system
def test_whoever_is_not_ready_in_time_is_named(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "READY_SECONDS", 0.2)
    with pytest.raises(RunFailed, match="not ready after 0.2 s: r1"):
        run(UNREADY)


@pytest.mark.system
def test_a_mistake_of_a_child_names_the_persons_file(run: Run) -> None:
    with pytest.raises(UserError, match=r"^team\.toml: robot\.x: no such key$"):
        run("import sys; print(f'error: {sys.argv[2]}: robot.x: no such key', file=sys.stderr); sys.exit(2)")


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_one_signal_stops_a_run_that_still_waits_for_its_network(number: signal.Signals) -> None:
    with silent_server() as (silent, where), program("-m", "blackboard", "demo", "--json", "-e", where) as demo:
        silent.accept()[0].close()  # it tries to connect
        demo.running.send_signal(number)
        assert demo.ends() == INTERRUPTED
        assert demo.out == ""


@pytest.mark.system
def test_a_router_that_is_killed_is_started_again_and_the_run_goes_on() -> None:
    with program("-m", "blackboard", "demo", "--robots", "2", "--seconds", "4", "--json") as demo:
        demo.says("tick 4 of")
        (router,) = (pid for pid in children(demo.running.pid) if "router" in command(pid))
        os.kill(router, signal.SIGKILL)
        demo.says("router | ended with status -9; starting it again")
        assert demo.ends() in (0, 1), demo.err
        assert json.loads(demo.out)["ticks"] == 20


def command(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/cmdline").read_text().split("\0")
