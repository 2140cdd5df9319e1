"""The loop that runs the service of every process; there is no other endless loop."""

import logging
import math
from collections.abc import Callable
from typing import Protocol

from blackboard.process.clock import UnixClock
from blackboard.process.failures import Failures
from blackboard.process.namesakes import Namesakes
from blackboard.process.service import Service, Subscriber, connect
from blackboard.wire.envelope import Envelope

log = logging.getLogger(__name__)

LONGEST_WAIT = 0.5  # seconds, so that a signal is noticed
AFTER_FAILURE = 0.1  # seconds until a service that could not do what was due is woken again


class Connection(Subscriber, Protocol):
    """What the loop needs of `blackboard.net.link.Link`."""

    @property
    def counters(self) -> dict[str, int]: ...

    def receive(self, timeout: float) -> list[Envelope]: ...

    def send(self, envelope: Envelope) -> None: ...


def run(
    service: Service,
    link: Connection,
    clock: UnixClock,
    stopped: Callable[[], bool] = lambda: False,
    ready: Callable[[], object] = lambda: None,
) -> None:
    """Connect the service, call `ready`, and serve until it is done or `stopped`.

    An exception of the service ends nothing: it is counted among the link's counters ("failed_in_loop"), and logged.
    So is another process that speaks under the service's name ("namesakes"), where the service listens to its own status.
    """
    failures, paused_until = Failures(), -math.inf
    namesakes = Namesakes(service.tokens)
    connect(service, link)
    ready()
    while not (service.done or stopped()):
        now = clock.now()
        due = _due(service, now, paused_until)
        wait = LONGEST_WAIT if due is None else min(LONGEST_WAIT, max(0.0, due - now))
        arrived = link.receive(wait)
        if arrived:  # a service that is never due, because it only answers, reports them in its statuses too
            service.record_link_counters(_counters(link, failures, namesakes))
        for envelope in arrived:
            if stopped():  # what has arrived may take longer than the one who stops it waits
                break
            if (warning := namesakes.hear_envelope(envelope, clock.now())) is not None:
                log.warning(warning)
            with failures.survive(envelope.key):
                _send(link, service.receive(envelope, clock.now()))
        now = clock.now()
        due = _due(service, now, paused_until)
        if due is not None and due <= now:
            paused_until = now + AFTER_FAILURE
            with failures.survive("what was due"):
                service.record_link_counters(_counters(link, failures, namesakes))
                _send(link, service.wake(now))
                paused_until = -math.inf
    service.record_link_counters(_counters(link, failures, namesakes))


def _due(service: Service, now: float, paused_until: float) -> float | None:
    due = service.wake_at(now)
    return None if due is None else max(due, paused_until)


def _counters(link: Connection, failures: Failures, namesakes: Namesakes) -> dict[str, int]:
    own = {"failed_in_loop": failures.counters["failed"], "namesakes": namesakes.count}
    return link.counters | {name: count for name, count in own.items() if count}


def _send(link: Connection, envelopes: list[Envelope]) -> None:
    for envelope in envelopes:
        link.send(envelope)
