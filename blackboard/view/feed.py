"""A fold that follows a running team over a link: what `why`, `status` and the page look through."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from blackboard.view.echo import in_order
from blackboard.view.fold import Fold
from blackboard.wire.envelope import Envelope

WAIT = 0.1  # seconds that a look waits for the next envelope


class Connection(Protocol):
    """What is needed of `blackboard.net.link.Link`."""

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def receive(self, timeout: float) -> list[Envelope]: ...

    def get(self, key_expr: str) -> list[Envelope]: ...


class Feed:
    """Subscribes to everything of a team (`*`: of all teams) in one subscription, which keeps each sender's order; sends nothing."""

    def __init__(self, link: Connection, now: Callable[[], float], team: str = "*") -> None:
        self.fold = Fold()
        self._link, self._now = link, now
        key_expr = f"cop/{team}/**"
        link.watch(key_expr)
        link.subscribe(key_expr)
        self.take(in_order(link.get(key_expr)))  # what was settled before this process came

    def receive(self) -> list[Envelope]:
        """What has arrived, waiting a moment for the first; the fold has not taken it yet."""
        return self._link.receive(WAIT)

    def take(self, envelopes: list[Envelope]) -> None:
        for envelope in envelopes:
            self.fold.take(envelope, self._now())

    def follow(self, seconds: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Take in what arrives for so many seconds, or until it is enough."""
        end = self._now() + seconds
        while not enough() and self._now() < end:
            self.take(self.receive())
