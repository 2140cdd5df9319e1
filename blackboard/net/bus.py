"""Bus: what a Zenoh router does for links, within one thread of one process, for teams that run without a network.

Nothing is delivered by itself: what was sent waits on the bus until a link receives it, or until the owner of the bus takes
it from `waiting`, in any order. tests/net/test_network.py holds the bus and the link to the same behaviour.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from blackboard.net.inbox import TOO_LARGE
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.raw import MAX_BYTES

MAX_KEYS = 1 << 16  # whose receivers are remembered


@lru_cache(1 << 16)
def intersects(one: str, other: str) -> bool:
    """Whether some key is included in both key expressions, by Zenoh's rules; a key is the expression that includes itself.

    `*` stands for one chunk, `**` for any number of them, also none: `a/**` includes `a`. A chunk that begins with `@` is included
    by neither. `$*` is not supported.
    """
    return _intersect(tuple(one.split("/")), tuple(other.split("/")))


def _intersect(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    for at, (mine, its) in enumerate(zip(one, other)):  # noqa: B905 (one may be longer)
        if mine == "**" or its == "**":
            a, b = (one[at:], other[at:]) if mine == "**" else (other[at:], one[at:])
            return _intersect(a[1:], b) or (not b[0].startswith("@") and _intersect(a, b[1:]))
        if mine != its and ("*" not in (mine, its) or mine.startswith("@") or its.startswith("@")):
            return False
    common = min(len(one), len(other))
    return all(chunk == "**" for chunk in one[common:] + other[common:])


class Delivery(NamedTuple):
    """An envelope on its way; `sender` None: from outside, or the liveliness of a token."""

    receiver: BusLink
    envelope: Envelope
    sender: BusLink | None = None


class Bus:
    """The links of one process, and what is on its way between them."""

    def __init__(self) -> None:
        self.links: list[BusLink] = []
        self.waiting: list[Delivery] = []  # in the order of sending
        self.spies: list[Callable[[Envelope], None]] = []  # called with each PUT and DELETE before it is delivered
        self.lose: Callable[[Envelope], bool] = lambda envelope: False  # True for a PUT or DELETE that is to be lost
        self._receivers: dict[str, list[BusLink]] = {}  # of a key, as long as no link comes, goes or subscribes

    def connect(self) -> BusLink:
        self.links.append(BusLink(self))
        self.forget_receivers()
        return self.links[-1]

    def send(self, envelope: Envelope, sender: BusLink | None = None) -> None:
        """Put an envelope on its way, once for each subscription to its key, but to none of the sender's."""
        for spy in self.spies:
            spy(envelope)
        if self.lose(envelope):
            return
        if envelope.key not in self._receivers:
            if len(self._receivers) >= MAX_KEYS:
                self.forget_receivers()
            self._receivers[envelope.key] = [
                link for link in self.links for key_expr in link.subscribed if intersects(key_expr, envelope.key)
            ]
        for link in self._receivers[envelope.key]:
            if link is not sender:
                self.deliver(link, envelope, sender)

    def forget_receivers(self) -> None:
        """Some link has come, gone or subscribed: who receives what is to be found anew."""
        self._receivers = {}

    def clear(self, link: BusLink) -> None:
        """Drop what is on its way to a link."""
        self.waiting = [sent for sent in self.waiting if sent.receiver is not link]

    def holds(self, token: str) -> bool:
        """Whether some link holds a liveliness token."""
        return any(token in link.tokens for link in self.links)

    def announce(self, token: str, kind: Kind) -> None:
        """Deliver the change of a liveliness token to all links that watch it, once for each watch."""
        for link in self.links:
            for key_expr in link.watched:
                if intersects(key_expr, token):
                    self.deliver(link, Envelope(token, kind=kind))

    def deliver(self, link: BusLink, envelope: Envelope, sender: BusLink | None = None) -> None:
        """Put an envelope on its way to one link."""
        link.received += 1
        link.bytes_received += len(envelope.payload)
        if len(envelope.payload) > MAX_BYTES:
            envelope = Envelope(envelope.key, TOO_LARGE, envelope.kind)
        self.waiting.append(Delivery(link, envelope, sender))


class BusLink:
    """A connection to a bus with the interface of `blackboard.net.link.Link`; `receive` and `get` never wait."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.subscribed: list[str] = []  # key expressions
        self.watched: list[str] = []  # key expressions
        self.tokens: list[str] = []
        self.newest: dict[str, bytes] = {}  # key -> payload of the newest PUT, until a DELETE
        self.sent = self.received = self.bytes_received = 0

    @property
    def counters(self) -> dict[str, int]:
        """Envelopes sent, received and dropped here, and bytes of payload received."""
        return {"sent": self.sent, "received": self.received, "dropped": 0, "bytes": self.bytes_received}

    def subscribe(self, key_expr: str) -> None:
        """Deliver what others publish on a key expression; what this link publishes itself is not delivered."""
        self.subscribed.append(key_expr)
        self._bus.forget_receivers()

    def watch(self, key_expr: str) -> None:
        """Deliver the liveliness tokens on a key expression as ALIVE and GONE, those already there first."""
        self.watched.append(key_expr)
        for token in dict.fromkeys(token for link in self._bus.links for token in link.tokens):
            if intersects(key_expr, token):
                self._bus.deliver(self, Envelope(token, kind=Kind.ALIVE))

    def token(self, key: str) -> None:
        """Hold a liveliness token until the link is closed; those who watch it get ALIVE for the first link that holds it."""
        held = self._bus.holds(key)
        self.tokens.append(key)
        if not held:
            self._bus.announce(key, Kind.ALIVE)

    def receive(self, timeout: float = 0.0) -> list[Envelope]:
        """All that is on its way to this link, in the order of sending; the bus does not wait for more."""
        envelopes = [sent.envelope for sent in self._bus.waiting if sent.receiver is self]
        self._bus.clear(self)
        return envelopes

    def send(self, envelope: Envelope) -> None:
        """Publish a PUT or a DELETE, and keep the newest per key for `get`."""
        if envelope.kind is Kind.PUT:
            self.newest[envelope.key] = envelope.payload
        elif envelope.kind is Kind.DELETE:
            self.newest.pop(envelope.key, None)
        else:
            raise ValueError(f"{envelope.key}: liveliness is not sent; hold a token")
        self.sent += 1
        self._bus.send(envelope, self)

    def get(self, key_expr: str, timeout: float = 0.0) -> list[Envelope]:
        """The newest values on a key expression, of every link that has one, sorted by key."""
        envelopes = [
            Envelope(key, payload if len(payload) <= MAX_BYTES else TOO_LARGE)
            for link in self._bus.links
            for key, payload in link.newest.items()
            if intersects(key_expr, key)
        ]
        return sorted(envelopes, key=lambda envelope: envelope.key)

    def close(self) -> None:
        """Leave the bus: its tokens vanish, and what was on its way to it is lost. A second time changes nothing."""
        if self not in self._bus.links:
            return
        self._bus.links.remove(self)
        self._bus.forget_receivers()
        self._bus.clear(self)
        for token in dict.fromkeys(self.tokens):
            if not self._bus.holds(token):
                self._bus.announce(token, Kind.GONE)
