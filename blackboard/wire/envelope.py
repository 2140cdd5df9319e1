"""An envelope: bytes on a key. Services and the network exchange nothing else."""

from dataclasses import dataclass, field
from enum import Enum


class Kind(Enum):
    """What happened on a key."""

    PUT = "put"
    DELETE = "delete"
    ALIVE = "alive"  # a liveliness token appeared on the key
    GONE = "gone"  # it vanished


@dataclass(frozen=True, slots=True)
class Envelope:
    key: str
    payload: bytes = b""
    kind: Kind = Kind.PUT
    message: object = field(default=None, init=False, compare=False, repr=False)
    """what the payload says, where this process wrote it"""

    @classmethod
    def written(cls, key: str, payload: bytes, message: object) -> "Envelope":
        """A PUT whose payload was just made of a message: who gets it in this process need not decode it."""
        envelope = cls(key, payload)
        object.__setattr__(envelope, "message", message)  # `dataclasses.replace` leaves it out
        return envelope
