"""Services in virtual time: when each is woken, what is late, lost or doubled on its way, who is stopped, whose clock is off."""

import math

import numpy as np
import pytest

from blackboard.errors import RunFailed
from blackboard.net.scheduler import AT_ONCE, BEGIN, LATER, Scheduler
from blackboard.process.service import Quiet, Service
from blackboard.wire.envelope import Envelope, Kind


class Clerk(Quiet):
    """A service that notes what comes when, by its own clock, and sends a letter every second from `first` on."""

    listens, watches = ("letter/*",), ("token/*",)

    def __init__(self, name: str, first: float = math.inf) -> None:
        self.name, self.due = name, first
        self.came: list[tuple[float, str]] = []  # when, and on which key or which token
        self.counters: dict[str, int] = {}
        self.sane = True

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self.came.append((round(now - BEGIN, 3), envelope.payload.decode() or envelope.kind.value))
        return []

    def wake(self, now: float) -> list[Envelope]:
        self.due += 1.0
        return [Envelope(f"letter/{self.name}", f"{self.name}{self.due - 1.0 - BEGIN:.0f}".encode())]

    def wake_at(self, now: float) -> float | None:
        return None if self.due == math.inf else self.due

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.counters = counters

    def check(self) -> None:
        assert self.sane, self.name


class Holder(Clerk):
    """One with a token."""

    tokens = ("token/x",)


def two() -> tuple[Scheduler, Clerk, Clerk]:
    """One that writes each second, and one that reads."""
    running, writer, reader = Scheduler(), Clerk("w", BEGIN), Clerk("r")
    running.join(writer)
    running.join(reader)
    return running, writer, reader


def test_each_is_woken_when_it_is_due_and_time_stops_at_the_end() -> None:
    running, writer, reader = two()
    running.run_for(2.5)
    assert reader.came == [(0.0, "w0"), (1.0, "w1"), (2.0, "w2")]
    assert writer.came == []  # nobody hears itself
    assert running.now == BEGIN + 2.5
    assert writer.counters["sent"] == 2  # as it was before it was woken last
    assert running.services == (writer, reader)


def test_a_fact_ends_a_run_at_once_and_one_that_never_holds_ends_in_an_error() -> None:
    running, _, reader = two()
    running.run_until(lambda: len(reader.came) == 2)
    assert running.now == pytest.approx(BEGIN + 1.0, abs=3 * LATER)
    with pytest.raises(RunFailed, match="has not ended"):
        running.run_until(lambda: False, 10.0)
    assert len(reader.came) == 2 + 10


def test_nobody_left_to_wake_is_no_endless_loop() -> None:
    running = Scheduler()
    running.run_for(3.0)
    assert running.now == BEGIN + 3.0
    with pytest.raises(RunFailed):
        running.run_until(lambda: False, math.inf)


@pytest.mark.parametrize(
    ("delays", "came"),
    [
        ((), []),
        (AT_ONCE, [(0.0, "w0"), (1.0, "w1")]),
        ((1.5,), [(1.5, "w0"), (2.5, "w1")]),
        ((0.0, 1.25), [(0.0, "w0"), (1.0, "w1"), (1.25, "w0"), (2.25, "w1")]),
    ],
)
def test_a_route_drops_delays_and_doubles(delays: tuple[float, ...], came: list[tuple[float, str]]) -> None:
    running, writer, reader = two()
    asked: list[tuple[Service | None, Service]] = []

    def route(sender: Service | None, receiver: Service, envelope: Envelope) -> tuple[float, ...]:
        asked.append((sender, receiver))
        return delays if envelope.payload in (b"w0", b"w1") else ()

    running.route = route
    running.run_for(3.5)
    assert reader.came == came
    assert asked == [(writer, reader)] * 4


def test_tokens_go_by_the_route_too_and_come_from_nobody() -> None:
    running, _, reader = two()
    running.route = lambda sender, receiver, envelope: (2.0,) if sender is None else ()
    holder = Holder("h")
    running.join(holder)
    running.leave(holder)
    running.run_for(3.0)
    assert reader.came == [(2.0, Kind.ALIVE.value), (2.0, Kind.GONE.value)]


def test_what_is_on_its_way_to_one_that_leaves_is_lost_also_where_another_joins() -> None:
    running, _, reader = two()
    running.route = lambda sender, receiver, envelope: (0.5,)
    running.run_for(1.2)
    running.leave(reader)
    again = Clerk("r")
    running.join(again)
    running.run_for(1.0)
    assert reader.came == [(0.5, "w0")]
    assert again.came == []  # what was sent at 1 was for the first one
    with pytest.raises(KeyError):
        running.leave(reader)


def test_a_frozen_service_holds_its_token_and_gets_all_that_came_when_it_thaws() -> None:
    running, _, reader = two()
    holder = Holder("h", BEGIN + 0.5)
    running.join(holder)
    running.run_for(0.1)
    running.freeze(holder)
    running.run_for(2.0)
    assert holder.came == [(0.0, "alive"), (0.0, "w0")]
    assert not [what for _, what in reader.came if what.startswith("h")]
    running.thaw(holder)
    assert holder.came[2:] == [(2.1, "w1"), (2.1, "w2")]
    running.run_for(0.1)
    assert [what for _, what in reader.came][-2:] == ["h0", "h2"]  # of 0.5 and 1.5: it is late, and due again at once
    assert ("alive", *{"gone"} - {what for _, what in reader.came}) == ("alive", "gone")


def test_a_clock_that_is_ahead_counts_for_all_that_a_service_does() -> None:
    running, reader = Scheduler(), Clerk("r")
    writer = Clerk("w", BEGIN + 5.0)
    running.join(writer, ahead=4.0)
    running.join(reader, ahead=-1.0)
    running.run_for(1.5)
    assert reader.came == [(0.0, "w5")]
    running.set_clock(writer, 0.0)
    running.run_for(3.0)
    assert reader.came == [(0.0, "w5")]  # its next letter is due at 6 by its own clock
    running.set_clock(reader, 10.0)
    running.run_for(2.0)
    assert reader.came[1:] == [(16.0, "w6")]


def test_letters_of_the_same_instant_arrive_in_an_order_that_is_drawn() -> None:
    orders = set()
    for seed in range(6):
        running, reader = Scheduler(shuffle=np.random.default_rng(seed)), Clerk("r")
        running.join(reader)
        for n in range(4):
            running.bus.send(Envelope("letter/x", str(n).encode()))
        running.run_for(0.0)
        orders.add(tuple(what for _, what in reader.came))
    assert all(sorted(order) == ["0", "1", "2", "3"] for order in orders)
    assert len(orders) > 2


@pytest.mark.parametrize("begin", [-1e12, 0.0, 1e15])
def test_time_moves_however_often_a_service_is_due(begin: float) -> None:
    class Eager(Clerk):
        def wake(self, now: float) -> list[Envelope]:
            self.due = now
            return []

    running = Scheduler(begin)
    running.join(Eager("e", begin))
    for _ in range(5):
        before = running.now
        assert running.step(begin + 1.0)
        assert running.now > before


def test_a_run_ends_with_the_invariants_of_all_that_know_theirs() -> None:
    running, _, reader = two()
    running.run_for(0.1)
    reader.sane = False
    with pytest.raises(AssertionError, match="r"):
        running.run_for(0.1)
    with pytest.raises(AssertionError, match="r"):
        running.run_until(lambda: True)
    running.leave(reader)
    running.run_for(0.1)
