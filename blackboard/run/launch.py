"""The process table of a scenario, and running it: start all in order, wait until they are ready, stop all when the world ends."""

import asyncio
import json
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from blackboard.config import Scenario
from blackboard.errors import RunFailed, UserError
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.process.clock import UnixClock
from blackboard.run.recording import recording
from blackboard.run.supervisor import ProcessRow, Supervisor, print_line
from blackboard.state.fold import Fold
from blackboard.state.team import WORLD
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

READY_SECONDS = 60.0  # for all processes to show their tokens, on a machine that may be slow
SCORE_SECONDS = 10.0  # for the world to give the scorecard of a run that was interrupted

Progress = Callable[[int, int], None]  # ticks done, of all


class Interrupted(KeyboardInterrupt):
    """SIGINT or SIGTERM came after the world had begun; `card` is its scorecard of the ticks until then."""

    def __init__(self, card: dict[str, Any]) -> None:
        super().__init__()
        self.card = card


class TapeIncomplete(RunFailed):
    """The run ended and its tape lacks something, which the text says; `card` is its scorecard."""

    def __init__(self, trouble: str, card: dict[str, Any]) -> None:
        super().__init__(trouble)
        self.card = card


@dataclass(frozen=True)
class ProcessTable:
    """The processes of a scenario in the order in which they start."""

    routers: tuple[ProcessRow, ...]  # none where a network is given
    members: tuple[ProcessRow, ...]  # boards and robots
    world: ProcessRow
    viewers: tuple[ProcessRow, ...] = ()  # the live page, if it is asked for
    recorder: ProcessRow | None = None  # where the run is recorded

    @property
    def tokens(self) -> frozenset[str]:
        """The liveliness tokens that are up when everybody but the world is ready."""
        return frozenset(token for member in self.members for token in member.tokens)


def process_table(
    scenario: Scenario,
    file: str,
    config: LinkConfig,
    own_endpoint: str | None,
    series: Path | None = None,
    record: Path | None = None,
    view: bool = False,
    open_page: bool = False,
) -> ProcessTable:
    """The process table of a scenario in `file`; with `own_endpoint` it has a router of its own, which listens there too.

    The world writes its samples into `series`, a recorder everything onto the tape `record`. With `view` a live page is served by a
    process of its own, which opens it in the browser where that is asked for.
    """
    python, team = (sys.executable, "-m"), scenario.team
    routers: tuple[ProcessRow, ...] = ()
    if own_endpoint is not None:
        arguments = _flags(replace(config, mode=None, listen=(own_endpoint, *config.listen)))
        routers = (ProcessRow("router", (*python, "blackboard", "router", *arguments)),)
        config = replace(config, connect=(own_endpoint,), listen=())
    common = ("--scenario", file, *_flags(config))
    members = []
    for sub_team in team.sub_teams:
        for board in team.boards_of(sub_team):
            arguments = ("serve", "--team", team.name, "--sub-team", sub_team, "--id", board)
            token = keys.BOARD.key(team=team.name, sub_team=sub_team, board=board)
            members.append(ProcessRow(board, (*python, "blackboard", *arguments, *common), frozenset({token})))
    for robot in team.robots:
        sub_teams = [sub_team for sub_team, robots in team.sub_teams.items() if robot in robots]
        arguments = ("--team", team.name, "--id", robot, *(part for s in sub_teams for part in ("--sub-team", s)))
        tokens = frozenset(keys.MEMBER.key(team=team.name, sub_team=s, robot=robot) for s in sub_teams)
        members.append(ProcessRow(robot, (*python, "robot_agent", *arguments, *common), tokens))
    samples = () if series is None else ("--table", str(series))
    world = ProcessRow("world", (*python, "sim_world", file, "--json", *samples, *_flags(config)))
    recorder = None
    if record is not None:
        recorder = ProcessRow("recorder", (*python, "blackboard", "record", str(record), "--team", team.name, *common))
    shown = ("--port", "0", *(("--open",) if open_page else ()))
    page = ProcessRow("view", (*python, "blackboard", "view", "--team", team.name, *shown, *_flags(config)))
    return ProcessTable(routers, tuple(members), world, (page,) if view else (), recorder)


