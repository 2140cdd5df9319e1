"""The interface between a service and the loop that runs it (`blackboard.process.loop`)."""

from __future__ import annotations

from typing import Protocol

from blackboard.wire.envelope import Envelope


class Service(Protocol):
    """What the loop needs of a process: envelopes in, envelopes out.

    `now` is Unix time in seconds, as `blackboard.process.loop` reads it; nothing behind this interface reads a clock or a socket.
    """

    @property
    def tokens(self) -> tuple[str, ...]:
        """Liveliness tokens to hold while it runs."""

    @property
    def listens(self) -> tuple[str, ...]:
        """Key expressions to subscribe to."""

    @property
    def watches(self) -> tuple[str, ...]:
        """Key expressions of the liveliness tokens whose changes are delivered, those already held first."""

    @property
    def done(self) -> bool:
        """True once there is nothing left to do: the loop ends."""

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        """Take one envelope; return those to send."""

    def wake(self, now: float) -> list[Envelope]:
        """Time has passed; return what is due."""

    def wake_at(self, now: float) -> float | None:
        """When `wake` is next due, or None while only envelopes matter."""

    def record_link_counters(self, counters: dict[str, int]) -> None:
        """The link's counters (sent, received, dropped, bytes), for the status."""
