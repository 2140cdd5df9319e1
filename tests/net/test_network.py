"""What services rely on, asked of a real Zenoh router and of the in-process bus alike."""

from collections.abc import Callable

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.errors import Refused
from blackboard.net.bus import Bus, Delivery, intersects
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.raw import MAX_BYTES
from tests.processes import LONG, AnyLink, Letters, introduce, wait_until

Connect = Callable[[str], AnyLink]


@pytest.fixture(params=["router", "bus"])
def connect(request: pytest.FixtureRequest) -> Connect:
    """Makes a link of a given name, over a router of this test or a bus of this test."""
    if request.param == "bus":
        bus = Bus()
        return lambda name: bus.connect()
    over_router: Connect = request.getfixturevalue("connect")  # the fixture that this one hides
    return over_router


def answers(link: AnyLink, key_expr: str, *wanted: Envelope) -> None:
    wait_until(lambda: link.get(key_expr) == list(wanted), f"{key_expr} is answered by {wanted}")


def put(*keys: str) -> list[Envelope]:
    return [Envelope(key, key.encode()) for key in keys]


def alive(key: str) -> Envelope:
    return Envelope(key, kind=Kind.ALIVE)


def gone(key: str) -> Envelope:
    return Envelope(key, kind=Kind.GONE)


# --- put and delete ------------------------------------------------------------------------------------------------------


