"""The only endless loop: it serves every process alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from blackboard.clock import Clock
from blackboard.wire.envelope import Envelope, Service

LONGEST_WAIT = 0.5  # seconds, so that a signal is noticed


class Network(Protocol):
    """What the loop needs of `blackboard.link.Link`."""

    @property
    def counters(self) -> dict[str, int]: ...

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def token(self, key: str) -> None: ...

    def receive(self, timeout: float) -> list[Envelope]: ...

    def send(self, envelope: Envelope) -> None: ...


def run(service: Service, link: Network, clock: Clock, stopped: Callable[[], bool] = lambda: False) -> None:
    """Serve until the service is done or `stopped`. The tokens come last: whoever sees them finds everything in place."""
    for key_expr in service.listens:
        link.subscribe(key_expr)
    for key_expr in service.watches:
        link.watch(key_expr)
    for key in service.tokens:
        link.token(key)
    while not (service.done or stopped()):
        now = clock.now()
        due = service.wake_at(now)
        wait = LONGEST_WAIT if due is None else min(LONGEST_WAIT, max(0.0, due - now))
        for envelope in link.receive(wait):
            _send(link, service.receive(envelope, clock.now()))
        now = clock.now()
        due = service.wake_at(now)
        if due is not None and due <= now:
            service.note(link.counters)
            _send(link, service.wake(now))
    service.note(link.counters)


def _send(link: Network, envelopes: list[Envelope]) -> None:
    for envelope in envelopes:
        link.send(envelope)
