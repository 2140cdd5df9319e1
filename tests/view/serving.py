"""The page's server in a thread, a recorded run for it to tell, and what a browser asks of it."""

import queue
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from blackboard.view.feed import Source
from blackboard.view.web.server import Address, serve
from blackboard.wire.envelope import Envelope
from tests.view.recorded import Deaf, recorded


@contextmanager
def served(source: Source, team: str, now: Callable[[], float] = time.monotonic) -> Iterator[str]:
    """The address of a page of a source, which is stopped behind the block."""
    stop, ready = threading.Event(), queue.Queue[str]()
    arguments = (source, team, now, Address(), stop.is_set, ready.put)
    thread = threading.Thread(target=serve, args=arguments)
    thread.start()
    try:
        yield ready.get(timeout=30)
    finally:
        stop.set()
        thread.join(30)
    assert not thread.is_alive()


class Recording(Deaf):
    """A link that has a run to tell, once."""

    def __init__(self) -> None:
        self._left = [envelope for envelope, _ in recorded()]
        self._empty = threading.Event()

    def receive(self, timeout: float) -> list[Envelope]:
        taken, self._left = self._left, []
        if not taken:
            self._empty.wait(timeout)
        return taken


class Clock:
    """Time that passes by being asked for: a frame is due each time."""

    def __init__(self) -> None:
        self._now = 0.0

    def __call__(self) -> float:
        self._now += 1.0
        return self._now


def get(url: str, **headers: str) -> Any:
    return urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30)


def socket_of(url: str) -> str:
    return url.replace("http", "ws") + "live"
