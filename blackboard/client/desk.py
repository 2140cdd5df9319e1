"""What stands between the team's thread and the program's: calls into the service, and streams of what was agreed on."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from queue import SimpleQueue
from typing import TypeVar

from blackboard.client.agreed import Agreed
from blackboard.process.service import Around, Service
from blackboard.wire.envelope import Envelope

T = TypeVar("T")

LOOK = 0.5  # seconds between two looks whether the team was closed, while a call is waited for

#: What is called in the team's thread with the Unix time, and what came of it, with the envelopes to send.
Call = Callable[[float], tuple[T, list[Envelope]]]


class Desk(Around):
    """A service, and calls from other threads, which are made in the service's own (`blackboard.process.service.Service`)."""

    def __init__(self, service: Service) -> None:
        super().__init__(service)
        self._calls: SimpleQueue[Callable[[float], list[Envelope]]] = SimpleQueue()
        self._out: list[Envelope] = []  # what is to be sent for calls that were made inside a callback
        self._owner: int | None = None  # the service's thread
        self._now = 0.0
        self.stop = threading.Event()
        self.poke: Callable[[], None] = lambda: None  # lets the loop look for calls at once

    def call(self, call: Call[T]) -> T:
        """Call in the service's thread and wait for the result, or raise what it raised. RuntimeError: the team is closed."""
        if threading.get_ident() == self._owner:  # in a callback
            value, out = call(self._now)
            self._out += out
            return value
        result: Future[T] = Future()

        def make(now: float) -> list[Envelope]:
            try:
                value, out = call(now)
            except Exception as error:
                result.set_exception(error)
                return []
            result.set_result(value)
            return out

        self._calls.put(make)
        self.poke()
        while not wait([result], timeout=LOOK).done:
            if self.stop.is_set() and not result.done():
                raise RuntimeError("the team is closed")
        return result.result()

    # --- what the loop needs ------------------------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        return self.stop.is_set()

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self._owner, self._now = threading.get_ident(), now
        return self._with_calls(super().receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        self._owner, self._now = threading.get_ident(), now
        out: list[Envelope] = []
        while not self._calls.empty():
            out += self._calls.get()(now)
        return self._with_calls(out + super().wake(now))

    def _with_calls(self, out: list[Envelope]) -> list[Envelope]:
        mine, self._out = self._out, []
        return out + mine

    def wake_at(self, now: float) -> float | None:
        return super().wake_at(now) if self._calls.empty() else now


class AgreedStream:
    """The newest of each subject that nobody has taken yet, in the order of arrival."""

    def __init__(self) -> None:
        self._waiting: dict[str, Agreed] = {}
        self._changed = threading.Condition()
        self._closed = False
        self.listener: Callable[[], None] = lambda: None  # called, in the team's thread, when something has come

    def put(self, agreed: Agreed) -> None:
        with self._changed:
            self._waiting.pop(agreed.subject, None)
            self._waiting[agreed.subject] = agreed
            self._changed.notify_all()
        self.listener()

    def close(self) -> None:
        """Nothing comes any more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self.listener()

    @property
    def ended(self) -> bool:
        """Whether it is closed and all is taken."""
        with self._changed:
            return self._closed and not self._waiting

    def take(self, timeout: float | None = 0.0) -> Agreed | None:
        """The one that has waited for longest, waiting up to `timeout` seconds (None: for ever); None: nothing came, or closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closed, timeout)
            return self._waiting.pop(next(iter(self._waiting))) if self._waiting else None
