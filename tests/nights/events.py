"""What oracles see of a night: everything that was said, and every process from inside."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from blackboard.board.board import Board
from blackboard.errors import Refused
from blackboard.opinion.gaussian.evidence import Evidence, Verdict
from blackboard.opinion.gaussian.joint import Joint
from blackboard.opinion.gaussian.naming import Unnamed
from blackboard.process.service import Service
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Truth
from blackboard.wire.types import Message

#: Messages of a team in one process are opened once for all who hear them: a message cannot be changed.
opened = lru_cache(4096)(open_envelope)


@dataclass(frozen=True)
class Event:
    """Something that happens at a time, in seconds of the night."""

    at: float


@dataclass(frozen=True)
class Began(Event):
    """A process was started."""

    process: str
    service: Service


@dataclass(frozen=True)
class Ended(Event):
    """A process was killed, or the night is over."""

    process: str
    service: Service


@dataclass(frozen=True)
class Died(Event):
    """An exception left a service."""

    process: str
    error: Exception


@dataclass(frozen=True)
class Unsound(Event):
    """An invariant of a machine does not hold."""

    process: str
    error: AssertionError


@dataclass(frozen=True)
class Said(Event):
    """A process sends an envelope."""

    process: str
    envelope: Envelope
    topic: keys.Topic | None = None
    parts: dict[str, str] = field(default_factory=dict)
    message: Message | None = None  # None: it is no message of the protocol


@dataclass(frozen=True)
class Heard(Event):
    """A message arrives at a process, which hears it now; what it says then, and that it has moved, comes after."""

    process: str
    envelope: Envelope


@dataclass(frozen=True)
class Moved(Event):
    """A service has heard something, or was woken; what it said then came before."""

    process: str
    service: Service


@dataclass(frozen=True)
class Stepped(Event):
    """The joint of a board makes a step of `dt` seconds with some evidence; a step that failed is made again without some of it."""

    process: str
    run: str
    board: Board
    number: int
    dt: float
    batch: Sequence[Evidence]
    before: Joint
    after: Joint
    unnamed: Sequence[Unnamed]  # what it made of the sightings without a name
    #: Robots that the evidence of two or more others puts elsewhere than the joint does, beyond 99.9 %.
    outvoted: Collection[str] = ()
    verdicts: Sequence[Verdict] = ()
    silent: int = 0  # sightings that said nothing, until then


@dataclass(frozen=True)
class Looked(Event):
    """A process as it is once strangers have spoken."""

    process: str
    service: Service


@dataclass(frozen=True)
class Sensed(Event):
    """What is true at this moment of a team without a world."""

    truth: Truth


@dataclass(frozen=True)
class Healed(Event):
    """The last fault has ended."""


@dataclass(frozen=True)
class Recovered(Event):
    """The time to be well again is over: from now on the team must be."""


@dataclass(frozen=True)
class Over(Event):
    """The night is over."""


def said(at: float, process: str, envelope: Envelope) -> Said:
    """What a process says, opened."""
    if envelope.kind is Kind.PUT:
        try:
            return Said(at, process, envelope, *opened(envelope))
        except Refused:
            pass
    return Said(at, process, envelope)
