"""What oracles see of a night: everything that was said, and every process from inside."""

from collections.abc import Collection, Sequence
from contextlib import suppress
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
class OfProcess(Event):
    """Something that a process does, or that is done to it; the service is that of its present life."""

    process: str
    service: Service


class Began(OfProcess):
    """A process was started."""


class Ended(OfProcess):
    """A process was killed, or the night is over."""


@dataclass(frozen=True)
class Died(OfProcess):
    """An exception left a service."""

    error: Exception


@dataclass(frozen=True)
class Unsound(OfProcess):
    """An invariant of a machine does not hold."""

    error: AssertionError


@dataclass(frozen=True)
class Said(OfProcess):
    """A process sends an envelope."""

    envelope: Envelope
    topic: keys.Topic | None = None
    parts: dict[str, str] = field(default_factory=dict)
    message: Message | None = None  # None: it is no message of the protocol


@dataclass(frozen=True)
class Heard(OfProcess):
    """A message arrives at a process, which hears it now; what it says then, and that it has moved, comes after."""

    envelope: Envelope


class Moved(OfProcess):
    """A service has heard something, or was woken; what it said then came before."""


class Looked(OfProcess):
    """A process as it is once strangers have spoken."""


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
class Sensed(Event):
    """What is true at this moment of a team without a world."""

    truth: Truth


class Healed(Event):
    """The last fault has ended."""


class Recovered(Event):
    """The time to be well again is over: from now on the team must be."""


class Over(Event):
    """The night is over."""


def said(at: float, process: str, service: Service, envelope: Envelope) -> Said:
    """What a process says, opened."""
    if envelope.kind is Kind.PUT:
        with suppress(Refused):
            return Said(at, process, service, envelope, *opened(envelope))
    return Said(at, process, service, envelope)
