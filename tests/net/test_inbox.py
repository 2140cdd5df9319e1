"""The inbox is bounded, in order, and never loses a word about liveliness."""

from __future__ import annotations

import threading

from hypothesis import given
from hypothesis import strategies as st

from blackboard.net.inbox import Inbox
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
    found: list[Envelope] = []
    while batch := inbox.drain(0.0):
        assert len(batch) <= inbox.batch
        found += batch
    return found


@given(LETTERS, st.integers(1, 10), st.integers(0, 100))
def test_what_is_kept_is_the_newest_in_order_and_all_liveliness(
    letters: list[tuple[Kind, int]], most: int, most_bytes: int
) -> None:
    inbox = Inbox(most, most_bytes, batch=3)
    put = fill(inbox, letters)
    kept = drain(inbox)
    samples = [e for e in kept if e.kind in (Kind.PUT, Kind.DELETE)]
    sent = [e for e in put if e.kind in (Kind.PUT, Kind.DELETE)]
    assert kept == [e for e in put if e in kept]
    assert samples == sent[len(sent) - len(samples) :]
    assert [e for e in kept if e not in samples] == [e for e in put if e not in sent]
    assert len(samples) <= most
    assert sum(len(e.payload) for e in samples) <= most_bytes
    assert inbox.dropped == len(sent) - len(samples)
    assert inbox.received == len(put)


@given(LETTERS)
def test_nothing_is_dropped_within_the_bounds(letters: list[tuple[Kind, int]]) -> None:
    inbox = Inbox(most=60, most_bytes=60 * 20)
    put = fill(inbox, letters)
    assert drain(inbox) == put
    assert inbox.dropped == 0


def test_it_waits_for_the_first_and_says_when_nothing_came() -> None:
    inbox = Inbox()
    assert inbox.drain(0.01) == []
    later = threading.Timer(0.02, inbox.put, (Envelope("a"), 0))
    later.start()
    assert inbox.drain(30.0) == [Envelope("a")]
    later.join()
