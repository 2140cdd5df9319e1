"""The page's server in a thread, as the tests of a browser and the pictures need it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from blackboard.view.feed import Source
from blackboard.view.web.server import Address, serve


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
