"""A team of real processes whose lines to the router go through proxies, and an observer that looks at it all the time."""

import asyncio
import json
import os
import sys
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from blackboard.chaos.lane import Lane
from blackboard.chaos.sight import Look, Sight
from blackboard.config import Scenario
from blackboard.errors import RunFailed
from blackboard.net.link import Link
from blackboard.net.settings import LinkConfig
from blackboard.run.launch import READY_SECONDS, ProcessTable, free_port, open_link, process_table
from blackboard.run.supervisor import ProcessRow, Supervisor
from blackboard.wire import keys

LOOK = 0.1  # seconds between two looks
SITES = "sites"  # the lane between two routers
#: Of the world's session with both routers, a peer's, because a client has one router only; it connects again by itself.
BOTH = ("--cfg", "connect/exit_on_failure:false", "--cfg", "connect/timeout_ms:-1")


@dataclass
class StormTeam:
    """A team that runs; times are those of the event loop, in seconds."""

    sight: Sight
    lanes: dict[str, Lane]
    supervisor: Supervisor
    world: asyncio.Task[tuple[int, str]]
    links: list[Link]  # of the observer: one with each router
    looks: list[Look] = field(default_factory=list)
    away: Callable[[], Collection[str]] = tuple  # of whom nothing is expected
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=400))  # what the processes said last

    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a process; one that does not run just now gets none."""
        pid = self.supervisor.pids.get(name)
        if pid is not None:
            os.kill(pid, number)

    async def until(self, fact: Callable[[], bool], what: str) -> None:
        """Wait for a fact while the world runs. RunFailed: it does not come, or the world ends."""
        end = self.now() + READY_SECONDS
        while not fact():
            if self.now() > end or self.world.done():
                raise RunFailed(
                    f"{what}: not within {READY_SECONDS:g} s; the processes said last:\n" + "\n".join(self.lines)
                )
            await asyncio.sleep(LOOK / 2)

    async def watch(self) -> None:
        """Take in what the observer receives, until cancelled."""
        looked = 0.0
        while True:
            for link in self.links:
                for envelope in await asyncio.to_thread(link.receive, LOOK / 2):
                    self.sight.hear_envelope(envelope, self.now())
            if self.now() - looked >= LOOK and self.sight.tick >= 0:
                looked = self.now()
                self.looks.append(self.sight.look(looked, self.away()))

    async def card(self) -> dict[str, Any]:
        """The world's scorecard, when it has ended. RunFailed: it ended without one."""
        status, output = await self.world
        try:
            scores: dict[str, Any] = json.loads(output)
        except ValueError:
            said = "\n".join(self.lines)
            raise RunFailed(f"the world ended with status {status}, without a scorecard:\n{said}") from None
        return scores


@asynccontextmanager
async def storm_team(
    scenario: Scenario,
    folder: Path,
    rng: np.random.Generator,
    *,
    laned: Collection[str] = (),
    sites: bool = False,
    series: Path | None = None,
) -> AsyncIterator[StormTeam]:
    """Run a scenario's processes; those that are `laned` reach the router through a `Lane` of their name.

    With `sites` the last sub-team has a router of its own, which is linked to the other one through the lane `SITES`. The world is
    then connected to both, because a simulated world stands for the sensors, which no partition takes away.
    """
    file = folder / "scenario.json"
    file.write_text(scenario.to_json(), encoding="utf-8")
    ports = [free_port() for _ in range(2)]
    endpoints = [f"tcp/127.0.0.1:{port}" for port in ports]
    processes = process_table(scenario, str(file), LinkConfig(), endpoints[0], series)
    lines: deque[str] = deque(maxlen=400)
    async with AsyncExitStack() as stack:
        lanes: dict[str, Lane] = {}

        async def lane(name: str) -> str:
            lanes[name] = await stack.enter_async_context(Lane(name, free_port(), ports[0], rng))
            return lanes[name].endpoint

        routers, far, world = list(processes.routers), frozenset[str](), processes.world
        if sites:
            last = list(scenario.team.sub_teams)[-1]
            far = frozenset((*scenario.team.sub_teams[last], *scenario.team.boards_of(last)))
            there = (sys.executable, "-m", "blackboard", "router", "-l", endpoints[1], "-e", await lane(SITES))
            routers.append(ProcessRow("router-2", there))
            world = _moved(world, endpoints[0], endpoints[0], "--connect", endpoints[1], "--mode", "peer", *BOTH)
        members = []
        for member in processes.members:
            where = endpoints[1] if member.name in far else endpoints[0]
            members.append(_moved(member, endpoints[0], await lane(member.name) if member.name in laned else where))
        supervisor = await stack.enter_async_context(Supervisor(lambda name, line: lines.append(f"{name:>8} | {line}")))
        for process in (*routers, *members):
            supervisor.keep_running(process)
        links = []
        for where in endpoints[: len(routers)]:
            links.append(stack.enter_context(await open_link(LinkConfig(connect=(where,)), "observer")))
            _listen(links[-1], scenario.team.name)
        team = StormTeam(Sight(scenario.team), lanes, supervisor, _idle(), links, lines=lines)
        yield await _begin(stack, team, processes, world)


async def _begin(stack: AsyncExitStack, team: StormTeam, processes: ProcessTable, world: ProcessRow) -> StormTeam:
    """Wait until everybody is there, then start the world."""
    watching = asyncio.create_task(team.watch())
    stack.callback(watching.cancel)
    await team.until(lambda: processes.tokens <= team.sight.tokens, "everybody is there")
    team.supervisor.release()
    team.world.cancel()
    team.world = asyncio.create_task(team.supervisor.run(world))
    stack.callback(team.world.cancel)
    return team


def _idle() -> asyncio.Task[tuple[int, str]]:
    """In place of a world that has not been started."""

    async def wait() -> tuple[int, str]:
        await asyncio.Event().wait()
        return 0, ""

    return asyncio.create_task(wait())


def _listen(link: Link, team: str) -> None:
    for topic in (keys.WORLD, keys.MEMBER, keys.BOARD):
        link.watch(topic.key(team=team, sub_team="*", board="*", robot="*"))
    link.subscribe(f"cop/{team}/**")


def _moved(process: ProcessRow, before: str, *after: str) -> ProcessRow:
    """A process with other arguments in the place of its endpoint."""
    at = list(process.arguments).index(before)
    arguments = (*process.arguments[:at], *after, *process.arguments[at + 1 :])
    return replace(process, arguments=arguments)
