"""How far the clocks of other processes are off this one's, from stamps and round trips, where each goes by its own Unix time. Pure.

A peer's status carries the time `sent` by its clock, and for each board the newest stamp that it had of that board with the
seconds that had passed since this stamp arrived. So, as in NTP, the round trip is what passed here since the stamp less what passed
there, and the peer's clock is ahead by `sent` less the middle of the round trip, with an error of at most half of it. Of the last
few round trips the shortest counts. Those that contradict the newest are of a clock that was set since, and are forgotten.

Without any round trip only what is certain is known: a clock that stamps the future is ahead by as much, at least. A clock that is
behind looks like a slow network until a round trip tells the two apart.
"""

from collections import deque
from collections.abc import Mapping
from typing import TypeVar

from blackboard.process.bounded import put

T = TypeVar("T")

WINDOW = 8  # round trips, and stamps, of each source that are remembered
RESOLUTION = 1e-3  # seconds: a round trip may seem to be shorter than nothing by as much
LONGEST = 2.0  # seconds of a round trip; a longer one is too inexact
TOLERANCE = 0.2  # seconds: a clock that is off by less, or by less than the round trip, is left alone
OLD = 5.0  # seconds without a round trip after which what another board finds counts: the source may have another clock by now
MAX_SOURCES = 256


class ClockOffsets:
    """The offsets of sources by name. All times are in seconds; `now` is this process's Unix time."""

    def __init__(self) -> None:
        self._trips: dict[str, deque[tuple[float, float, float]]] = {}  # round trip, seconds ahead, and when it ended
        self._early: dict[str, deque[float]] = {}  # seconds that stamps were ahead of their arrival
        self._told: dict[str, float] = {}  # what another process found
        self._ahead: dict[str, float] = {}  # what is corrected, which changes in steps of `TOLERANCE` at least

    def round_trip(self, source: str, sent: float, stamp: float, held: float, now: float) -> None:
        """A source sent something at a time of its clock, `held` seconds after it got what this process stamped."""
        trip = now - stamp - held
        if -RESOLUTION <= trip <= LONGEST:
            trip, ahead = max(0.0, trip), sent - (now - trip / 2)
            trips = _kept(self._trips, source)
            agreeing = [t for t in trips if abs(t[1] - ahead) <= (t[0] + trip) / 2 + RESOLUTION]
            trips.clear()
            trips.extend([*agreeing, (trip, ahead, now)])
            self._settle(source)

    def stamped(self, source: str, stamp: float, now: float) -> None:
        """Something that a source stamped by its clock arrives."""
        _kept(self._early, source).append(stamp - now)
        self._settle(source)

    def hear_offsets(self, offsets: Mapping[str, float], now: float) -> None:
        """What another board of the sub-team finds: all of it, where this process has had no round trip of its own lately."""
        over = [source for source, trips in self._trips.items() if trips[-1][2] < now - OLD]
        for source in over:
            del self._trips[source]
        before, self._told = self._told, dict(list(offsets.items())[:MAX_SOURCES])
        for source in dict.fromkeys([*before, *self._told, *over]):
            self._settle(source)

    def ahead(self, source: str) -> float:
        """Seconds by which a source's clock is ahead of this one; negative: behind; 0 where it is near enough, or unknown."""
        return self._ahead.get(source, 0.0)

    def corrections(self) -> dict[str, float]:
        """The clocks that are off, by source."""
        return {source: ahead for source, ahead in sorted(self._ahead.items()) if ahead}

    def _settle(self, source: str) -> None:
        trips, before = self._trips.get(source), self._ahead.get(source, 0.0)
        error = TOLERANCE
        if trips:
            trip, ahead, _ = min(trips)
            error = max(TOLERANCE, trip)
        elif source in self._told:
            ahead = self._told[source]
        else:
            ahead = max(0.0, *self._early.get(source, (0.0,)))
        if abs(ahead) <= error:
            self._ahead.pop(source, None)
        elif abs(ahead - before) > error:
            if len(self._ahead) >= MAX_SOURCES and source not in self._ahead:
                del self._ahead[next(iter(self._ahead))]
            self._ahead[source] = ahead


class StampEchoes:
    """The newest stamp of each peer and when it arrived, to be echoed in the own status."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[float, float]] = {}

    def hear_stamp(self, peer: str, stamp: float, now: float) -> None:
        """Something that a peer stamped arrives."""
        before = self._newest.get(peer)
        put(self._newest, peer, (stamp, now) if before is None or before[0] != stamp else before, MAX_SOURCES)

    def held(self, now: float) -> dict[str, tuple[float, float]]:
        """Peer -> its newest stamp, and the seconds since that arrived."""
        return {peer: (stamp, now - at) for peer, (stamp, at) in sorted(self._newest.items()) if now >= at}


def _kept(table: dict[str, deque[T]], source: str) -> deque[T]:
    """The deque of a source, which becomes the newest; the oldest source is forgotten where there are too many."""
    put(table, source, table.get(source, deque(maxlen=WINDOW)), MAX_SOURCES)
    return table[source]
