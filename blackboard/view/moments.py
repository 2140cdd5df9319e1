"""Moments: what a team believed when its boards had settled a tick, kept for the last minutes within a bound of bytes. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from blackboard.opinion.scores import LEAST_PROBABILITY, hdr_level, log_score
from blackboard.view.told import Told, read
from blackboard.wire.messages import Consensus, PackedBelief, Report

MAX_MOMENTS = 3000
MAX_BYTES = 64 << 20  # of all messages that the moments hold
OVERHEAD = 4096  # bytes that a message takes in memory beyond those on the wire

Point = tuple[float, float]


@dataclass(frozen=True)
class Scored:
    """A belief against the truth: distance of its mean (unit), log score (nats), and the mass denser than the true cell.

    The truth is in the region of a share of the mass where `denser` is below that share.
    """

    error: float
    log_score: float
    denser: float


@dataclass(frozen=True)
class About:
    """What is known of a subject: sub-team -> agreed, sub-team -> consensus, source -> report, and the truth if it is told."""

    agreed: Mapping[str, Told[Consensus]] = field(default_factory=dict)
    consensus: Mapping[str, Told[Consensus]] = field(default_factory=dict)
    reports: Mapping[str, Told[Report]] = field(default_factory=dict)
    truth: Point | None = None
    scores: Mapping[str, Scored] = field(default_factory=dict)  # "agreed", and sub-teams by "consensus/{sub_team}"

    @property
    def best(self) -> Told[Consensus] | None:
        """The agreed belief, of the newest tick and then of the sub-team whose name sorts first; else a consensus, the same way."""
        for told in (self.agreed, self.consensus):
            if told:
                return told[min(told, key=lambda name: (-told[name].message.tick, name))]
        return None

    def all(self) -> Iterator[Told[Report] | Told[Consensus]]:
        yield from self.agreed.values()
        yield from self.consensus.values()
        yield from self.reports.values()


@dataclass(frozen=True)
class Moment:
    """A settled tick: `time` in seconds of team time, `at` in Unix seconds; sightings are pairs of observer and subject."""

    run: str
    tick: int
    time: float
    at: float
    subjects: Mapping[str, About]
    sightings: tuple[tuple[str, str], ...] = ()


class Moments:
    """The newest moments, at most MAX_MOMENTS and about MAX_BYTES; a message that several moments share counts once."""

    def __init__(self, most: int = MAX_MOMENTS, most_bytes: int = MAX_BYTES) -> None:
        self.most, self.most_bytes = most, most_bytes
        self.bytes = 0
        self._kept: deque[tuple[Moment, int]] = deque()
        self._held: set[int] = set()  # identities of the messages of the newest moment

    def __len__(self) -> int:
        return len(self._kept)

    def __iter__(self) -> Iterator[Moment]:
        return (moment for moment, _ in self._kept)

    @property
    def newest(self) -> Moment | None:
        return self._kept[-1][0] if self._kept else None

    def at(self, tick: int) -> Moment | None:
        """The moment of a tick, if it is still kept."""
        return next((moment for moment in reversed([*self]) if moment.tick == tick), None)

    def add(self, moment: Moment) -> None:
        told = [one for about in moment.subjects.values() for one in about.all()]
        size = OVERHEAD + sum(one.size + OVERHEAD for one in told if id(one) not in self._held)
        self._held = {id(one) for one in told}
        self._kept.append((moment, size))
        self.bytes += size
        while len(self._kept) > self.most or (self.bytes > self.most_bytes and len(self._kept) > 1):
            self.bytes -= self._kept.popleft()[1]

    def clear(self) -> None:
        self._kept.clear()
        self._held.clear()
        self.bytes = 0


def scored(packed: PackedBelief, truth: Point) -> Scored | None:
    """A belief of the wire against the truth, as `blackboard.opinion.scores.Score` judges; None where it is no belief on two axes."""
    belief = read(packed) if len(packed.grid.shape) == 2 else None
    if belief is None:
        return None
    index = belief.grid.index(truth)
    return Scored(
        error=math.dist(belief.mean(), truth),
        log_score=math.log(LEAST_PROBABILITY) if index is None else log_score(belief.p, index),
        denser=1.0 if index is None else hdr_level(belief.p, index),
    )
