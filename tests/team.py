"""A whole team in one process: real services, real bytes, no network, and any order of arrival.

Zenoh's part is played by a bus that matches key expressions and delivers from one bag; a generator shuffles the bag, so
a test can ask for the worst order. Time moves only when nothing is left to deliver.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from blackboard.wire.envelope import Envelope, Kind, Service


@cache
def _expression(key_expr: str) -> re.Pattern[str]:
    chunks = ["(?:.+)" if c == "**" else "[^/]+" if c == "*" else re.escape(c) for c in key_expr.split("/")]
    return re.compile("/".join(chunks))


def matches(key_expr: str, key: str) -> bool:
    """Whether a key expression of `*` and `**` chunks (here: `**` is one chunk or more) includes a key."""
    return _expression(key_expr).fullmatch(key) is not None


class Bus:
    """Delivers what services send to those who listen, in the order they sent it or in a shuffled one."""

    def __init__(self, services: Sequence[Service] = (), shuffle: np.random.Generator | None = None) -> None:
        self.now = 1_000_000.0
        self.shuffle = shuffle
        self.services: list[Service] = []
        self.bag: list[tuple[Service, Envelope]] = []
        self.spies: list[Callable[[Envelope], None]] = []
        self.lose: Callable[[Envelope], bool] = lambda envelope: False
        for service in services:
            self.join(service)

    def join(self, service: Service) -> None:
        for other in self.services:
            self._liveliness(service, other.tokens, Kind.ALIVE)
        self.services.append(service)
        for other in self.services:
            self._liveliness(other, service.tokens, Kind.ALIVE)

    def leave(self, service: Service) -> None:
        self.services.remove(service)
        self.bag = [(s, e) for s, e in self.bag if s is not service]
        for other in self.services:
            self._liveliness(other, service.tokens, Kind.GONE)

    def send(self, envelope: Envelope) -> None:
        for spy in self.spies:
            spy(envelope)
        if not self.lose(envelope):
            self.bag += [(s, envelope) for s in self.services if any(matches(k, envelope.key) for k in s.listens)]

    def run(self, until: Callable[[], bool], seconds: float = 3600.0) -> None:
        """Deliver and let time pass until a fact holds; fails when it still does not after `seconds` of bus time."""
        end = self.now + seconds
        while not until():
            if self.bag:
                place = 0 if self.shuffle is None else int(self.shuffle.integers(len(self.bag)))
                service, envelope = self.bag.pop(place)
                answers = service.receive(envelope, self.now)
            else:
                service = min(self.services, key=lambda s: _due(s, self.now))
                self.now = max(self.now, _due(service, self.now))
                assert self.now < end, "nothing more happens"
                answers = service.wake(self.now)
                self.now += 1e-6
            for answer in answers:
                self.send(answer)

    def _liveliness(self, watcher: Service, tokens: Sequence[str], kind: Kind) -> None:
        told = [Envelope(t, b"", kind) for t in tokens if any(matches(k, t) for k in watcher.watches)]
        self.bag += [(watcher, envelope) for envelope in told]


def _due(service: Service, now: float) -> float:
    at = service.wake_at(now)
    return float("inf") if at is None else at
