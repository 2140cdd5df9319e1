"""The loop that runs the service of every process; there is no other endless loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from blackboard.process.clock import UnixClock
from blackboard.process.service import Service
from blackboard.wire.envelope import Envelope

LONGEST_WAIT = 0.5  # seconds, so that a signal is noticed


class Connection(Protocol):
    """What the loop needs of `blackboard.net.link.Link`."""

    @property
    def counters(self) -> dict[str, int]: ...

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def token(self, key: str) -> None: ...

    def receive(self, timeout: float) -> list[Envelope]: ...

    def send(self, envelope: Envelope) -> None: ...


def run(service: Service, link: Connection, clock: UnixClock, stopped: Callable[[], bool] = lambda: False) -> None:
    """Serve until the service is done or `stopped`.

    Tokens are watched before any topic is subscribed to, so that the roster has the senders of the first messages. Own tokens are
    declared last: whoever sees one may send to this process at once.
    """
    for key_expr in service.watches:
        link.watch(key_expr)
    for key_expr in service.listens:
        link.subscribe(key_expr)
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
            service.record_link_counters(link.counters)
            _send(link, service.wake(now))
    service.record_link_counters(link.counters)


def _send(link: Connection, envelopes: list[Envelope]) -> None:
    for envelope in envelopes:
        link.send(envelope)
