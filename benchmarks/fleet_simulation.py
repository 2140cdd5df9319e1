"""A discrete-event simulation of robots, a router and boards, with costs that `fleet.py` measured.

An own queue of `heapq`, one core for each board and one for the router; simpy would add nothing.
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

OBJECTS = 2
MATES = 2  # that a robot sees of its own sub-team


@dataclass(frozen=True)
class Fleet:
    """A team: every robot reports itself, `MATES` mates and one object, `rate` times a second; boards settle every `period` s."""

    robots: int
    sub_teams: int
    rate: float = 5.0
    period: float = 0.2

    def members(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {f"s{i}": [] for i in range(self.sub_teams)}
        for i in range(self.robots):
            found[f"s{i % self.sub_teams}"].append(f"r{i}")
        return found

    def subjects(self, robot: str, mates: list[str]) -> list[str]:
        at = mates.index(robot)
        seen = {mates[(at + 1 + i) % len(mates)] for i in range(MATES)} - {robot}
        return [f"robot/{robot}", *(f"robot/{mate}" for mate in sorted(seen)), f"object/o{at % OBJECTS}"]


@dataclass(frozen=True)
class Costs:
    """Processor milliseconds of a board's work, and of the network's for each message; bytes of the messages."""

    hear: float  # a report or a status
    hear_consensus: float
    settle: float  # a subject
    opinion: float  # an opinion in it, beyond that
    agree: float  # a subject in the exchange
    part: float  # a sub-team's consensus in it, beyond that
    take: float = 0.05  # Zenoh and the loop around a message that a board receives
    route: float = 0.02  # the router, for each message in and each delivery out
    idle: float = 0.0  # a board's, in each second, whatever it hears
    report: int = 400  # bytes, key included
    consensus: int = 900


@dataclass
class Server:
    """One core that works on one thing after the other."""

    free: float = 0.0  # when it has done all that it was given, seconds
    busy: float = 0.0  # seconds of work in all

    def work(self, now: float, seconds: float) -> float:
        """When something that comes now is done."""
        self.free, self.busy = max(self.free, now) + seconds, self.busy + seconds
        return self.free


@dataclass
class Simulated:
    """What a fleet would need; shares of a core."""

    fleet: Fleet
    board: float  # the busiest
    boards: float  # all of them
    router: float
    router_mbit: float  # in and out together
    robot_mbit: float  # into one robot: what is agreed, and the clock
    latency: float  # seconds from the beginning of a period until its agreed beliefs are out, the last 20 %


@dataclass
class Simulation:
    """Robots, one router and the boards of a fleet as servers; what happens next comes from one queue.

    `fanout` None: each board hears all others, as today. A number: boards form a tree with so many children each, in which a board
    hears its children and its parent, on `shared` subjects alone, and no other sub-team's robots.
    """

    fleet: Fleet
    costs: Costs
    fanout: int | None = None
    shared: int = OBJECTS
    seconds: float = 4.0
    queue: list[tuple[float, int, str, int]] = field(default_factory=list)
    router: Server = field(default_factory=Server)
    bytes: float = 0.0
    _number: int = 0

    def run(self) -> Simulated:
        fleet, count = self.fleet, self.fleet.sub_teams
        size = math.ceil(fleet.robots / count)
        self.boards, self.settled = [Server() for _ in range(count)], [0.0] * count
        latencies: deque[float] = deque()
        for i in range(count):
            self._at(0.0, "reports", i)
            self._at(fleet.period * (0.5 + 0.5 * i / count), "settle", i)
        while self.queue:
            now, _, what, i = heapq.heappop(self.queue)
            if now > self.seconds:
                break
            if what == "reports":
                self._reports(now, i, size)
                self._at(now + 1 / fleet.rate, "reports", i)
            elif what == "settle":
                latencies.append(self._settle(now, i, size) - now)
                self._at(now + fleet.period, "settle", i)
        late = sorted(latencies)[-max(1, len(latencies) // 5) :]
        return Simulated(
            fleet,
            max(board.busy for board in self.boards) / self.seconds + 1e-3 * self.costs.idle,
            sum(board.busy for board in self.boards) / self.seconds + 1e-3 * self.costs.idle * count,
            self.router.busy / self.seconds,
            8e-6 * self.bytes / self.seconds,
            8e-6 * self._subjects(size) * self.costs.consensus / fleet.period,
            float(np.median(late)),
        )

    def _at(self, time: float, what: str, i: int) -> None:
        self._number += 1
        heapq.heappush(self.queue, (time, self._number, what, i))

    def _carry(self, now: float, messages: int, receivers: int, size: int) -> float:
        """When the router has passed messages on to all their receivers."""
        self.bytes += messages * (1 + receivers) * size
        return self.router.work(now, 1e-3 * self.costs.route * messages * (1 + receivers))

    def _reports(self, now: float, i: int, size: int) -> None:
        """Every robot of a sub-team says a round of reports and its status, which all boards hear."""
        costs, messages = self.costs, size * (MATES + 2)
        came = self._carry(now, messages, 1, costs.report)
        self._carry(now, size, len(self.boards) if self.fanout is None else 1, 150)
        self.boards[i].work(came, 1e-3 * (messages + size) * (costs.take + costs.hear))
        if self.fanout is None:
            per = 1e-3 * size * (costs.take + costs.hear)
            for j, board in enumerate(self.boards):
                if j != i:
                    board.work(came, per)

    def _hearers(self, i: int) -> list[int]:
        """The boards that hear the consensuses of a board."""
        if self.fanout is None:
            return [j for j in range(len(self.boards)) if j != i]
        children = range(i * self.fanout + 1, min(len(self.boards), (i + 1) * self.fanout + 1))
        return [*children, *([(i - 1) // self.fanout] if i else [])]

    def _subjects(self, size: int) -> int:
        """About how many subjects a board publishes what was agreed."""
        return self.fleet.robots + OBJECTS if self.fanout is None else size + self.shared

    def _settle(self, now: float, i: int, size: int) -> float:
        """Settle and exchange; when what was agreed has been sent."""
        costs, own = self.costs, size + OBJECTS
        done = self.boards[i].work(now, 1e-3 * (own * costs.settle + size * (MATES + 2) * costs.opinion))
        hearers = self._hearers(i)
        passed = own if self.fanout is None else self.shared
        came = self._carry(done, passed, len(hearers), costs.consensus)
        for j in hearers:
            self.boards[j].work(came, 1e-3 * passed * (costs.take + costs.hear_consensus))
        subjects = self._subjects(size)
        parts = own + len(hearers) * passed
        done = self.boards[i].work(done, 1e-3 * (subjects * costs.agree + parts * costs.part))
        return self._carry(done, subjects, size, costs.consensus)
