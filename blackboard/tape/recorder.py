"""The recorder: every message and token of a team goes onto a tape (`blackboard.process.service.Service`)."""

from __future__ import annotations

import logging

from blackboard.tape.file import TapeWriter
from blackboard.wire.envelope import Envelope

log = logging.getLogger(__name__)

FLUSH = 1.0  # seconds between two flushes: what a kill -9 loses at most


class Recorder:
    """Only listens: it sends nothing and holds no token."""

    tokens: tuple[str, ...] = ()
    done = False

    def __init__(self, team: str, writer: TapeWriter) -> None:
        self._team, self._writer = team, writer
        self._flush_due = 0.0  # Unix seconds; at once, so that a process that waits for the tape sees that it listens
        self._counters: dict[str, int] = {}
        self._trouble = ""  # of the disk, as logged last

    @property
    def listens(self) -> tuple[str, ...]:
        return (f"cop/{self._team}/**",)

    @property
    def watches(self) -> tuple[str, ...]:
        return self.listens

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._writer.write(now, envelope)
        return []

    def wake(self, now: float) -> list[Envelope]:
        self._writer.note(now, self._counters)
        self._writer.flush()
        self._log_trouble()
        self._flush_due = now + FLUSH
        return []

    def wake_at(self, now: float) -> float | None:
        return self._flush_due

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self._counters = counters

    def _log_trouble(self) -> None:
        trouble = self._writer.trouble
        if trouble and not self._trouble:
            log.warning("the tape cannot be written: %s; trying again", trouble)
        elif self._trouble and not trouble:
            log.warning("the tape is written again")
        self._trouble = trouble
