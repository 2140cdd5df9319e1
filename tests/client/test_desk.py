"""Calls from another thread into the team's: each has its own result, however late it comes."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from blackboard.client import desk as module
from blackboard.client.desk import Desk
from blackboard.process.service import Quiet
from blackboard.wire.envelope import Envelope

CALLS = 200


@contextmanager
def answering(desk: Desk) -> Iterator[None]:
    """A thread that makes the calls, until this is left."""
    poked, left = threading.Event(), threading.Event()
    desk.poke = poked.set

    def loop() -> None:
        while not left.is_set():
            poked.wait()
            poked.clear()
            desk.wake(0.0)

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield
    finally:
        left.set()
        poked.set()
        thread.join()


def test_a_result_that_comes_while_the_caller_looks_whether_the_team_is_closed_is_no_timeout(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "LOOK", 0.0)  # it looks all the time
    desk = Desk(Quiet())
    with answering(desk):
        assert [desk.call(lambda now, i=i: (i, [])) for i in range(CALLS)] == list(range(CALLS))  # type: ignore[misc]


def test_a_call_raises_what_it_raised() -> None:
    def late(now: float) -> tuple[None, list[Envelope]]:
        raise TimeoutError(f"at {now:g}")

    desk = Desk(Quiet())
    with answering(desk), pytest.raises(TimeoutError, match="at 0"):
        desk.call(late)


def test_a_call_of_a_closed_team_says_so() -> None:
    desk = Desk(Quiet())
    desk.stop.set()
    with pytest.raises(RuntimeError, match="the team is closed"):
        desk.call(lambda now: (now, []))
