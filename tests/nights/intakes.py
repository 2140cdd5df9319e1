"""Messages that a process cannot judge yet: each is handled once, or counted as dropped, or replaced by a newer one of its key."""

from dataclasses import dataclass
from typing import Any

from blackboard.process.intake import Intake
from blackboard.process.service import Service
from blackboard.wire.envelope import Envelope
from tests.nights.events import Began, Event, Heard, Moved
from tests.nights.night import Night
from tests.nights.oracles import Oracle


@dataclass(frozen=True)
class Account:
    """What an intake has kept, by key, and how often it has counted what it did."""

    kept: dict[str, object]  # a message that comes twice is kept as another object
    heard: int
    given_up: int  # refused, dropped for want of room, or broken by an exception
    failed: int

    @classmethod
    def of(cls, service: Service) -> "Account | None":
        """Of a service; None: it has no intake of its own."""
        at: Any = getattr(service, "peer", service)
        intake = getattr(at, "intake", None)
        if not isinstance(intake, Intake):
            return None
        counters, early = intake.counters, intake.kept
        given_up = intake.refused.total() + counters["early_dropped"] + counters["failed"]
        return cls(dict(early), counters["heard"], given_up, counters["failed"])


class EarlyIsKept(Oracle):
    """What a process hears it handles once: at once, or later. Nothing vanishes that it does not count as refused or dropped."""

    sees = (Began, Heard, Moved)

    def __init__(self, night: Night) -> None:
        super().__init__(night)
        self._before: dict[str, Account] = {}  # by process
        self._came: dict[str, Envelope] = {}  # what a process hears until it has moved

    def see(self, event: Event) -> None:
        if isinstance(event, Heard):
            self._came[event.process] = event.envelope
        elif isinstance(event, Began):
            self._came.pop(event.process, None)
            self._keep(event.process, Account.of(event.service))
        elif isinstance(event, Moved):
            before, now = self._before.get(event.process), Account.of(event.service)
            if before is not None and now is not None:
                self._judge(event, before, now, self._came.pop(event.process, None))
            self._keep(event.process, now)

    def _keep(self, process: str, account: Account | None) -> None:
        if account is not None:
            self._before[process] = account

    def _judge(self, event: Moved, before: Account, now: Account, came: Envelope | None) -> None:
        is_kept = came is not None and came.key in now.kept and now.kept[came.key] is not before.kept.get(came.key)
        replaced = came.key if came is not None and is_kept and came.key in before.kept else None
        gone = [key for key, one in before.kept.items() if now.kept.get(key) is not one and key != replaced]
        left = len(gone) + (came is not None and not is_kept)
        handled = now.heard - before.heard
        if handled > left:
            self.breaks(event.at, f"{event.process} handles {handled} messages, of which it keeps some")
        elif left > handled + now.given_up - before.given_up:
            what = gone[0] if gone else "" if came is None else came.key
            self.breaks(event.at, f"{event.process} neither handles nor keeps {what}")
