"""A whole team in one process: the services of its world, boards and robots on a bus, from the first tick to the scorecard.

Real services and real bytes; only the network, the processes and the wall clock are left out. In lockstep the result is the same,
to the bit, as that of the processes of `blackboard up`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from blackboard.board.service import BoardService
from blackboard.config import Scenario
from blackboard.errors import RunFailed
from blackboard.faults import faulty_robots
from blackboard.net.bus import Bus, BusLink
from blackboard.process.service import Service, connect
from blackboard.wire.envelope import Envelope
from robot_agent.service import AgentService
from robot_agent.team import robot_of
from sim_world.referee import Referee
from sim_world.scenario import WorldSection
from sim_world.scorecard import scorecard
from sim_world.service import WorldService
from sim_world.sources import open_sensor_source

BEGIN = 1_000_000.0  # Unix seconds: when time begins on the bus
LATER = 1e-6  # seconds that pass after a service was woken, so that time moves even if it is due again at once
LONGEST = 3600.0  # seconds without the end after which a run is given up


class Team:
    """The processes of a scenario as services on a bus, which may shuffle what it delivers, lose some of it, or be watched.

    `bus.spies` are called with every envelope that is sent, `bus.lose` decides which ones reach nobody. Time moves to the next
    instant at which a service is due, and only when nothing is left to deliver.
    """

    def __init__(self, scenario: Scenario, shuffle: np.random.Generator | None = None) -> None:
        """Connect the boards, the robots, then the world. With `shuffle`, envelopes arrive in an order drawn from it.

        UserError: a mistake in the scenario.
        """
        self.scenario, self.bus, self.now = scenario, Bus(), BEGIN
        self._shuffle = shuffle
        self._links: dict[Service, BusLink] = {}
        self.boards = {  # by sub-team, as `a`, and where it has several as `a2`
            name.removeprefix("board-"): board(scenario, sub_team, name)
            for sub_team in scenario.team.sub_teams
            for name in scenario.team.boards_of(sub_team)
        }
        self.robots = {name: robot(scenario, name) for name in scenario.team.robots}
        self.world = world(scenario)
        services: list[Service] = [*self.boards.values(), *self.robots.values(), self.world]
        for service in services:
            self.join(service)

    def join(self, service: Service) -> None:
        """Connect a service as `blackboard.process.loop.run` does."""
        link = self.bus.connect()
        self._links[service] = link
        connect(service, link)

    def leave(self, service: Service) -> None:
        """Disconnect a service, as if its process were killed: its tokens vanish."""
        self._links.pop(service).close()

    def run(self) -> dict[str, Any]:
        """Run to the end of the world: the scorecard. Its wall seconds are those of the bus."""
        self.run_until(lambda: self.world.done)
        for service, link in self._links.items():
            service.record_link_counters(link.counters)
        return scorecard(self.world.result())

    def run_until(self, fact: Callable[[], bool], seconds: float = LONGEST) -> None:
        """Deliver, and let time pass, until a fact holds. RunFailed: it still does not after so many seconds of bus time."""
        end = self.now + seconds
        while not fact():
            if self.bus.waiting:
                self._deliver()
            else:
                self._wake(end)

    def _deliver(self) -> None:
        waiting = self.bus.waiting
        link, envelope = waiting.pop(0 if self._shuffle is None else int(self._shuffle.integers(len(waiting))))
        service = next(service for service, other in self._links.items() if other is link)
        self._send(link, service.receive(envelope, self.now))

    def _wake(self, end: float) -> None:
        service, link = min(self._links.items(), key=lambda member: self._due(member[0]))
        self.now = max(self.now, self._due(service))
        if self.now >= end:
            raise RunFailed("nobody has anything to send any more, and the run has not ended")
        service.record_link_counters(link.counters)
        self._send(link, service.wake(self.now))
        self.now += LATER

    def _due(self, service: Service) -> float:
        """When a service wants to be woken; never, where only envelopes matter to it."""
        at = service.wake_at(self.now)
        return math.inf if at is None else at

    @staticmethod
    def _send(link: BusLink, envelopes: list[Envelope]) -> None:
        for envelope in envelopes:
            link.send(envelope)


def world(scenario: Scenario) -> WorldService:
    """The world of a scenario, with its referee."""
    settings = scenario.section("world", WorldSection)
    sensors = open_sensor_source(scenario)
    return WorldService(
        scenario, sensors, Referee(scenario.grid, settings.check, sensors.robots, faulty=faulty_robots(scenario))
    )


def board(scenario: Scenario, sub_team: str, name: str | None = None) -> BoardService:
    """A board of a sub-team, under the name that `blackboard up` gives to its first one."""
    return BoardService(
        team=scenario.team.name,
        sub_team=sub_team,
        board=name or f"board-{sub_team}",
        grid=scenario.grid,
        settings=scenario.board,
    )


def robot(scenario: Scenario, name: str) -> AgentService:
    """A robot of a scenario, in the sub-teams that the scenario puts it into."""
    return robot_of(scenario, name)
