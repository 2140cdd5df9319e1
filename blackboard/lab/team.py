"""A whole team in one process: the services of its world, boards and robots on a bus, from the first tick to the scorecard.

In lockstep the result is the same, to the bit, as that of the processes of `blackboard up`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from blackboard.board.service import board_of
from blackboard.config import Scenario
from blackboard.judge.card import scorecard
from blackboard.judge.samples import Keep
from blackboard.net.scheduler import Scheduler
from blackboard.opinion.gaussian.once import Settle, SettledOnce
from blackboard.process.service import Service
from blackboard.wire.messages import Readings, Truth
from robot_agent.team import robot_of
from sim_world.service import world_of
from sim_world.sources import open_sensor_source

if TYPE_CHECKING:
    import numpy as np

Wrap = Callable[[str, Service], Service]  # a robot's name and its service -> the service that runs in its place


class Played(NamedTuple):
    """A tick of a scenario's world: its number, the seconds since the one before, and what is true and measured then."""

    number: int
    dt: float
    truth: Truth
    readings: list[Readings]
    judged: bool  # whether beliefs of this tick are held against the truth


def played(scenario: Scenario) -> Iterator[Played]:
    """All ticks of a scenario's world, simulated or recorded, without a team. UserError: a mistake in the scenario."""
    source, time = open_sensor_source(scenario), scenario.time
    for number in range(time.ticks + 1):
        truth, readings = source.advance("lab", number)
        yield Played(number, time.tick if number else 0.0, truth, readings, source.judged(number))


class InProcessTeam(Scheduler):
    """The processes of a scenario as services on a bus, which may shuffle what it delivers, lose some of it, or be watched."""

    def __init__(
        self,
        scenario: Scenario,
        shuffle: np.random.Generator | None = None,
        *,
        around: Wrap = lambda name, service: service,
        record: Keep | None = None,
        settle: Settle | None = None,
    ) -> None:
        """Connect the boards, the robots, then the world. With `shuffle`, envelopes arrive in an order drawn from it.

        Each robot runs as what `around` makes of it; `record` is given every sample that counts. UserError: a mistake in the scenario.
        What all boards settle alike of a joint is settled once; with `settle_alone` each does so for itself.
        """
        super().__init__(shuffle=shuffle)
        self.scenario, self._around = scenario, around
        settle = settle or SettledOnce()
        self.boards = {  # by sub-team, as `a`, and where it has several as `a2`
            name.removeprefix("board-"): board_of(scenario, sub_team, name, settle)
            for sub_team in scenario.team.sub_teams
            for name in scenario.team.boards_of(sub_team)
        }
        self.robots = {name: robot_of(scenario, name) for name in scenario.team.robots}
        self.world = world_of(scenario, record)
        for board in self.boards.values():
            self.join(board)
        for name, robot in self.robots.items():
            self.join(around(name, robot))
        self.join(self.world)

    def add_robot(self, name: str, sub_teams: Sequence[str]) -> None:
        """Connect a robot that the scenario does not name, in some sub-teams."""
        self.robots[name] = robot_of(self.scenario, name, sub_teams=sub_teams)
        self.join(self._around(name, self.robots[name]))

    def run(self) -> dict[str, Any]:
        """Run to the end of the world: the scorecard. Its wall seconds are those of the bus."""
        self.run_until(lambda: self.world.done)
        for service in self.services:
            service.record_link_counters(self.link(service).counters)
        return scorecard(self.world.result())
