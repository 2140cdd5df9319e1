"""The interface between a service and the loop that runs it (`blackboard.process.loop`), and how a service is connected."""

from typing import Protocol, runtime_checkable

from blackboard.wire.envelope import Envelope


class Subscriber(Protocol):
    """The part of a link by which a service is connected."""

    def subscribe(self, key_expr: str) -> None: ...

    def watch(self, key_expr: str) -> None: ...

    def token(self, key: str) -> None: ...


class Service(Protocol):
    """What the loop needs of a process: envelopes in, envelopes out.

    `now` is Unix time in seconds, as `blackboard.process.loop` reads it; nothing behind this interface reads a clock or a socket.
    """

    @property
    def tokens(self) -> tuple[str, ...]:
        """Liveliness tokens to hold while it runs."""

    @property
    def listens(self) -> tuple[str, ...]:
        """Key expressions to subscribe to."""

    @property
    def watches(self) -> tuple[str, ...]:
        """Key expressions of the liveliness tokens whose changes are delivered, those already held first."""

    @property
    def done(self) -> bool:
        """True once there is nothing left to do: the loop ends."""

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        """Take one envelope; return those to send."""

    def wake(self, now: float) -> list[Envelope]:
        """Time has passed; return what is due."""

    def wake_at(self, now: float) -> float | None:
        """When `wake` is next due, or None while only envelopes matter."""

    def record_link_counters(self, counters: dict[str, int]) -> None:
        """The link's counters (sent, received, dropped, bytes), for the status."""


@runtime_checkable
class Checked(Protocol):
    """A machine that knows its invariants."""

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""


class Quiet:
    """A service that asks for nothing and has nothing to say, but for what a subclass does."""

    tokens: tuple[str, ...] = ()
    listens: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    done = False

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        return []

    def wake(self, now: float) -> list[Envelope]:
        return []

    def wake_at(self, now: float) -> float | None:
        return None

    def record_link_counters(self, counters: dict[str, int]) -> None:
        pass


class Around:
    """A service around another one: what a subclass does not override is done by the inner one."""

    def __init__(self, inner: Service) -> None:
        self.inner = inner

    @property
    def tokens(self) -> tuple[str, ...]:
        return self.inner.tokens

    @property
    def listens(self) -> tuple[str, ...]:
        return self.inner.listens

    @property
    def watches(self) -> tuple[str, ...]:
        return self.inner.watches

    @property
    def done(self) -> bool:
        return self.inner.done

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        return self.inner.receive(envelope, now)

    def wake(self, now: float) -> list[Envelope]:
        return self.inner.wake(now)

    def wake_at(self, now: float) -> float | None:
        return self.inner.wake_at(now)

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.inner.record_link_counters(counters)

    def check(self) -> None:
        if isinstance(self.inner, Checked):
            self.inner.check()


def connect(service: Service, link: Subscriber) -> None:
    """Watch, subscribe and hold tokens as a service asks.

    Tokens are watched before any topic is subscribed to, so that the roster has the senders of the first messages. Own tokens are
    declared last: whoever sees one may send to this process at once.
    """
    for key_expr in service.watches:
        link.watch(key_expr)
    for key_expr in service.listens:
        link.subscribe(key_expr)
    for key in service.tokens:
        link.token(key)
