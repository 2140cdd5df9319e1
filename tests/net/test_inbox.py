"""The inbox is bounded, in order, fair, and never loses the newest state of a token."""

import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.net.inbox import CHANGES, STRANGERS_BATCH, Inbox
from blackboard.wire.envelope import Envelope, Kind

KINDS = st.sampled_from(Kind)
LETTERS = st.lists(st.tuples(KINDS, st.integers(0, 20)), max_size=60)


def fill(inbox: Inbox, letters: list[tuple[Kind, int]]) -> list[Envelope]:
    """Put envelopes numbered in their keys; liveliness has no payload."""
    put = []
    for i, (kind, size) in enumerate(letters):
        payload = bytes(size) if kind in (Kind.PUT, Kind.DELETE) else b""
        put.append(Envelope(str(i), payload, kind))
        inbox.put(put[-1], size)
    return put


def drain(inbox: Inbox) -> list[Envelope]:
    envelopes: list[Envelope] = []
    while batch := inbox.drain(0.0):
        assert len(batch) <= inbox.batch
        envelopes += batch
    return envelopes


@given(LETTERS, st.integers(1, 10), st.integers(0, 100))
def test_what_is_kept_is_the_newest_in_order_and_all_liveliness(
    letters: list[tuple[Kind, int]], most: int, most_bytes: int
) -> None:
    inbox = Inbox(most, most_bytes, batch=3)
    put = fill(inbox, letters)
    kept = drain(inbox)
    samples = [e for e in kept if e.kind in (Kind.PUT, Kind.DELETE)]
    sent = [e for e in put if e.kind in (Kind.PUT, Kind.DELETE)]
    assert samples == sent[len(sent) - len(samples) :]
    assert [e for e in kept if e not in samples] == [e for e in put if e not in sent]
    assert len(samples) <= most
    assert sum(len(e.payload) for e in samples) <= most_bytes
    assert inbox.dropped == len(sent) - len(samples)
    assert inbox.received == len(put)


def member(name: str, kind: Kind = Kind.ALIVE) -> Envelope:
    return Envelope(f"cop/t/a/member/{name}", kind=kind)


def said(name: str, i: int, subject: str = "robot/x") -> Envelope:
    return Envelope(f"cop/t/a/report/{name}/{subject}", bytes([i % 256]))


def test_a_stranger_displaces_nobody_and_is_read_last() -> None:
    inbox = Inbox(most=100, quota=50)
    inbox.put(member("r1"), 0)
    for i in range(40):
        inbox.put(said("r1", i), 1)
        for j in range(100):
            inbox.put(said(f"x{j}", i), 1)
    assert drain(inbox)[:41] == [member("r1"), *(said("r1", i) for i in range(40))]


def test_of_strangers_what_comes_last_is_turned_away_before_it_is_read() -> None:
    inbox = Inbox(quota=3)
    inbox.put(member("r1"), 0)
    for i in range(5):
        inbox.put(said("x", i), 1)
    assert inbox.turns_away(said("x", 9).key, 1000)
    assert not inbox.turns_away(said("r1", 1).key, 1)
    inbox.put(said("r1", 1), 1)
    assert drain(inbox) == [member("r1"), said("r1", 1), *(said("x", i) for i in range(3))]
    assert (inbox.strangers, inbox.dropped, inbox.received, inbox.bytes_received) == (6, 3, 8, 1006)
    assert not inbox.turns_away(said("x", 9).key, 1)


def test_while_strangers_flood_others_are_waited_for_first() -> None:
    inbox = Inbox(pause=30.0)
    inbox.put(member("r1"), 0)
    assert inbox.drain(0.0) == [member("r1")]
    for i in range(10 * STRANGERS_BATCH):
        inbox.put(said("x", i), 1)
    later = threading.Timer(0.02, inbox.put, (said("r1", 1), 1))
    later.start()
    assert inbox.drain(30.0) == [said("r1", 1), said("x", 0)]
    later.join()
    assert len(inbox.drain(0.0)) == STRANGERS_BATCH


def test_a_member_that_floods_loses_its_own_and_the_oldest_of_the_key_that_it_floods() -> None:
    inbox = Inbox(quota=10)
    for name in ("r1", "r2"):
        inbox.put(member(name), 0)
    inbox.put(said("r1", 0), 1)
    inbox.put(said("r2", 7, "object/ball"), 1)
    for i in range(100):
        inbox.put(said("r2", i), 1)
    kept = drain(inbox)[2:]
    assert kept == [said("r1", 0), said("r2", 7, "object/ball"), *(said("r2", i) for i in range(91, 100))]
    assert inbox.dropped == 91


