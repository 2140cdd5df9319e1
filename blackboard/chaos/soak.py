"""A soak: a team runs in real time while something happens to it every few seconds, and what it uses is measured all the time."""

from __future__ import annotations

import asyncio
import math
import signal
import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from blackboard.chaos import gauges
from blackboard.chaos.gauges import Gauge
from blackboard.chaos.table import LINGER
from blackboard.chaos.team import StormTeam, storm_team
from blackboard.chaos.trouble import Trouble
from blackboard.chaos.verdict import AGAIN, Finding, Sent, verdict
from blackboard.config import Scenario

WARM_UP = 8.0  # seconds of team time until the first event
PAUSE = (6.0, 12.0)  # seconds between two events
LAST = 12.0  # seconds before the end in which nothing happens any more
GAUGE = 1.0  # seconds between two readings of what processes use
LOSS = 0.05  # share of segments, on the lines of robots

What = Literal["kill", "restart", "freeze", "cut"]


@dataclass(frozen=True)
class Strike:
    """Something that happens to a process."""

    what: What  # a restart is a SIGTERM, after which the process ends in order
    who: str
    seconds: float = 0.0  # of a freeze or a cut


def draw(scenario: Scenario, rng: np.random.Generator) -> Strike:
    """The next event: a robot three times out of five, else a board, or one time in ten the router."""
    robots = list(scenario.team.robots)
    boards = [board for sub_team in scenario.team.sub_teams for board in scenario.team.boards_of(sub_team)]
    among = rng.random()
    if among < 0.1:
        return Strike("kill", "router")
    who = str(rng.choice(robots if among < 0.7 else boards))
    what: What = ("kill", "restart", "freeze", "cut")[int(rng.integers(4 if who in robots else 3))]
    return Strike(what, who, round(float(rng.uniform(1, 5)), 1) if what in ("freeze", "cut") else 0.0)


@dataclass
class _Soak:
    """A soak that runs."""

    team: StormTeam
    scenario: Scenario
    rng: np.random.Generator
    tell: Callable[[str], object]
    gauges: list[Gauge] = field(default_factory=list)
    sent: dict[str, list[Sent]] = field(default_factory=lambda: defaultdict(list))
    events: int = 0
    _troubled: set[str] = field(default_factory=set)
    _upset: dict[str, float] = field(default_factory=dict)  # process -> until when its messages are not counted
    _times: dict[str, int] = field(default_factory=lambda: defaultdict(int))  # process -> troubles that it had

    def away(self) -> set[str]:
        """The processes that are troubled, or hold no token: nothing is expected of them."""
        team, sight = self.scenario.team, self.team.sight
        boards = [board for sub_team in team.sub_teams for board in team.boards_of(sub_team)]
        return self._troubled | {name for name in (*team.robots, *boards) if not sight.holds(name)}

    async def measure(self) -> None:
        """Read the gauges and the statuses again and again, until cancelled."""
        while True:
            now = self.team.now()
            for name, pid in list(self.team.supervisor.pids.items()):
                gauge = gauges.read(now, name, pid)
                self.gauges += [gauge] if gauge else []
            for name, (status, seen) in self.team.sight.statuses.items():
                if now >= self._upset.get(name, 0.0):
                    life, counters = self.team.supervisor.pids.get(name), status.counters
                    said = Sent(counters.get("sent", 0), seen, counters.get("dropped", 0))
                    mine = self.sent[f"{name}, {life}, after {self._times[name]} troubles"]
                    if mine and said.sent < mine[-1].sent:
                        mine.clear()  # those were of the life before
                    mine.append(said)
            await asyncio.sleep(GAUGE)

    async def strike(self, until: float) -> None:
        """Let events happen until a time."""
        while not self.team.world.done():
            pause = float(self.rng.uniform(*PAUSE))
            if self.team.now() + pause > until:
                return
            await asyncio.wait([self.team.world], timeout=pause)
            await self._happen(draw(self.scenario, self.rng))

    async def _happen(self, event: Strike) -> None:
        self.events += 1
        self.tell(
            f"{self.team.sight.time:7.1f} s: {event.what} {event.who}" + f" for {event.seconds} s" * (event.seconds > 0)
        )
        team, name = self.team, event.who
        concerned = [*team.sight.statuses, name] if name == "router" else [name]
        for one in concerned:
            self._times[one] += 1
            self._upset[one] = math.inf
        if event.seconds:
            self._troubled.add(name)
            team.lanes[name].cut() if event.what == "cut" else team.signal(name, signal.SIGSTOP)
            await asyncio.wait([team.world], timeout=event.seconds)
            team.lanes[name].mend() if event.what == "cut" else team.signal(name, signal.SIGCONT)
            self._troubled.discard(name)
        else:
            team.signal(name, signal.SIGKILL if event.what == "kill" else signal.SIGTERM)
        for one in concerned:
            self._upset[one] = team.now() + AGAIN
            team.sight.statuses.pop(one, None)  # it may be of a life that is over


async def soak(
    scenario: Scenario, seconds: float, seed: int, rng: np.random.Generator, tell: Callable[[str], object]
) -> tuple[list[Finding], dict[str, Any]]:
    """Run a scenario for so long: the lines of the verdict, and the world's scorecard; `tell` is called with each event."""
    chosen = scenario.changed("time", mode="realtime", seconds=float(seconds))
    chosen = chosen.changed("world", seed=seed, linger=LINGER)
    with tempfile.TemporaryDirectory(prefix="blackboard-soak-") as folder:
        async with storm_team(chosen, Path(folder), rng, laned=chosen.team.robots) as team:
            for lane in team.lanes.values():
                lane.trouble = Trouble(loss=LOSS)
            soaked = _Soak(team, chosen, rng, tell)
            measuring = asyncio.create_task(soaked.measure())
            await team.until(lambda: team.sight.time >= WARM_UP, f"{WARM_UP:g} s of team time")
            team.away, begin = soaked.away, team.now()
            await soaked.strike(begin + seconds - WARM_UP - LAST)
            card = await team.card()
            measuring.cancel()
        looks = [look for look in team.looks if look.at >= begin and look.team_time <= seconds]
    return verdict(soaked.gauges, looks, soaked.sent, seconds - WARM_UP), card | {
        "events": soaked.events,
        "said": list(team.lines),
    }
