"""The inbox of a link: where other threads put envelopes and one thread takes them out, bounded in number and bytes, and fair.

Each source has a quota of its own, so that it can only displace what it sent itself. The source of an envelope is whom its key names;
that it is true, nobody can tell without keys. All who hold no liveliness token share one quota and are read last.
"""

import threading
from collections import Counter, deque
from dataclasses import dataclass, field

from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.keys import READING, identities, writer
from blackboard.wire.raw import MAX_BYTES

#: Kept instead of any larger payload: it is refused for its size, and only that matters.
TOO_LARGE = bytes(MAX_BYTES + 1)

STRANGERS = ""  # the source of everything whose writer holds no token
MAX_TOKENS = 4096  # liveliness tokens that are known at a time; changes of further ones are dropped
CHANGES = 4  # of one token that wait; more are dropped in pairs, so that the newest state stays, and that it changed
STRANGERS_BATCH = 32  # envelopes of strangers that are handed out at once; where more wait, they are a flood
STRANGERS_PAUSE = 0.01  # seconds for which others are waited for first, while strangers flood: refusing costs time


@dataclass(slots=True)
class Slot:
    """An envelope's place in the order of arrival; None once it was taken or dropped."""

    envelope: Envelope | None
    source: str


@dataclass(slots=True)
class SourceQueue:
    """What waits of one source, by key: the key that was not written for longest first."""

    keys: dict[str, deque[Slot]] = field(default_factory=dict)
    count: int = 0
    size: int = 0  # bytes


