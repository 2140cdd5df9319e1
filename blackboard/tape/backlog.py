"""Bytes on their way to a file whose disk may be full for a while."""

from collections import deque
from typing import BinaryIO

MOST = 1 << 24  # bytes that may wait for room


class Backlog:
    """Keeps what the file does not take, and offers it again before anything newer, so that the file is a whole beginning of it.

    A stream for `mcap.writer.Writer`, which must never meet an error: it would leave a piece of a record behind, and what follows
    could not be read. `count` is the number of messages that all bytes given so far hold.
    """

    def __init__(self, file: BinaryIO) -> None:
        """`file` is unbuffered: `write` returns how many bytes it took."""
        self._file = file
        self._waiting = deque[tuple[memoryview, int]]()  # a part of the bytes, and `count` at its end
        self._given = 0
        self.bytes_waiting = 0
        self.count = 0
        self.kept = 0  # messages that are in the file
        self.trouble = ""  # why the file takes nothing more; empty while it does

    @property
    def is_full(self) -> bool:
        """Whether so much waits that nothing more should be given."""
        return self.bytes_waiting >= MOST

    def write(self, data: bytes) -> int:
        """Take all of it, and offer to the file what waits."""
        if data:
            self._waiting.append((memoryview(data), self.count))
            self._given += len(data)
            self.bytes_waiting += len(data)
        self.flush()
        return len(data)

    def tell(self) -> int:
        """The place in the file at which the next bytes will be."""
        return self._given

    def flush(self) -> None:
        """Offer to the file what waits; `trouble` says why it did not take all."""
        self.trouble = ""
        try:
            while self._waiting:
                data, count = self._waiting[0]
                taken = self._file.write(data)
                self.bytes_waiting -= taken
                if taken < len(data):
                    self._waiting[0] = data[taken:], count
                else:
                    self._waiting.popleft()
                    self.kept = count
        except OSError as error:
            self.trouble = error.strerror or str(error)
