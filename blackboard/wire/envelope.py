"""An envelope: bytes on a key. Services and the network exchange nothing else."""

from dataclasses import dataclass
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