class Inbox:
    """Queues in order of arrival. Overflow, which is counted, drops the oldest of the key that a source floods, else its oldest key.

    Of strangers it drops what comes last.
    """

    def __init__(
        self,
        most: int = 8192,
        most_bytes: int = 64 << 20,
        batch: int = 256,
        quota: int = 2048,
        quota_bytes: int = 16 << 20,
        pause: float = STRANGERS_PAUSE,
    ) -> None:
        """`most` and `most_bytes` bound all that waits, `quota` and `quota_bytes` that of one source; `pause` is in seconds."""
        self.pause = pause
        self.most, self.most_bytes, self.batch = most, most_bytes, batch
        self.quota, self.quota_bytes = quota, quota_bytes
        self.received = self.dropped = self.bytes_received = 0
        self.strangers = 0  # envelopes that have come of those who hold no token
        self.tokens: frozenset[str] = frozenset()  # that are held
        self._known: deque[Slot] = deque()
        self._strange: deque[Slot] = deque()
        self._sources: dict[str, SourceQueue] = {}
        self._identities: Counter[str] = Counter()  # as whom somebody may write, by how many tokens
        self._changes: dict[str, int] = {}  # token -> its changes that wait
        self._count = self._bytes = 0
        self._arrived = threading.Condition()
        self._poked = False

    def put(self, envelope: Envelope, size: int) -> None:
        """Add an envelope that had `size` bytes of payload on the network."""
        with self._arrived:
            self.received += 1
            self.bytes_received += size
            if envelope.kind in (Kind.ALIVE, Kind.GONE):
                self._put_change(envelope)
            else:
                self._put_sample(envelope)
            if self._waits() or self._strangers() <= STRANGERS_BATCH:  # a flood does not wake the service
                self._arrived.notify()

    def turns_away(self, key: str, size: int) -> bool:
        """Whether an envelope on this key is a stranger's for whom there is no room: then it is counted as dropped."""
        if not self._is_full():
            return False
        with self._arrived:
            if not self._is_full() or self._source_of(key) != STRANGERS:
                return False
            self.received += 1
            self.bytes_received += size
            self.strangers, self.dropped = self.strangers + 1, self.dropped + 1
            return True

    def poke(self) -> None:
        """Let a `drain` that waits, or the next one, return at once."""
        with self._arrived:
            self._poked = True
            self._arrived.notify()

    def drain(self, timeout: float) -> list[Envelope]:
        """The oldest envelopes, those of strangers last, at most a batch, so that the caller can look at the time between two batches.

        Waits up to `timeout` seconds for the first; empty if nothing came. While strangers flood they get what time is left: a
        batch in each pause, and beside others no more than of these.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._count or self._changes or self._poked, timeout)
            poked, self._poked = self._poked, False
            flood = self._strangers() > STRANGERS_BATCH
            if flood and not poked:
                self._arrived.wait_for(self._waits, min(timeout, self.pause))
            envelopes = self._take(self._known, self.batch)
            most = len(envelopes) if flood and envelopes else STRANGERS_BATCH
            return envelopes + self._take(self._strange, min(most, STRANGERS_BATCH, self.batch - len(envelopes)))

    # --- inside, all under the lock -----------------------------------------------------------------------------------

    def _is_full(self) -> bool:
        """Whether strangers have used up their quota."""
        strange = self._sources.get(STRANGERS)
        return strange is not None and (strange.count >= self.quota or strange.size >= self.quota_bytes)

    def _strangers(self) -> int:
        """How many envelopes of strangers wait."""
        strange = self._sources.get(STRANGERS)
        return strange.count if strange is not None else 0

    def _waits(self) -> bool:
        """Whether something waits that is no stranger's."""
        return bool(self._changes) or self._count > self._strangers()

    def _put_change(self, envelope: Envelope) -> None:
        token, here = envelope.key, envelope.kind is Kind.ALIVE
        if here and token not in self.tokens:
            if len(self.tokens) >= MAX_TOKENS:
                self.dropped += 1
                return
            self.tokens |= {token}
            self._identities.update(identities(token))
            self._introduce()
        elif not here and token in self.tokens:
            self.tokens -= {token}
            self._identities.subtract(identities(token))
            self._identities += Counter()  # without those that have no holder any more
        waiting = self._changes.get(token, 0)
        if waiting >= CHANGES:
            mine = [slot for slot in self._known if slot.envelope is not None and _is_change(slot.envelope, token)]
            for slot in mine[1:3]:
                slot.envelope = None
            waiting -= 2
            self.dropped += 2
        self._changes[token] = waiting + 1
        self._known.append(Slot(envelope, token))

    def _put_sample(self, envelope: Envelope) -> None:
        name = self._source_of(envelope.key)
        if name == STRANGERS:
            self.strangers += 1
            if self._is_full():
                self.dropped += 1
                return
        slot, source = Slot(envelope, name), self._sources.setdefault(name, SourceQueue())
        (self._strange if name == STRANGERS else self._known).append(slot)
        self._file(slot, source, envelope)
        while source.count > self.quota or source.size > self.quota_bytes:
            self._drop(source, envelope.key)
        while self._count > self.most or self._bytes > self.most_bytes:
            strange = self._sources.get(STRANGERS)
            greedy = (
                strange
                if strange and strange.count
                else max(self._sources.values(), key=lambda one: (one.size, one.count))
            )
            self._drop(greedy, envelope.key)
        for queue in (self._known, self._strange):
            if len(queue) > 2 * (self.most + len(self._changes) * CHANGES):  # most of it was dropped
                kept = [slot for slot in queue if slot.envelope is not None]
                queue.clear()
                queue.extend(kept)

    def _source_of(self, key: str) -> str:
        name = writer(key)
        if name is None or (name not in self._identities and not READING.match(key)):
            return STRANGERS
        return name

    def _introduce(self) -> None:
        """A token has come: what its holder sent before is no stranger's any more; the order among that is kept."""
        for slot in self._strange:
            if slot.envelope is not None and (name := self._source_of(slot.envelope.key)) != STRANGERS:
                envelope = slot.envelope
                self._forget(slot, envelope)
                slot.envelope = None
                moved = Slot(envelope, name)
                self._known.append(moved)
                self._file(moved, self._sources.setdefault(name, SourceQueue()), envelope)

    def _file(self, slot: Slot, source: SourceQueue, envelope: Envelope) -> None:
        waiting = source.keys.pop(envelope.key, None) or deque()
        waiting.append(slot)
        source.keys[envelope.key] = waiting
        source.count, source.size = source.count + 1, source.size + len(envelope.payload)
        self._count, self._bytes = self._count + 1, self._bytes + len(envelope.payload)

    def _forget(self, slot: Slot, envelope: Envelope) -> None:
        """Count an envelope out that is the oldest of its key and source."""
        source, size = self._sources[slot.source], len(envelope.payload)
        waiting = source.keys[envelope.key]
        waiting.popleft()
        if not waiting:
            del source.keys[envelope.key]
        source.count, source.size = source.count - 1, source.size - size
        self._count, self._bytes = self._count - 1, self._bytes - size
        if not source.count:
            del self._sources[slot.source]

    def _drop(self, source: SourceQueue, key: str) -> None:
        flooded = len(source.keys.get(key, ())) > 1
        slot = source.keys[key if flooded else next(iter(source.keys))][0]
        assert slot.envelope is not None, "what waits by its key has not been taken"
        self._forget(slot, slot.envelope)
        slot.envelope = None
        self.dropped += 1

    def _take(self, queue: deque[Slot], most: int) -> list[Envelope]:
        envelopes: list[Envelope] = []
        while queue and len(envelopes) < most:
            slot = queue.popleft()
            if slot.envelope is None:
                continue
            envelopes.append(slot.envelope)
            if slot.envelope.kind in (Kind.ALIVE, Kind.GONE):
                self._changes[slot.source] -= 1
                if not self._changes[slot.source]:
                    del self._changes[slot.source]
            else:
                self._forget(slot, slot.envelope)
        return envelopes


def _is_change(envelope: Envelope, token: str) -> bool:
    return envelope.key == token and envelope.kind in (Kind.ALIVE, Kind.GONE)
