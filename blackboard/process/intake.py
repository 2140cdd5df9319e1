"""Intake: what every process does with the bytes that reach it. Open, count, refuse, warn once, and keep what came too early."""

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from blackboard.errors import Refused
from blackboard.process.bounded import put
from blackboard.process.failures import Failures
from blackboard.process.printable import quoted
from blackboard.process.refusals import Refusals
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status
from blackboard.wire.types import Message

log = logging.getLogger(__name__)

STATUS_PERIOD = 1.0  # seconds between statuses while nothing else is sent
MAX_WARNINGS = 1000  # sources and reasons that are remembered as logged
MAX_AGES = 256  # sources whose age is shown
MAX_EARLY = 1024  # keys of which the newest envelope is kept until it can be judged
MAX_EARLY_BYTES = 8 << 20  # payload bytes of all these together
WAIT = 3.0  # seconds that messages on a key wait before the log says that they are refused

#: Takes the parts of a key and its message; returns the envelopes to send. Raises Refused, or `TooEarly`.
Handler = Callable[[dict[str, str], Message], list[Envelope]]


class TooEarly(Exception):
    """A handler cannot judge a message yet: `Intake.retry` hands it over again.

    With a `refusal` the message is counted as refused now, and may be handled after all: its sender's token may be on
    its way. So the refusal is logged only after `WAIT`, or once the message is dropped.
    """

    def __init__(self, refusal: Refused | None = None) -> None:
        super().__init__()
        self.refusal = refusal


@dataclass
class _Early:
    """An envelope that came too early; `since`: Unix seconds, when the first of those that it replaced came."""

    envelope: Envelope
    since: float
    refusal: Refused | None


class Intake:
    """Opens envelopes for one service, and has the counters that its Status shows.

    `counters` counts, besides what the service adds, "heard" (messages that were handled), "early_dropped" (kept and then
    dropped for want of room), "failed" (exceptions that it survived), and the link's "sent", "received", "dropped" and "bytes".
    `refused` counts by reason.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.refusals = Refusals()  # by source, for a board to tell
        self.failures = Failures(self.counters)
        self.status_due = 0.0  # Unix seconds
        self._heard_at: dict[str, float] = {}  # source -> Unix seconds, the one that is silent for longest first
        self._warned: set[tuple[str, str]] = set()  # keys and reasons
        self._early: dict[str, _Early] = {}  # key -> the newest, the oldest arrival first
        self._early_bytes = 0

    def on_envelope(self, envelope: Envelope, handle: Handler, now: float) -> list[Envelope]:
        """Hand the message of a PUT to `handle` and return its answers; none for other kinds and for what is refused."""
        if envelope.kind is not Kind.PUT:
            return []
        try:
            return self._hand_over(envelope, handle)
        except TooEarly as early:
            self._keep(envelope, early.refusal, now)
            if early.refusal is not None:
                self._count(envelope.key, early.refusal, early=True)
            return []

    def retry(self, handle: Handler) -> list[Envelope]:
        """Hand over again all that came too early, in order of arrival."""
        kept, self._early, self._early_bytes = self._early, {}, 0
        answers = []
        for key, early in kept.items():
            try:
                answers += self._hand_over(early.envelope, handle)
            except TooEarly:
                self._early[key] = early
                self._early_bytes += len(early.envelope.payload)
        return answers

    def _hand_over(self, envelope: Envelope, handle: Handler) -> list[Envelope]:
        with self.failures.survive(envelope.key, TooEarly):
            try:
                _, parts, message = open_envelope(envelope)
                answers = handle(parts, message)
                self.counters["heard"] += 1
                self.refusals.handled(envelope.key)
                return answers
            except Refused as refusal:
                self._count(envelope.key, refusal)
                self._log(envelope.key, refusal)
        return []

    @property
    def doubted(self) -> dict[str, str]:
        """The keys of what was refused and may be handled after all, with the reasons."""
        return {key: early.refusal.reason for key, early in self._early.items() if early.refusal is not None}

    @property
    def kept(self) -> dict[str, _Early]:
        """What came too early, by key."""
        return self._early

    def record_link_counters(self, counters: dict[str, int]) -> None:
        """Show the link's counters beside the service's own."""
        for name, count in counters.items():
            self.counters[name] = count

    def record_age(self, source: str, now: float) -> None:
        """Remember that a source was heard now; the status shows how long ago that is."""
        put(self._heard_at, source, now, MAX_AGES)

    def counted(self, status: Status, now: float) -> Status:
        """A status with counters and ages as they stand; the next one is due `STATUS_PERIOD` after `now`."""
        self.status_due = now + STATUS_PERIOD
        for early in self._early.values():
            self._log_overdue(early, now)
        ages = {source: now - at for source, at in sorted(self._heard_at.items())}
        counts = {"counters": dict(self.counters), "refused": dict(self.refused), "ages": ages}
        return status.model_copy(update=counts)

    def _keep(self, envelope: Envelope, refusal: Refused | None, now: float) -> None:
        """Keep the newest envelope per key; the oldest are dropped where there are too many, or too many bytes."""
        before = self._early.pop(envelope.key, None)
        self._early_bytes += len(envelope.payload) - (0 if before is None else len(before.envelope.payload))
        early = self._early[envelope.key] = _Early(envelope, now if before is None else before.since, refusal)
        self._log_overdue(early, now)
        while len(self._early) > MAX_EARLY or self._early_bytes > MAX_EARLY_BYTES:
            dropped = self._early.pop(next(iter(self._early)))
            self._early_bytes -= len(dropped.envelope.payload)
            self.counters["early_dropped"] += 1
            self._log(dropped.envelope.key, dropped.refusal)

    def _log_overdue(self, early: _Early, now: float) -> None:
        if now - early.since >= WAIT:
            self._log(early.envelope.key, early.refusal)

    def _count(self, key: str, refusal: Refused, *, early: bool = False) -> None:
        self.refused[refusal.reason] += 1
        self.refusals.record(key, refusal, early=early)

    def _log(self, key: str, refusal: Refused | None) -> None:
        """Log why a message was refused, once per source and reason; None: it was not refused."""
        if refusal is None or len(self._warned) >= MAX_WARNINGS:
            return
        shown = quoted(key)
        if (shown, refusal.reason) in self._warned:
            return
        self._warned.add((shown, refusal.reason))
        log.warning("refused %s (%s); counted, and not logged again for this source", shown, quoted(str(refusal)))
