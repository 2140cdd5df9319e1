"""The recorder: every message and token of a team goes onto a tape (`blackboard.process.service.Service`)."""

import logging

from blackboard.process.service import Quiet
from blackboard.tape.file import TapeWriter
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Disk

log = logging.getLogger(__name__)

FLUSH = 1.0  # seconds between two flushes: what a kill -9 loses at most
NAME = "recorder"  # on its key, as on its certificate


class Recorder(Quiet):
    """Listens and holds no token. It speaks only while its disk takes nothing, and once when that is over."""

    def __init__(self, team: str, writer: TapeWriter) -> None:
        self._team, self._writer = team, writer
        self._flush_due = 0.0  # Unix seconds; at once, so that a process that waits for the tape sees that it listens
        self._counters: dict[str, int] = {}
        self._trouble = ""  # of the disk, as told last
        self.listens = self.watches = (f"cop/{team}/**",)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._writer.write(now, envelope)
        return []

    def wake(self, now: float) -> list[Envelope]:
        self._writer.note(now, self._counters)
        self._writer.flush()
        self._flush_due = now + FLUSH
        before, self._trouble = self._trouble, self._writer.trouble
        if not (before or self._trouble):
            return []
        self._log(before)
        told = Disk(recorder=NAME, trouble=self._trouble, missing=self._writer.missing)
        return [Envelope(keys.DISK.key(team=self._team, recorder=NAME), encode(told))]

    def wake_at(self, now: float) -> float | None:
        return self._flush_due

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self._counters = counters

    def _log(self, before: str) -> None:
        if self._trouble and not before:
            log.warning("the tape cannot be written: %s; trying again", self._trouble)
        elif not self._trouble:
            log.warning("the tape is written again")
