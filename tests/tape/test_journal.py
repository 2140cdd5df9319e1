"""The journal of a board: what it was given, in order, ahead of what it made of it."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.service import Quiet
from blackboard.tape.journal import TOO_LARGE, Journaled, digest, lives
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_JOURNAL_NAME, Journal
from blackboard.wire.raw import MAX_BYTES
from blackboard.wire.types import MAX_OPINIONS


class Echo(Quiet):
    """A service that answers every third message."""

    tokens, listens, watches = ("token",), ("listen",), ("watch",)

    def __init__(self) -> None:
        self.received: list[tuple[str, float]] = []
        self.counters: dict[str, int] = {}

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        self.received.append((envelope.key, now))
        return [Envelope("answer")] if len(self.received) % 3 == 0 else []

    def wake(self, now: float) -> list[Envelope]:
        return [Envelope("woken")]

    def wake_at(self, now: float) -> float | None:
        return now + 1.0

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.counters = counters


def journaled() -> tuple[Echo, Journaled]:
    echo = Echo()
    return echo, Journaled(echo, team="t", sub_team="a", board="a1")


def journals(out: list[Envelope]) -> list[Journal]:
    return [decode(Journal, envelope.payload) for envelope in out if envelope.key == "cop/t/a/journal/a1"]


def test_it_is_the_service_with_a_journal_ahead_of_what_it_sends() -> None:
    echo, service = journaled()
    assert (service.tokens, service.listens, service.watches, service.done) == (
        ("token",),
        ("listen",),
        ("watch",),
        False,
    )
    assert service.wake_at(1.0) == 2.0
    service.record_link_counters({"sent": 1})
    assert echo.counters == {"sent": 1}
    assert service.receive(Envelope("k", b"1"), 10.0) == []
    assert service.receive(Envelope("token", kind=Kind.ALIVE), 10.5) == []
    journal, answer = service.receive(Envelope("k", b"2"), 11.0)
    assert answer.key == "answer"
    (piece,) = journals([journal])
    assert (piece.began, piece.first) == (10.0, 0)
    assert piece.events == [
        (10.0, "put", digest(Envelope("k", b"1"))), (10.5, "alive", "token"), (11.0, "put", digest(Envelope("k", b"2"))),
    ]  # fmt: skip
    (woken,) = journals(service.wake(12.0))
    assert (woken.began, woken.first, woken.events) == (10.0, 3, [(12.0, "wake", "")])


def test_a_journal_is_sent_once_it_is_full_and_its_names_are_bounded() -> None:
    _, service = journaled()
    service.inner.receive = lambda envelope, now: []  # type: ignore[method-assign]
    out = [service.receive(Envelope("k" * 9999, kind=Kind.GONE), 1.0) for _ in range(MAX_OPINIONS)]
    assert [len(each) for each in out] == [0] * (MAX_OPINIONS - 1) + [1]
    (piece,) = journals(out[-1])
    assert {name for _, _, name in piece.events} == {"k" * MAX_JOURNAL_NAME}
    assert digest(Envelope("k", bytes(MAX_BYTES + 1))) == TOO_LARGE


@given(order=st.permutations(range(5)), lost=st.sets(st.integers(0, 4), max_size=2))
def test_lives_are_put_together_in_any_order_and_gaps_are_told(order: list[int], lost: set[int]) -> None:
    whole = [
        Journal(
            board="b", sub_team="a", began=1.0, first=2 * k, events=[(2.0 * k, "wake", ""), (2.0 * k + 1, "wake", "")]
        )
        for k in range(5)
    ]
    other = Journal(board="b", sub_team="a", began=0.5, first=0, events=[(0.5, "wake", "")])
    kept = [whole[k] for k in order if k not in lost]
    first, second = lives([*kept, other, *kept[:1]])
    assert (first.began, first.events) == (0.5, [(0.5, "wake", "")])
    there = sorted(set(range(5)) - lost)
    assert second.first == 2 * there[0]
    assert [at for at, _, _ in second.events] == [x for k in there for x in (2.0 * k, 2.0 * k + 1)]
    assert second.gaps == [2.0 * k for before, k in pairwise(there) if k != before + 1]