def test_where_all_are_too_many_the_greediest_gives_way() -> None:
    inbox = Inbox(most=20, quota=20)
    for name in ("r1", "r2"):
        inbox.put(member(name), 0)
    for i in range(19):
        inbox.put(said("r2", i), 1)
    for i in range(8):
        inbox.put(said("r1", i), 1)
    kept = [e for e in drain(inbox) if e.kind is Kind.PUT]
    assert [e for e in kept if "/r1/" in e.key] == [said("r1", i) for i in range(8)]
    assert len(kept) == 20


def test_who_shows_its_token_late_keeps_the_order_of_what_it_said() -> None:
    inbox = Inbox()
    for i in range(3):
        inbox.put(said("r1", i), 1)
    inbox.put(member("r1"), 0)
    inbox.put(said("r1", 3), 1)
    assert [e for e in drain(inbox) if e.kind is Kind.PUT] == [said("r1", i) for i in range(4)]


def test_a_token_that_flickers_takes_no_room_and_its_last_state_is_kept() -> None:
    inbox = Inbox()
    inbox.put(said("r2", 1), 1)
    for _ in range(1000):
        inbox.put(member("r1"), 0)
        inbox.put(member("r1", Kind.GONE), 0)
    kinds = [e.kind for e in drain(inbox) if e.key.endswith("member/r1")]
    assert kinds == [Kind.ALIVE, Kind.GONE] * (len(kinds) // 2)
    assert 2 <= len(kinds) <= CHANGES


def test_more_tokens_than_are_known_are_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blackboard.net.inbox.MAX_TOKENS", 3)
    inbox = Inbox()
    for i in range(5):
        inbox.put(member(f"r{i}"), 0)
    assert (len(drain(inbox)), inbox.dropped) == (3, 2)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 9)), max_size=120), st.integers(0, 40))
def test_its_bounds_hold_and_what_is_counted_adds_up(steps: list[tuple[int, int, int]], drained: int) -> None:
    """Tokens that come and go, and members and strangers that send, in any order."""
    inbox = Inbox(most=12, most_bytes=60, batch=5, quota=6, quota_bytes=30)
    taken = 0
    for step, (who, what, size) in enumerate(steps):
        if what == 0:
            inbox.put(member(f"r{who}", Kind.ALIVE if size % 2 else Kind.GONE), 0)
        else:
            inbox.put(Envelope(f"cop/t/a/report/r{who}/robot/x{what}", bytes(size)), size)
        if step == drained:
            taken = len(inbox.drain(0.0))
    rest = drain(inbox)
    assert taken + len(rest) + inbox.dropped == inbox.received
    samples = [e for e in rest if e.kind is Kind.PUT]
    assert len(samples) <= 12
    assert sum(len(e.payload) for e in samples) <= 60
    dropped = inbox.dropped
    again = [
        *([member("r9"), member("r9", Kind.GONE)] * (CHANGES // 2)),
        *(Envelope(f"x/{i}", bytes(5)) for i in range(6)),
    ]
    for envelope in again:
        inbox.put(envelope, len(envelope.payload))
    assert drain(inbox) == again, "once it is empty it has room for as much as a new one"
    assert inbox.dropped == dropped


@given(LETTERS)
def test_nothing_is_dropped_within_the_bounds(letters: list[tuple[Kind, int]]) -> None:
    inbox = Inbox(most=60, most_bytes=60 * 20)
    put = fill(inbox, letters)
    samples = [e for e in put if e.kind in (Kind.PUT, Kind.DELETE)]
    assert drain(inbox) == [e for e in put if e not in samples] + samples
    assert inbox.dropped == 0


def test_it_waits_for_the_first_and_says_when_nothing_came() -> None:
    inbox = Inbox()
    assert inbox.drain(0.01) == []
    later = threading.Timer(0.02, inbox.put, (Envelope("a"), 0))
    later.start()
    assert inbox.drain(30.0) == [Envelope("a")]
    later.join()


def test_who_is_poked_does_not_wait_and_waits_again() -> None:
    inbox = Inbox()
    inbox.poke()
    assert inbox.drain(1e6) == []  # it would wait for days
    assert inbox.drain(0.0) == []
    inbox.poke()
    assert inbox.drain(1e6) == []
