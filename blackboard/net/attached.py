"""A link that also speaks to others than the team: with bytes attached to each message, a token for each publisher, and the last
message for who comes late. It is how ROS 2 speaks over Zenoh (`blackboard.bridges.ros`).
"""

from collections.abc import Callable
from typing import Any, Protocol

from zenoh import ext

from blackboard.net.link import Link
from blackboard.wire.envelope import Envelope

HEARTBEAT = 0.5  # seconds in which who listens learns that it missed a message


class Outlet(Protocol):
    """How a key that is none of the team's is published."""

    @property
    def token(self) -> str:
        """The liveliness token of the publisher."""

    def attach(self) -> bytes:
        """The bytes that go with the next message."""


class AttachedLink(Link):
    """A link that publishes in this way where `outlet` has one for the key; everything else goes as in any link."""

    outlet: Callable[[str], Outlet | None] = staticmethod(lambda key: None)

    @property
    def session_id(self) -> str:
        """Zenoh's name of this session, in hexadecimal digits."""
        return str(self._session.info.zid())

    def send(self, envelope: Envelope) -> None:
        """Publish; an envelope on a key with an outlet is a PUT, and its publisher is declared at the first one."""
        outlet = self.outlet(envelope.key)
        if outlet is None:
            super().send(envelope)
            return
        publisher = self._publishers.get(envelope.key)
        if publisher is None:
            publisher = self._publishers[envelope.key] = self._publisher(envelope.key)
            self.token(outlet.token)
        publisher.put(envelope.payload, attachment=outlet.attach())
        self._sent += 1

    def _publisher(self, key: str) -> Any:
        """A publisher whose last message is asked for by who comes late, or missed it."""
        return ext.declare_advanced_publisher(
            self._session,
            key,
            cache=ext.CacheConfig(max_samples=1),
            publisher_detection=True,
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT),
        )


class TwoRouters:
    """Two links as one: the keys of teams go to the first, all others to the second. The second is made `beside` the first."""

    def __init__(self, team: Link, others: AttachedLink) -> None:
        self._team, self._others = team, others

    @property
    def counters(self) -> dict[str, int]:
        """The counters of both links; what their common inbox counts is counted once."""
        return (
            self._others.counters
            | self._team.counters
            | {"sent": self._team.counters["sent"] + self._others.counters["sent"]}
        )

    def subscribe(self, key_expr: str) -> None:
        self._of(key_expr).subscribe(key_expr)

    def watch(self, key_expr: str) -> None:
        self._of(key_expr).watch(key_expr)

    def token(self, key: str) -> None:
        self._of(key).token(key)

    def receive(self, timeout: float) -> list[Envelope]:
        """As `Link.receive`, of both."""
        return self._others.receive(0.0) + self._team.receive(timeout)

    def send(self, envelope: Envelope) -> None:
        self._of(envelope.key).send(envelope)

    def _of(self, key: str) -> Link:
        return self._team if key.startswith("cop/") else self._others