def _flags(config: LinkConfig) -> tuple[str, ...]:
    """The command-line flags from which a door makes this configuration again."""
    pairs = [("--mode", config.mode), ("--config", config.file), ("--keys", config.keys)]
    pairs += [("--connect", endpoint) for endpoint in config.connect]
    pairs += [("--listen", endpoint) for endpoint in config.listen]
    pairs += [("--cfg", setting) for setting in config.cfg]
    switch = {None: (), True: ("--multicast-scouting",), False: ("--no-multicast-scouting",)}[config.multicast]
    return (*(part for name, value in pairs if value is not None for part in (name, value)), *switch)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def run_scenario(
    scenario: Scenario,
    progress: Progress | None = None,
    config: LinkConfig | None = None,
    series: Path | None = None,
    record: Path | None = None,
    *,
    view: bool = False,
    open_page: bool = False,
) -> tuple[int, dict[str, Any]]:
    """Run every process of a scenario until its world ends: the world's exit status and scorecard.

    Samples go into `series`, and every message onto the tape `record`.

    With `view` a live page is served beside it, and stopped with it; with `open_page` it is opened in the browser.

    The network is the one that `config` names an endpoint or a file for, else a router of its own on 127.0.0.1.
    UserError: a process ended with one. RunFailed: the world gave no scorecard, or the tape is not whole (`TapeIncomplete`).
    KeyboardInterrupt: SIGINT or SIGTERM came; it is `Interrupted` where the world had begun and gave its scorecard. In every case
    all processes are stopped.
    """
    config = config or LinkConfig()
    own_endpoint = (
        None if config.connect or config.file else f"{'tls' if config.keys else 'tcp'}/127.0.0.1:{free_port()}"
    )
    with tempfile.TemporaryDirectory(prefix="blackboard-") as folder:
        file = Path(folder) / "scenario.json"
        file.write_text(scenario.to_json(), encoding="utf-8")
        processes = process_table(scenario, str(file), config, own_endpoint, series, record, view, open_page)
        if own_endpoint is not None:
            config = LinkConfig(connect=(own_endpoint,), cfg=config.cfg, keys=config.keys)
        try:
            ending = Ending()
            status, output, trouble = asyncio.run(_run(processes, scenario, config, progress, record, ending))
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None
        except UserError as error:  # a child names the copy that it has read, not the person's own file
            raise UserError(str(error).replace(str(file), scenario.where)) from error
    try:
        card = json.loads(output)
    except ValueError:
        if ending.asked:
            raise KeyboardInterrupt from None
        what = f"the world {_ended(status)}"
        raise RunFailed(f"{what}; {trouble}" if trouble else what) from None
    if ending.asked and not card.get("ticks"):
        raise KeyboardInterrupt
    if trouble:
        raise TapeIncomplete(trouble, card)
    if ending.asked:
        raise Interrupted(card)
    return status, card


def _ended(status: int) -> str:
    """How the world ended that gave no scorecard, and what to do about it where the kernel may have killed it."""
    if status >= 0:
        return f"ended with status {status}, without a scorecard"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    cure = "; if nobody did that, the host was short of memory: run fewer robots or a coarser grid"
    return f"was killed by {name}, without a scorecard{cure if status == -signal.SIGKILL else ''}"


class Ending:
    """What a first signal does: it asks the world, once that runs, to end with its scorecard. A second one stops everything."""

    def __init__(self) -> None:
        self.asked = False

    def handle(self, supervisor: Supervisor, stop: Callable[[], object]) -> None:
        """Take a signal; `stop` stops everything, at once or where the world gives no scorecard in time."""
        if self.asked or not supervisor.terminate("world"):
            stop()
            return
        self.asked = True
        print_line("launcher", "stopped by a signal: the scorecard of the ticks until now follows; again stops at once")
        asyncio.get_running_loop().call_later(SCORE_SECONDS, stop)


