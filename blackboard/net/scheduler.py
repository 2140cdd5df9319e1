"""Services on a bus in virtual time: a whole team in one process, one thread and no wall clock. Pure.

Real services and real bytes; only the network, the processes and the wall clock are left out. What was sent is delivered first, in the
order of sending. Once nothing is left to deliver, time moves to the next instant at which a message arrives or a service is due.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING

from blackboard.errors import RunFailed
from blackboard.net.bus import Bus, BusLink
from blackboard.process.service import Checked, Service, connect
from blackboard.wire.envelope import Envelope

if TYPE_CHECKING:
    import numpy as np

BEGIN = 1_000_000.0  # Unix seconds: when time begins
LATER = 1e-6  # seconds that pass after a service was woken, so that time moves even if it is due again at once
LONGEST = 3600.0  # seconds without the fact that is waited for, after which a run is given up
AT_ONCE = (0.0,)

#: Of an envelope on its way from a service (None: from outside, or a token) to a service: the seconds that each copy takes. None of
#: them: it is lost.
Route = Callable[[Service | None, Service, Envelope], Sequence[float]]


@dataclass(eq=False)
class Hosted:
    """A service that runs: its link, how far its clock is ahead (s), and what waits for it while it is frozen."""

    service: Service
    link: BusLink
    ahead: float = 0.0
    frozen: bool = False
    held: list[Envelope] = field(default_factory=list)
    asked: float | None = None  # when it wanted to be woken, as long as nothing has happened to it since

    def due(self, now: float) -> float:
        """When it wants to be woken, by the scheduler's clock; infinity while only envelopes matter to it, or it is frozen.

        A service whose state has not changed wants what it wanted before, until that time has come.
        """
        if self.frozen:
            return math.inf
        if self.asked is None or self.asked <= now:
            at = self.service.wake_at(now + self.ahead)
            self.asked = math.inf if at is None else at - self.ahead
        return self.asked


class Scheduler:
    """Runs services that join and leave; `now` is Unix time in seconds.

    `bus.spies` are called with every envelope that is sent, `bus.lose` decides which ones reach nobody. `route` decides for each
    receiver how long an envelope takes, liveliness included, so it may delay, drop and double. With `shuffle`, envelopes that are
    on their way at the same time arrive in an order drawn from it.
    """

    def __init__(self, now: float = BEGIN, shuffle: np.random.Generator | None = None) -> None:
        self.bus, self.now, self.shuffle = Bus(), now, shuffle
        self.route: Route = lambda sender, receiver, envelope: AT_ONCE
        self._processes: dict[Service, Hosted] = {}
        self._by_link: dict[BusLink, Hosted] = {}
        self._travelling: list[tuple[float, int, BusLink, Envelope]] = []  # a heap, by the time of arrival
        self._numbers = count()

    @property
    def services(self) -> tuple[Service, ...]:
        """The services that have joined, in that order."""
        return tuple(self._processes)

    def join(self, service: Service, ahead: float = 0.0) -> None:
        """Connect a service as `blackboard.process.loop.run` does; its clock is `ahead` by so many seconds."""
        process = Hosted(service, self.bus.connect(), ahead)
        self._processes[service] = self._by_link[process.link] = process
        connect(service, process.link)

    def leave(self, service: Service) -> None:
        """Disconnect a service, as if its process were killed: its tokens vanish, and what is on its way to it is lost."""
        process = self._processes.pop(service)
        del self._by_link[process.link]
        process.link.close()

    def freeze(self, service: Service) -> None:
        """Stop a service as a process is stopped: it holds its tokens, and what comes waits."""
        self._processes[service].frozen = True

    def thaw(self, service: Service) -> None:
        """Let a frozen service go on with what has come."""
        process = self._processes[service]
        process.frozen, held, process.held, process.asked = False, process.held, [], None
        for envelope in held:
            self._hand_over(process, envelope)

    def set_clock(self, service: Service, ahead: float) -> None:
        """Let the clock of a service jump: it is ahead by so many seconds from now on."""
        process = self._processes[service]
        process.ahead, process.asked = ahead, None

    def link(self, service: Service) -> BusLink:
        """The link of a service: what it has sent, and its counters."""
        return self._processes[service].link

    def send(self, service: Service, out: Iterable[Envelope]) -> None:
        """Send what a service returned when it was called from outside."""
        process = self._processes[service]
        process.asked = None
        for envelope in out:
            process.link.send(envelope)

    def run_until(self, fact: Callable[[], bool], seconds: float = LONGEST) -> None:
        """Deliver, and let time pass, until a fact holds, and `check`. RunFailed: it still does not after so many seconds."""
        end = self.now + seconds
        while not fact():
            if not self.step(end):
                raise RunFailed("nobody has anything to send any more, and the run has not ended")
        self.check()

    def run_to(self, end: float) -> None:
        """Deliver, and let time pass until then, and `check`."""
        while self.step(end):
            pass
        self.now = max(self.now, end)
        self.check()

    def run_for(self, seconds: float) -> None:
        """Deliver, and let so many seconds pass."""
        self.run_to(self.now + seconds)

    def step(self, end: float) -> bool:
        """Deliver one message, or let time pass until one arrives or a service is woken. False: nothing happens until `end`."""
        if self.bus.waiting:
            self._deliver()
            return True
        arrival = self._travelling[0][0] if self._travelling else math.inf
        due, process = math.inf, None
        for other in self._processes.values():
            if (wanted := other.due(self.now)) < due:
                due, process = wanted, other
        at = max(self.now, min(arrival, due))
        if at > end or at == math.inf:
            return False
        self.now = at
        if arrival <= due:
            _, _, link, envelope = heappop(self._travelling)
            if link in self._by_link:
                self._hand_over(self._by_link[link], envelope)
        elif process is not None:
            process.service.record_link_counters(process.link.counters)
            self.send(process.service, process.service.wake(self.now + process.ahead))
            self.now = max(self.now + LATER, math.nextafter(self.now, math.inf))  # far from 0, LATER is rounded away
        return True

    def check(self) -> None:
        """Check all services that know their invariants. AssertionError: one does not hold."""
        for service in self._processes:
            if isinstance(service, Checked):
                service.check()

    def _deliver(self) -> None:
        waiting = self.bus.waiting
        sent = waiting.pop(0 if self.shuffle is None else int(self.shuffle.integers(len(waiting))))
        receiver = self._by_link.get(sent.receiver)
        if receiver is None:  # a link of no service
            return
        sender = None if sent.sender is None else self._by_link.get(sent.sender)
        delays = self.route(None if sender is None else sender.service, receiver.service, sent.envelope)
        for delay in delays:
            if delay > 0.0:
                heappush(self._travelling, (self.now + delay, next(self._numbers), sent.receiver, sent.envelope))
            else:
                self._hand_over(receiver, sent.envelope)

    def _hand_over(self, process: Hosted, envelope: Envelope) -> None:
        if process.frozen:
            process.held.append(envelope)
        else:
            self.send(process.service, process.service.receive(envelope, self.now + process.ahead))
