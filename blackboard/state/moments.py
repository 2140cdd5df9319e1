"""Moments: what a team believed when its boards had settled a tick, kept for the last minutes within a bound of bytes. Pure."""

import math
import pickle
import zlib
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from blackboard.opinion.scores import LEAST_PROBABILITY, border_mass, hdr_level, held, log_score
from blackboard.state.received import REGION, Received, read
from blackboard.wire.messages import Consensus, PackedBelief, Report

MAX_MOMENTS = 20_000
MAX_BYTES = 64 << 20  # of the moments that are packed
ROUNDED = 1e-6  # seconds by which a time may be off because it was rounded
FRESH = 4  # moments that are kept as they are, because they are looked at most; older ones are packed

Point = tuple[float, float]


@dataclass(frozen=True)
class Scored:
    """A belief against the truth: distance of its mean (unit), log score (nats), and the mass denser than the true cell.

    The truth is in the region of a share of the mass where `denser` is below that share. `held` is how far the 95 % region holds it,
    which is in part where it is on the border (`blackboard.opinion.scores.held`): its mean is the coverage.
    """

    error: float
    log_score: float
    denser: float
    held: float


@dataclass(frozen=True)
class About:
    """What is known of a subject: sub-team -> agreed, sub-team -> consensus, source -> report, and the truth if it is known."""

    agreed: Mapping[str, Received[Consensus]] = field(default_factory=dict)
    consensus: Mapping[str, Received[Consensus]] = field(default_factory=dict)
    reports: Mapping[str, Received[Report]] = field(default_factory=dict)
    truth: Point | None = None

    @cached_property
    def scores(self) -> Mapping[str, Scored]:
        """Beliefs against the truth, where it is known: "agreed", and sub-teams by "consensus/{sub_team}"."""
        if self.truth is None:
            return {}
        told = {f"consensus/{name}": received for name, received in self.consensus.items()}
        if self.agreed and self.best is not None:
            told["agreed"] = self.best
        judged = {name: scored(received.message.belief, self.truth) for name, received in told.items()}
        return {name: score for name, score in judged.items() if score is not None}

    @property
    def best(self) -> Received[Consensus] | None:
        """The agreed belief, of the newest tick and then of the sub-team whose name sorts first; else a consensus, the same way."""
        for told in (self.agreed, self.consensus):
            if told:
                return told[min(told, key=lambda name: (-told[name].message.tick, name))]
        return None

    @property
    def share(self) -> float:
        """How solid it is to be drawn: a track by its existence, and what a sighting may be of by that sighting's odds."""
        if self.best is None:
            return 1.0
        consensus = self.best.message
        unclear = max((one.probability for one in consensus.unnamed), default=1.0)
        clear = consensus.existence is None or any(one.taken for one in consensus.unnamed)
        return (1.0 if consensus.existence is None else consensus.existence) * (1.0 if clear else unclear)

    def all(self) -> Iterator[Received[Report] | Received[Consensus]]:
        yield from self.agreed.values()
        yield from self.consensus.values()
        yield from self.reports.values()


@dataclass(frozen=True)
class Moment:
    """A settled tick: `time` in seconds of team time, `at` in Unix seconds.

    Sightings are pairs of observer and subject; `speeds` are those of robots by name, in units per second.
    """

    run: str
    tick: int
    time: float
    at: float
    subjects: Mapping[str, About]
    sightings: tuple[tuple[str, str], ...] = ()
    speeds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class When:
    """Which moment is meant: that of a tick, or the newest that is not later than so many seconds of team time."""

    tick: int | None = None
    seconds: float | None = None

    @staticmethod
    def of(text: str) -> "When":
        """A tick as 200, or seconds as 20s. ValueError: it is neither."""
        if text.endswith("s"):
            seconds = float(text[:-1])
            if not 0 <= seconds < math.inf:
                raise ValueError(text)
            return When(seconds=seconds)
        return When(tick=int(text))

    def __str__(self) -> str:
        return f"tick {self.tick}" if self.tick is not None else f"second {self.seconds:g}"

    def fits(self, moment: Moment) -> bool:
        """Whether a moment is meant, or where seconds are meant, is not later than these."""
        return moment.tick == self.tick if self.seconds is None else moment.time <= self.seconds + ROUNDED

    def is_reached(self, newest: Moment) -> bool:
        """Whether no later moment than the newest can fit."""
        return newest.tick >= (self.tick or 0) if self.seconds is None else newest.time >= self.seconds - ROUNDED


class Timeline:
    """The newest moments, at most `most` and about `most_bytes`. All but the newest FRESH are packed, to a tenth of their memory."""

    def __init__(self, most: int = MAX_MOMENTS, most_bytes: int = MAX_BYTES) -> None:
        self.most, self.most_bytes = most, most_bytes
        self.bytes = 0  # of the packed ones
        self._fresh: deque[Moment] = deque()
        self._packed: deque[tuple[int, bytes]] = deque()  # tick and moment

    def __len__(self) -> int:
        return len(self._packed) + len(self._fresh)

    def __iter__(self) -> Iterator[Moment]:
        yield from (_unpacked(packed) for _, packed in self._packed)
        yield from self._fresh

    @property
    def newest(self) -> Moment | None:
        return self._fresh[-1] if self._fresh else None

    @property
    def ticks(self) -> list[int]:
        """The ticks of all that are kept, the oldest first."""
        return [tick for tick, _ in self._packed] + [moment.tick for moment in self._fresh]

    def since(self, tick: int) -> list[Moment]:
        """The moments after a tick, the oldest first."""
        packed = [_unpacked(packed) for at, packed in self._packed if at > tick]
        return packed + [moment for moment in self._fresh if moment.tick > tick]

    def at(self, tick: int) -> Moment | None:
        """The moment of a tick, if it is still kept."""
        fresh = next((moment for moment in self._fresh if moment.tick == tick), None)
        if fresh is not None:
            return fresh
        packed = next((packed for at, packed in self._packed if at == tick), None)
        return None if packed is None else _unpacked(packed)

    def add(self, moment: Moment) -> None:
        self._fresh.append(moment)
        if len(self._fresh) > FRESH:
            old = self._fresh.popleft()
            packed = zlib.compress(pickle.dumps(old, protocol=5), 1)
            self._packed.append((old.tick, packed))
            self.bytes += len(packed)
        while self._packed and (len(self) > self.most or self.bytes > self.most_bytes):
            self.bytes -= len(self._packed.popleft()[1])

    def clear(self) -> None:
        self._fresh.clear()
        self._packed.clear()
        self.bytes = 0


def _unpacked(packed: bytes) -> Moment:
    moment: Moment = pickle.loads(zlib.decompress(packed))  # only what `add` packed in this process
    return moment


def scored(packed: PackedBelief, truth: Point) -> Scored | None:
    """A belief of the wire against the truth, as `blackboard.opinion.scores.Score` judges; None where it is no belief on two axes."""
    belief = read(packed) if len(packed.grid.shape) == 2 else None
    if belief is None:
        return None
    index = belief.grid.index(truth)
    denser, border = (1.0, 0.0) if index is None else (hdr_level(belief.p, index), border_mass(belief.p, index))
    return Scored(
        error=math.dist(belief.mean(), truth),
        log_score=math.log(LEAST_PROBABILITY) if index is None else log_score(belief.p, index),
        denser=denser,
        held=float(held(denser, border, REGION)),
    )
