"""What a board remembers of its sources, on the wire: for the boards that follow it, and for tapes.

Everything that a board has learned follows from these numbers, to the bit (`blackboard.board.memory` packs and checks them).
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from blackboard.wire.types import (
    MAX_OPINIONS,
    Ancestors,
    Count,
    Finite,
    Message,
    Name,
    Names,
    NonNegative,
    Part,
    Subject,
    Tick,
)

MAX_SAMPLES = 1 << 20  # bytes of all samples of a level: 8 for each, 50 samples of each pair of 64 sources are 806 kB
MAX_PAIRS = 2016  # of 64 sources
MAX_MEANS = 1 << 12  # bytes: 8 for each coordinate of 64 sources


class PackedNewest(Part):
    """The newest comparison on a subject: the next one is taken a second later, and looks at how the differences turned."""

    subject: Subject
    time: Finite  # team time, seconds
    sources: Annotated[bytes, Field(max_length=64)]  # who was compared, as places in `PackedLearner.sources`, ascending
    #: of their opinions: little-endian float64, a row for each source
    means: Annotated[bytes, Field(max_length=MAX_MEANS)]


class PackedLearner(Part):
    """The comparisons of opinions that a board learns from (docs/design.md, "A board that learns").

    `counts` has a byte for each pair of sources i < j, in the order (0, 1), (0, 2), ..., (1, 2), ...: how many samples follow in
    `samples`, the oldest first, each 8 bytes: float32 `a`, float16 `alike`, float16 `turned`, little-endian.
    """

    sources: Names = Field(default_factory=list)  # sorted
    heard: Ancestors = Field(default_factory=dict)  # source -> team time of its newest sample
    #: source -> team time since which it is held over-confident or an echo
    since: Ancestors = Field(default_factory=dict)
    counts: Annotated[bytes, Field(max_length=MAX_PAIRS)] = b""
    samples: Annotated[bytes, Field(max_length=MAX_SAMPLES)] = b""
    newest: Annotated[list[PackedNewest], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)


class PackedStanding(Part):
    """How far a source disagreed with the others (docs/operations.md, "Faults")."""

    source: Name
    heard: Finite  # team time of the newest judgement
    share: NonNegative = 0.0  # of the seconds that speak against it, the newest counting most
    seconds: Count = 0
    sigmas: NonNegative = 0.0
    since: Finite | None = None  # team time since which it is named
    #: of the second that is not over: float64 for each judgement, little-endian, how many sigmas; negative where it contradicts
    pending: Annotated[bytes, Field(max_length=MAX_MEANS)] = b""


class PackedMemory(Part):
    """What is remembered of the sources of one level."""

    learner: PackedLearner
    standings: Annotated[list[PackedStanding], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    #: subject -> team time of the newest judgement of its sources; and of the beginning of the second that is not over
    judged: Annotated[dict[Subject, Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    second: Finite | None = None
    #: subject -> the camps of its sources that contradict each other
    camps: Annotated[dict[Subject, list[Names]], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)


class Memory(Message):
    """What a board that learns remembers after a tick: a board of its sub-team that follows it takes it over."""

    board: Name
    sub_team: Name
    run: Annotated[str, Field(max_length=64)] = ""  # of the world; empty: there is none
    tick: Tick
    time: Finite
    consensus: PackedMemory  # of robots
    agreed: PackedMemory  # of sub-teams
