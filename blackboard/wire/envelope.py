"""An envelope: bytes on a key. All that a service sees of the network, and all that the network sees of a service."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol


class Kind(Enum):
    PUT = "put"
    DELETE = "delete"
    ALIVE = "alive"  # a liveliness token appeared on the key
    GONE = "gone"  # it vanished


@dataclass(frozen=True, slots=True)
class Envelope:
    key: str
    payload: bytes = b""
    kind: Kind = Kind.PUT


class Service(Protocol):
    """A machine behind its bytes. `now` is Unix time in seconds, from `blackboard.clock`; nothing here reads a clock or a socket."""

    @property
    def tokens(self) -> tuple[str, ...]:
        """Liveliness tokens to hold while it runs."""

    @property
    def listens(self) -> tuple[str, ...]:
        """Key expressions to subscribe to."""

    @property
    def watches(self) -> tuple[str, ...]:
        """Key expressions of the liveliness tokens to be told of, those already there first."""

    @property
    def done(self) -> bool:
        """True once there is nothing left to do: the loop ends."""

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        """Take one envelope; return those to send."""

    def wake(self, now: float) -> list[Envelope]:
        """Time has passed; return what is due."""

    def wake_at(self, now: float) -> float | None:
        """When `wake` is next due, or None while only envelopes matter."""

    def note(self, counters: dict[str, int]) -> None:
        """The link's counters (sent, received, dropped, bytes), for the status."""