async def _run(
    processes: ProcessTable,
    scenario: Scenario,
    config: LinkConfig,
    progress: Progress | None,
    tape: Path | None,
    ending: Ending,
) -> tuple[int, str, str]:
    """The world's exit status, what it printed, and what is missing on the tape."""
    main = asyncio.current_task()
    assert main is not None
    async with Supervisor() as supervisor:
        # asyncio.run handles SIGINT only where it is not ignored; where a script started this in the background, it is. With a
        # handler here the processes started below get the default disposition, because a program does not inherit handlers.
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, ending.handle, supervisor, main.cancel)
        for router in processes.routers:
            supervisor.keep_running(router)
        async with (
            _observer(config, scenario, supervisor.release, progress) as observer,
            recording(supervisor, processes.recorder, tape, READY_SECONDS) as recorded,
        ):
            for member in (*processes.members, *processes.viewers):
                supervisor.keep_running(member)
            await observer.until_alive(processes.tokens)
            status, output = await supervisor.run(processes.world)
        return status, output, recorded.trouble


class Observer:
    """What a launcher sees of a running team, by the one fold: who is alive, the world among them, and the world's clock."""

    def __init__(
        self, link: Link, scenario: Scenario, on_world_alive: Callable[[], None], progress: Progress | None
    ) -> None:
        self._link, self._on_world_alive, self._progress = link, on_world_alive, progress
        self._name, self._ticks = scenario.team.name, scenario.time.ticks
        self._fold, self._clock = Fold(), UnixClock()
        self._changed = asyncio.Event()
        team = self._name
        link.watch(keys.WORLD.key(team=team))
        link.watch(keys.BOARD.key(team=team, sub_team="*", board="*"))
        link.watch(keys.MEMBER.key(team=team, sub_team="*", robot="*"))
        if progress is not None:
            link.subscribe(keys.CLOCK.key(team=team))

    async def follow(self) -> None:
        """Take in what arrives, until cancelled."""
        while True:
            for envelope in await asyncio.to_thread(self._link.receive, 0.2):
                self.hear_envelope(envelope)

    def hear_envelope(self, envelope: Envelope) -> None:
        self._fold.hear_envelope(envelope, self._clock.now())
        team = self._fold.team(self._name)
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self._changed.set()
            if WORLD in team.processes and team.processes[WORLD].alive:
                self._on_world_alive()
        elif self._progress is not None and team.clock is not None:
            self._progress(team.clock.tick, self._ticks)

    def missing(self, tokens: frozenset[str]) -> frozenset[str]:
        return tokens.difference(*(process.tokens for process in self._fold.team(self._name).processes.values()))

    async def until_alive(self, tokens: frozenset[str]) -> None:
        """Wait until all these tokens are alive. RunFailed: some are not after READY_SECONDS."""
        try:
            async with asyncio.timeout(READY_SECONDS):
                while self.missing(tokens):
                    await self._changed.wait()
                    self._changed.clear()
        except TimeoutError:
            late = ", ".join(sorted(token.rsplit("/", 1)[1] for token in self.missing(tokens)))
            raise RunFailed(f"not ready after {READY_SECONDS:g} s: {late}; their output is above") from None


async def open_link(config: LinkConfig, name: str) -> Link:
    """A link, opened in a thread, which tries for `READY_SECONDS`; where this is cancelled, the thread gives up."""
    given_up = threading.Event()
    try:
        return await asyncio.to_thread(Link, config, name, patience=READY_SECONDS, stopped=given_up.is_set)
    finally:
        given_up.set()


@asynccontextmanager
async def _observer(
    config: LinkConfig, scenario: Scenario, on_world_alive: Callable[[], None], progress: Progress | None
) -> AsyncIterator[Observer]:
    """An observer with a session of its own, which opens as soon as the router is ready."""
    with await open_link(config, "launcher") as link:
        observer = Observer(link, scenario, on_world_alive, progress)
        following = asyncio.create_task(observer.follow())
        try:
            yield observer
        finally:
            following.cancel()
