"""The recorder: every message and token of a team goes onto a tape (`blackboard.process.service.Service`)."""

from __future__ import annotations

from blackboard.tape.file import TapeWriter
from blackboard.wire.envelope import Envelope

FLUSH = 1.0  # seconds between two flushes: what a kill -9 loses at most


class Recorder:
    """Only listens: it sends nothing and holds no token."""

    tokens: tuple[str, ...] = ()
    done = False

    def __init__(self, team: str, writer: TapeWriter) -> None:
        self._team, self._writer = team, writer
        self._flush_due = 0.0  # Unix seconds; at once, so that whoever waits for the tape sees that it listens
        self._counters: dict[str, int] = {}

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
        self._flush_due = now + FLUSH
        return []

    def wake_at(self, now: float) -> float | None:
        return self._flush_due

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self._counters = counters