def test_what_is_sent_arrives_in_order_and_never_at_the_sender(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    for link in (a, b):
        link.subscribe("x/**")
    introduce(b, a)
    introduce(a, b)
    sent = [Envelope("x/1", b"one"), Envelope("x/2", b""), Envelope("x/1", kind=Kind.DELETE), Envelope("x/1", b"two")]
    for envelope in sent:
        a.send(envelope)
    assert Letters(b).until(*sent) == sent
    b.send(Envelope("x/3", b"last"))
    assert Letters(a).until(Envelope("x/3", b"last")) == [Envelope("x/3", b"last")]
    liveliness = 1  # of the introduction
    assert a.counters == {"sent": 4, "received": liveliness + 1, "dropped": 0, "bytes": 4}
    assert b.counters == {"sent": 1, "received": liveliness + 4, "dropped": 0, "bytes": 6}


KEYS = ("a", "a/b", "a/b/c", "a/c", "b", "b/c", "a/@b/c")


@pytest.mark.parametrize(
    ("key_expr", "included"),
    [
        ("a/**", ("a", "a/b", "a/b/c", "a/c")),
        ("**", ("a", "a/b", "a/b/c", "a/c", "b", "b/c")),
        ("*", ("a", "b")),
        ("a/*", ("a/b", "a/c")),
        ("*/c", ("a/c", "b/c")),
        ("**/c", ("a/b/c", "a/c", "b/c")),
        ("a/**/b/**/c", ("a/b/c",)),
        ("a/@b/*", ("a/@b/c",)),
    ],
)
def test_two_stars_are_any_number_of_chunks_and_one_star_is_one(
    connect: Connect, key_expr: str, included: tuple[str, ...]
) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe(key_expr)
    introduce(b, a)
    for envelope in put(*KEYS, included[-1]):  # what is included comes again at the end: then nothing can follow
        a.send(envelope)
    letters, expected = Letters(b), put(*included, included[-1])
    wait_until(lambda: len(letters.take()) >= len(expected), lambda: f"{len(expected)} arrive, not {letters.read}")
    assert letters.read == expected


def test_each_subscription_delivers_in_the_order_of_sending(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe("x/**")
    b.subscribe("x/1")
    introduce(b, a)
    for envelope in put("x/1", "x/2"):
        a.send(envelope)
    letters = Letters(b)
    wait_until(lambda: len(letters.take()) >= 3, lambda: f"three arrive, not {letters.read}")
    assert sorted(e.key for e in letters.read) == ["x/1", "x/1", "x/2"]
    assert letters.read.index(*put("x/1")) < letters.read.index(*put("x/2"))


@pytest.mark.parametrize("size", [MAX_BYTES, MAX_BYTES + 1, 8 * MAX_BYTES])
def test_of_what_is_too_large_only_that_it_is_too_large_arrives(connect: Connect, size: int) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe("x")
    introduce(b, a)
    a.send(Envelope("x", b"\xff" * size))
    envelopes: list[Envelope] = []
    wait_until(lambda: envelopes or envelopes.extend(b.receive(0.1)), "it arrives")
    assert len(envelopes[0].payload) == min(size, MAX_BYTES + 1)
    assert b.counters["bytes"] == size
    wait_until(lambda: [len(e.payload) for e in b.get("x")] == [min(size, MAX_BYTES + 1)], "it is answered as such")


def test_a_publication_on_a_wild_key_is_refused_by_its_key(connect: Connect) -> None:
    a, b = connect("a"), connect("b")
    b.subscribe("cop/t/a/report/**")
    introduce(b, a)
    a.send(Envelope("cop/t/a/report/**", b"for everybody"))
    (letter,) = Letters(b).until(Envelope("cop/t/a/report/**", b"for everybody"))
    with pytest.raises(Refused, match="wild-key"):
        open_envelope(letter)


def test_liveliness_is_not_sent(connect: Connect) -> None:
    with pytest.raises(ValueError, match="hold a token"):
        connect("a").send(Envelope("x", kind=Kind.ALIVE))


# --- queries -------------------------------------------------------------------------------------------------------------


def test_the_newest_of_each_key_is_answered_once(connect: Connect) -> None:
    a, b, asking = connect("a"), connect("b"), connect("asking")
    r1, r2 = "cop/t/a/report/r1/robot/r1", "cop/t/a/report/r1/object/ball"
    mine = "cop/t/a/consensus/robot/r1"
    for key in (r1, r2, "cop/t/a/status/r1"):
        for payload in (b"old", b"new"):
            a.send(Envelope(key, payload))
    b.send(Envelope(mine, b"agreed"))
    answers(asking, "cop/t/a/report/**", Envelope(r2, b"new"), Envelope(r1, b"new"))
    answers(asking, r1, Envelope(r1, b"new"))
    answers(a, r1, Envelope(r1, b"new"))  # the sender itself may ask, too
    answers(asking, "cop/*/*/*/robot/r1", Envelope(mine, b"agreed"))
    answers(asking, "cop/**", *(Envelope(k, b"agreed" if k == mine else b"new") for k in sorted((r1, r2, mine, "cop/t/a/status/r1"))))  # fmt: skip
    a.send(Envelope(r1, kind=Kind.DELETE))
    answers(asking, "cop/t/a/report/**", Envelope(r2, b"new"))
    a.close()
    answers(asking, "cop/t/a/report/**")


def test_two_who_answer_for_one_key_are_both_heard(connect: Connect) -> None:
    for name in ("a", "b"):
        connect(name).send(Envelope("x", name.encode()))
    asking = connect("asking")
    wait_until(lambda: {e.payload for e in asking.get("x")} == {b"a", b"b"}, "both answer")


def test_nobody_answers_for_what_nobody_sent(connect: Connect) -> None:
    assert connect("a").get("x/**", timeout=LONG) == []


# --- liveliness ----------------------------------------------------------------------------------------------------------


def test_tokens_are_told_those_already_there_too_and_closing_twice_is_closing_once(connect: Connect) -> None:
    a, watching, b = connect("a"), connect("watching"), connect("b")
    a.token("t/1")
    watching.token("t/own")
    watching.watch("t/**")
    letters = Letters(watching)
    letters.until(alive("t/1"), alive("t/own"))
    b.token("t/2")
    letters.until(alive("t/2"))
    b.close()
    letters.until(gone("t/2"))
    a.close()
    a.close()
    letters.until(gone("t/1"))
    assert len(letters.read) == 5


def test_a_token_is_alive_from_its_first_holder_to_its_last(connect: Connect) -> None:
    first, second, watching = connect("first"), connect("second"), connect("watching")
    letters = Letters(watching)
    watching.watch("t/**")
    first.token("t/1")
    letters.until(alive("t/1"))
    second.token("t/1")
    second.token("t/2")
    letters.until(alive("t/2"))
    first.token("t/3")
    letters.until(alive("t/3"))
    first.close()
    letters.until(gone("t/3"))
    second.close()
    letters.until(gone("t/1"), gone("t/2"))
    assert letters.read[:4] == [alive("t/1"), alive("t/2"), alive("t/3"), gone("t/3")]
    assert len(letters.read) == 6


# --- the bus alone -------------------------------------------------------------------------------------------------------

CHUNKS = st.lists(st.sampled_from(["a", "b", "*", "**", "@a"]), min_size=1, max_size=6)


@settings(max_examples=400)
@given(CHUNKS, CHUNKS)
def test_key_expressions_intersect_as_zenoh_says(first: list[str], second: list[str]) -> None:
    exprs = [zenoh.KeyExpr.autocanonize("/".join(chunks)) for chunks in (first, second)]
    assert intersects(str(exprs[0]), str(exprs[1])) == exprs[0].intersects(exprs[1])


def test_what_is_on_its_way_can_be_watched_lost_and_taken_in_any_order() -> None:
    bus = Bus()
    a, b = bus.connect(), bus.connect()
    b.subscribe("**")
    envelopes: list[Envelope] = []
    bus.spies.append(envelopes.append)
    bus.lose = lambda envelope: envelope.key == "lost"
    sent = put("1", "lost", "2")
    for envelope in sent:
        a.send(envelope)
    assert envelopes == sent
    assert bus.waiting.pop() == Delivery(b, put("2")[0], a)
    assert b.receive() == put("1")
    a.send(put("3")[0])
    b.close()
    assert bus.waiting == []
