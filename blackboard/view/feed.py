"""A fold that follows a running team over a link, or a tape: what `why`, `status`, `top` and the page look through."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Protocol

from blackboard.state.fold import Fold
from blackboard.view.echo import in_order
from blackboard.wire.envelope import Envelope, Kind

WAIT = 0.1  # seconds that a look waits for the next envelope
PLENTY = 1000  # envelopes in one look beyond which only the newest of each key are taken
TAPE_BYTES = 512 << 20  # of the packed moments of a tape
CHUNK = 20  # envelopes of a tape in one look: less than a tick of a small team


class FeedLink(Protocol):
    """What is needed of `blackboard.net.link.Link`."""

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def receive(self, timeout: float) -> list[Envelope]: ...

    def get(self, key_expr: str) -> list[Envelope]: ...


class Feed:
    """Subscribes to everything of a team (`*`: of all teams) in one subscription, which keeps each sender's order; sends nothing."""

    done: bool | None = None  # whether a tape is read to its end; None of a running team

    def __init__(self, link: FeedLink, now: Callable[[], float], team: str = "*") -> None:
        self.fold = Fold()
        self.skipped = 0  # envelopes that were left out because more came than could be taken in
        self._link, self._clock = link, now
        key_expr = f"cop/{team}/**"
        link.watch(key_expr)
        link.subscribe(key_expr)
        at = now()
        # What was settled before this came.
        self.hear_envelopes([(at, envelope) for envelope in in_order(link.get(key_expr))])

    @property
    def now(self) -> float:
        """The time of the clock."""
        return self._clock()

    def receive(self) -> Sequence[tuple[float, Envelope]]:
        """What has arrived, waiting a moment for the first; the fold has not taken it yet. Of plenty, the newest of each key."""
        envelopes = self._link.receive(WAIT)
        at = self._clock()
        kept = newest(envelopes) if len(envelopes) > PLENTY else envelopes
        self.skipped += len(envelopes) - len(kept)
        return [(at, envelope) for envelope in kept]

    def hear_envelopes(self, envelopes: Sequence[tuple[float, Envelope]]) -> None:
        for at, envelope in envelopes:
            self.fold.hear_envelope(envelope, at)

    def follow(self, seconds: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Take in what arrives for so many seconds, or until it is enough."""
        end = self.now + seconds
        while not enough() and self.now < end:
            self.hear_envelopes(self.receive())


class TapeFeed:
    """A tape (`blackboard.tape.file.read`), a few envelopes at a time, at the times at which they were recorded."""

    def __init__(self, envelopes: Iterator[tuple[float, Envelope]]) -> None:
        self.fold = Fold(most_bytes=TAPE_BYTES)
        self.now = 0.0  # Unix seconds
        self.skipped = 0
        self.done: bool | None = False
        self._envelopes = envelopes

    def receive(self) -> Sequence[tuple[float, Envelope]]:
        """The next few; none at the end. UserError: as in `blackboard.tape.file.read`."""
        return list(islice(self._envelopes, CHUNK))

    def hear_envelopes(self, envelopes: Sequence[tuple[float, Envelope]]) -> None:
        self.done = not envelopes
        for at, envelope in envelopes:
            self.now = at
            self.fold.hear_envelope(envelope, at)


#: What comes in, of a link or of a tape. `receive` may be called in another thread than the rest.
Source = Feed | TapeFeed


def newest(envelopes: Sequence[Envelope]) -> list[Envelope]:
    """The newest two PUTs of each key, four of statuses, and every change of liveliness, in their order.

    Two, because the newest may be of a tick that is not settled yet; a board has two statuses in each tick.
    """
    counts: Counter[str] = Counter()
    kept = []
    for envelope in reversed(envelopes):
        if envelope.kind is Kind.PUT:
            counts[envelope.key] += 1
            if counts[envelope.key] > (4 if "/status/" in envelope.key else 2):
                continue
        kept.append(envelope)
    kept.reverse()
    return kept
