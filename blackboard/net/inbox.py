"""The inbox of a link: where other threads put envelopes and one thread takes them out, bounded in number and bytes."""

from __future__ import annotations

import threading
from collections import deque

from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_BYTES

#: Kept instead of any larger payload: it is refused for its size, and only that matters.
TOO_LARGE = bytes(MAX_BYTES + 1)


class Inbox:
    """One queue, in order of arrival. Overflow drops the oldest sample, never a change of liveliness, and is counted."""

    def __init__(self, most: int = 8192, most_bytes: int = 64 << 20, batch: int = 256) -> None:
        self.most, self.most_bytes, self.batch = most, most_bytes, batch
        self.received = self.dropped = self.bytes_received = 0
        self._waiting: deque[Envelope] = deque()
        self._bytes = 0
        self._arrived = threading.Condition()

    def put(self, envelope: Envelope, size: int) -> None:
        """Add an envelope that had `size` bytes of payload on the network."""
        with self._arrived:
            self.received += 1
            self.bytes_received += size
            self._waiting.append(envelope)
            self._bytes += len(envelope.payload)
            while len(self._waiting) > self.most or self._bytes > self.most_bytes:
                if not self._drop_oldest():
                    break
            self._arrived.notify()

    def drain(self, timeout: float) -> list[Envelope]:
        """The oldest envelopes, at most a batch of them, so that the caller can look at the time between two batches.

        Waits up to `timeout` seconds for the first; empty if nothing came.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._waiting, timeout)
            found = [self._waiting.popleft() for _ in range(min(self.batch, len(self._waiting)))]
            self._bytes -= sum(len(envelope.payload) for envelope in found)
            return found

    def _drop_oldest(self) -> bool:
        for i, envelope in enumerate(self._waiting):
            if envelope.kind in (Kind.PUT, Kind.DELETE):
                del self._waiting[i]
                self._bytes -= len(envelope.payload)
                self.dropped += 1
                return True
        return False
