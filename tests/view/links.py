"""A recorded run in place of the network, for commands that look at a running team."""

from types import TracebackType
from typing import Any

import pytest

from blackboard.run import door
from blackboard.view import __main__ as room
from blackboard.view import source
from blackboard.wire.envelope import Envelope
from tests.clocks import ManualClock
from tests.view.recorded import Deaf, recorded


class Recording(Deaf):
    """A link on which a run is told in pieces; the clock goes on with each, by a tenth of a second."""

    clock = ManualClock(1_000_000.0)

    def __init__(self, *_: Any, **__: Any) -> None:
        self.left = [envelope for envelope, _ in recorded()]
        self.team = "*"

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        return

    def subscribe(self, key_expr: str) -> None:
        self.team = "*" if key_expr == "**" else key_expr.split("/")[1]

    def get(self, key_expr: str) -> list[Envelope]:
        """The statuses of all, where these are asked for."""
        return [envelope for envelope, _ in recorded() if "/status/" in envelope.key] if "/status/" in key_expr else []

    def receive(self, timeout: float) -> list[Envelope]:
        self.clock.advance(0.1)
        taken, self.left = self.left[:50], self.left[50:]
        return [envelope for envelope in taken if self.team in ("*", "**", envelope.key.split("/")[1])]


def put_in_place(monkeypatch: pytest.MonkeyPatch, link: type[Recording] = Recording) -> None:
    """Let commands open this link, go by its clock, and leave the signal handlers of this process alone."""
    for module in (room, source):
        monkeypatch.setattr(module, "Link", link)
        monkeypatch.setattr(module, "UnixClock", lambda: link.clock)
    monkeypatch.setattr(door, "Stop", lambda: lambda: False)
