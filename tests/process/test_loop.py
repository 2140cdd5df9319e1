"""The one loop: what it declares and in which order, when it wakes a service, and when it ends."""

import pytest

from blackboard.process.loop import AFTER_FAILURE, LONGEST_WAIT, run
from blackboard.wire.envelope import Envelope
from tests.clocks import ManualClock


class Post:
    """A network that plays a list of deliveries; waiting moves the clock."""

    def __init__(self, clock: ManualClock, *deliveries: list[Envelope]) -> None:
        self.clock, self.deliveries = clock, list(deliveries)
        self.declared: list[str] = []
        self.waits: list[float] = []
        self.sent: list[Envelope] = []

    @property
    def counters(self) -> dict[str, int]:
        return {"sent": len(self.sent)}

    def subscribe(self, key_expr: str) -> None:
        self.declared.append(f"listen {key_expr}")

    def watch(self, key_expr: str) -> None:
        self.declared.append(f"watch {key_expr}")

    def token(self, key: str) -> None:
        self.declared.append(f"token {key}")

    def receive(self, timeout: float) -> list[Envelope]:
        self.waits.append(timeout)
        if self.deliveries:
            return self.deliveries.pop(0)
        self.clock.advance(timeout)
        return []

    def send(self, envelope: Envelope) -> None:
        self.sent.append(envelope)


class Echo:
    """Answers everything, wakes every `period` seconds, and is done after so many wakes."""

    tokens, listens, watches = ("t",), ("a", "b"), ("w",)

    def __init__(self, period: float | None, wakes: int) -> None:
        self.period, self.wakes = period, wakes
        self.due = period
        self.woken: list[float] = []
        self.noted: dict[str, int] = {}

    @property
    def done(self) -> bool:
        return len(self.woken) >= self.wakes

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        if envelope.key == "bomb":
            raise RuntimeError("ours")
        return [Envelope(f"re/{envelope.key}")]

    def wake(self, now: float) -> list[Envelope]:
        assert self.period is not None
        self.woken.append(now)
        self.due = now + self.period
        return [Envelope("tick")]

    def wake_at(self, now: float) -> float | None:
        return self.due

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.noted = counters


def test_it_knows_who_is_there_then_listens_then_tells_that_it_is_there_and_is_ready() -> None:
    clock = ManualClock()
    post = Post(clock)
    run(Echo(1.0, 0), post, clock, ready=lambda: post.declared.append("ready"))
    assert post.declared == ["watch w", "listen a", "listen b", "token t", "ready"]


def test_it_answers_wakes_in_time_and_ends_when_done() -> None:
    clock = ManualClock()
    post, echo = Post(clock, [Envelope("x"), Envelope("y")], []), Echo(1.2, 2)
    run(echo, post, clock)
    assert [e.key for e in post.sent] == ["re/x", "re/y", "tick", "tick"]
    assert echo.woken == pytest.approx([1.2, 2.4])
    assert max(post.waits) <= LONGEST_WAIT
    assert echo.noted == {"sent": 4}  # the last word, after all was sent


def test_a_flood_of_envelopes_does_not_keep_it_from_waking() -> None:
    clock = ManualClock(10.0)
    post, echo = Post(clock, *[[Envelope("x")]] * 3), Echo(1.0, 1)
    run(echo, post, clock)
    assert [e.key for e in post.sent] == ["re/x", "tick"]
    assert post.waits == [0.0]


def test_it_waits_for_letters_alone_until_it_is_stopped() -> None:
    clock = ManualClock()
    post = Post(clock, [Envelope("x")])
    run(Echo(None, 1), post, clock, stopped=lambda: clock.now() >= 2.0)
    assert [e.key for e in post.sent] == ["re/x"]
    assert set(post.waits) == {LONGEST_WAIT}


def test_what_has_arrived_is_left_where_it_is_stopped() -> None:
    clock = ManualClock()
    post, echo = Post(clock, [Envelope(str(number)) for number in range(1000)]), Echo(None, 1)
    run(echo, post, clock, lambda: len(post.sent) >= 3)
    assert len(post.sent) == 3


def test_a_service_that_only_answers_has_counters_that_are_up_to_date() -> None:
    """Its statuses said that it had sent nothing since it was last woken."""
    clock = ManualClock()
    post, service, counts = Post(clock, [Envelope("x"), Envelope("y")], [Envelope("z")]), Echo(None, 1), list[int]()
    answer = service.receive

    def receive(envelope: Envelope, now: float) -> list[Envelope]:
        counts.append(service.noted["sent"])
        return answer(envelope, now)

    service.receive = receive  # type: ignore[method-assign]
    run(service, post, clock, stopped=lambda: clock.now() >= 2.0)
    assert counts == [0, 0, 2]


def test_what_a_service_raises_does_not_end_it(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock()
    post, echo = Post(clock, [Envelope("bomb"), Envelope("bomb"), Envelope("x")]), Echo(1.0, 1)
    run(echo, post, clock)
    assert [e.key for e in post.sent] == ["re/x", "tick"]
    assert echo.noted == {"sent": 2, "failed_in_loop": 2}
    assert [record.levelname for record in caplog.records] == ["ERROR"]  # once per source and kind
    assert "bomb: RuntimeError: ours" in caplog.records[0].getMessage()


def test_a_service_that_cannot_do_what_is_due_is_woken_again_after_a_while() -> None:
    clock = ManualClock()
    post, echo = Post(clock), Echo(1.0, 2)
    wake, failing = echo.wake, iter([True, True, False, False])
    times: list[float] = []

    def fails(now: float) -> list[Envelope]:
        times.append(now)
        if next(failing):
            raise RuntimeError("ours")
        return wake(now)

    echo.wake = fails  # type: ignore[method-assign]
    run(echo, post, clock)
    assert times == pytest.approx([1.0, 1.0 + AFTER_FAILURE, 1.0 + 2 * AFTER_FAILURE, 2.0 + 2 * AFTER_FAILURE])
    assert echo.noted["failed_in_loop"] == 2


def test_another_process_of_the_same_name_is_logged_once_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock()
    post, echo = Post(clock, *[[Envelope("cop/t/a/status/r1", b"!")]] * 20), Echo(1.0, 15)
    echo.tokens = ("cop/t/a/member/r1",)  # type: ignore[assignment]
    wake = echo.wake

    def slow_wake(now: float) -> list[Envelope]:
        clock.advance(1.0)
        return wake(now)

    echo.wake = slow_wake  # type: ignore[method-assign]
    clock.advance(1.0)
    run(echo, post, clock)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert caplog.records[0].getMessage().startswith("cop/t/a/status/r1: another process sends under this name")
    assert echo.noted["namesakes"] == 1
