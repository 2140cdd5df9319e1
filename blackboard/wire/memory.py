"""What a board remembers of its sources, on the wire: for the boards that follow it, and for tapes.

Everything that a board has learned follows from these numbers, to the bit (`blackboard.board.memory` packs and checks them).
"""

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
    """on what"""
    time: Finite
    """its team time, seconds"""
    sources: Annotated[bytes, Field(max_length=64)]
    """who was compared, as ascending places in `sources` of the PackedLearner"""
    means: Annotated[bytes, Field(max_length=MAX_MEANS)]
    """the means of their opinions: float64, little-endian, a row for each"""


class PackedLearner(Part):
    """The comparisons of opinions that a board learns from (docs/believing.md, "A board that learns").

    `counts` has a byte for each pair of sources i < j, in the order (0, 1), (0, 2), ..., (1, 2), ...: how many samples follow in
    `samples`, the oldest first, each 8 bytes: float32 `a`, float16 `alike`, float16 `turned`, little-endian.
    """

    sources: Names = Field(default_factory=list)
    """who was compared, sorted; more than 64 are not taken"""
    heard: Ancestors = Field(default_factory=dict)
    """of each source the team time of its newest sample"""
    since: Ancestors = Field(default_factory=dict)
    """team time since which a source has been held over-confident or an echo"""
    counts: Annotated[bytes, Field(max_length=MAX_PAIRS)] = b""
    """a byte for each pair of sources, (0, 1), (0, 2), ..., (1, 2), ...: how many samples it has, at most 50"""
    samples: Annotated[bytes, Field(max_length=MAX_SAMPLES)] = b""
    """the samples of all pairs in that order, the oldest of a pair first, each 8 bytes, little-endian: float32, the
    squared distance; float16, how alike the widths are, 0 to 1; float16, the cosine between this difference and the
    one before, NaN where there is none
    """
    newest: Annotated[list[PackedNewest], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """the newest comparison on each subject"""


class PackedStanding(Part):
    """How far a source disagreed with the others (docs/faults.md, "Who disagrees is named")."""

    source: Name
    """whose"""
    heard: Finite
    """team time of its newest judgement, seconds"""
    share: NonNegative = 0.0
    """of the seconds that speak against it, at most 1, the newest counting most"""
    seconds: Count = 0
    """how many there were"""
    sigmas: NonNegative = 0.0
    """how far it was from the others, in the sigmas that both claim"""
    since: Finite | None = None
    """team time since which it is named, seconds; none: it is not"""
    pending: Annotated[bytes, Field(max_length=MAX_MEANS)] = b""
    """of the second that is not over: a float64, little-endian, for each judgement: how many sigmas, negative where it
    contradicts
    """


class PackedMemory(Part):
    """What is remembered of the sources of one level."""

    learner: PackedLearner
    """the comparisons that the board learns from"""
    standings: Annotated[list[PackedStanding], Field(max_length=MAX_OPINIONS)] = Field(default_factory=list)
    """how far each source disagreed with the others"""
    judged: Annotated[dict[Subject, Finite], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """team time at which the sources of a subject were judged last"""
    second: Finite | None = None
    """team time at which the second began that is not over; none: nothing was judged"""
    camps: Annotated[dict[Subject, list[Names]], Field(max_length=MAX_OPINIONS)] = Field(default_factory=dict)
    """the camps of a subject's sources that contradict each other"""


class Memory(Message):
    """What a board that learns (`independence = "learn"` for some subject) and leads its sub-team remembers, after the first
    tick of each second of team time. A board that follows it takes that over, so that a board that was restarted is as its twin
    from then on; a replay of a tape that begins late does the same. A board takes it only from the board that leads its own
    sub-team, of the same `run` and stamped as a Consensus may be. In lockstep it takes none of an older tick than it has
    settled. All numbers are checked: where one is out of its bounds, the whole message is refused (`fields`). Of more than fits
    a message nothing is sent (counter `memory_too_large`); 8 sources of a level take 12 kB.
    """

    board: Name
    """which board; the same as in the key"""
    sub_team: Name
    """its sub-team; the same as in the key"""
    run: Annotated[str, Field(max_length=64)] = ""
    """that of the world's Clock; empty: there is no world"""
    tick: Tick
    """the tick that was settled"""
    time: Finite
    """its team time, seconds; no other time is later"""
    consensus: PackedMemory
    """of robots"""
    agreed: PackedMemory
    """of sub-teams, in the exchange"""
