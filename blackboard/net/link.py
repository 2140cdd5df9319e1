"""Link: the Zenoh session of a process.

Callbacks only enqueue into one bounded inbox, so that one thread owns all state. What is sent is kept, newest per key, and
answered to queries.
"""

import atexit
import json
import logging
import threading
from collections.abc import Callable, Collection
from contextlib import ExitStack
from functools import cache
from types import TracebackType
from typing import Any, Self

import zenoh

from blackboard.access.identity import Identity
from blackboard.access.probe import Spelling, fault
from blackboard.errors import UserError
from blackboard.net.flood import WINDOW, Flood, narrowed
from blackboard.net.inbox import TOO_LARGE, Inbox
from blackboard.net.knock import LARGEST, Knock
from blackboard.net.outage import Outage
from blackboard.net.settings import LinkConfig, endpoints, plain, priority
from blackboard.process.clock import UnixClock
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.raw import MAX_BYTES

log = logging.getLogger(__name__)

ENCODING = "application/msgpack;cop.v1"
MAX_KEYS = 4096  # keys of which the newest is kept; the one that was not sent for longest is given up
#: While strangers flood, each with a thread of its own; where it would take more, all are listened to.
MAX_SUBSCRIBERS = 512
LET_GO = 0.1  # seconds
PAUSE, LOG_AFTER = 0.1, 5.0  # seconds between tries to connect, and until the log says that it is waiting


class Stopped(Exception):
    """Asked to stop before the session was open."""


class Link:
    """A Zenoh session as a context manager; everything that arrives is an `Envelope` in one inbox."""

    def __init__(
        self,
        config: LinkConfig,
        name: str,
        *,
        patience: float = 10.0,
        stopped: Callable[[], bool] = lambda: False,
        clock: UnixClock | None = None,
        beside: "Link | None" = None,
    ) -> None:
        """Connect within `patience` seconds; what arrives is received by the link `beside`, where there is one.

        UserError: no router answers. Stopped: `stopped()` became true.
        """
        clock, identity, built = clock or UnixClock(), config.identity(), config.build(name)
        _let_go_at_exit()
        self._session = _open(built, name, patience, stopped, clock, identity, config.spelling)
        self._inbox: Inbox = Inbox() if beside is None else beside._inbox
        self.poke = self._inbox.poke  # lets a `receive` that waits, or the next one, return at once; for any thread
        self._newest: dict[str, bytes] = {}
        self._publishers: dict[str, Any] = {}
        self._answered: set[str] = set()
        self._listens: dict[str, None] = {}  # what was subscribed to, in this order
        self._subscribers: dict[str, Any] = {}  # what is subscribed to at this moment: while strangers flood, less
        self._flood, self._clock = Flood(), clock
        self._tokens: frozenset[str] = frozenset()  # by which the subscriptions were narrowed last
        self._narrowed_at = 0.0  # Unix seconds
        self._kept = ExitStack()  # what was declared; Zenoh undeclares what Python collects
        # called last; an open session with callbacks keeps a process from ending
        self._kept.callback(self._session.close)
        self._kept.callback(lambda: [subscriber.undeclare() for subscriber in self._subscribers.values()])
        self._sent = 0
        self._name, self._where = name, ", ".join(endpoints(built))
        self._outage, self._outage_lock = Outage(), threading.Lock()
        if json.loads(built.get_json("mode")) != "router":  # other routers come to it, and go
            self._listen_for_routers()
        self._knock = None if identity is None else Knock(name, identity, clock)
        if self._knock is not None and config.who != "router":
            try:
                self._listen_at_door(self._knock)
                self._knock.ask(self.get)
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything, the newest first, then close the session."""
        self._kept.close()

    @property
    def counters(self) -> dict[str, int]:
        """Envelopes sent, received and dropped here, bytes of payload received, and "floods" by strangers, if there were any.

        With keys also what the router has denied so far.
        """
        inbox = self._inbox
        knock = self._knock
        if knock is not None:
            knock.check_time()
        return {
            "sent": self._sent,
            "received": inbox.received,
            "dropped": inbox.dropped,
            "bytes": inbox.bytes_received,
            **({"floods": self._flood.count} if self._flood.count else {}),
            **({"denied": knock.denied} if knock is not None and knock.denied else {}),
        }

    def subscribe(self, key_expr: str) -> None:
        """Deliver what others publish on a key expression; what this process publishes itself is not delivered.

        The order of sending is kept within a subscription. Two of them may overtake each other: Zenoh gives each a queue and a thread
        of its own, and calling us in its receiving thread instead would lose large messages while this process computes.

        While those flood who hold none of the tokens that are watched, only the holders are listened to (`blackboard.net.flood`).
        """
        self._listens[key_expr] = None
        self._declare({*self._subscribers, key_expr})

    def watch(self, key_expr: str) -> None:
        """Deliver the liveliness tokens on a key expression as ALIVE and GONE, those already there first.

        When the network is lost all are GONE, also this process's own; when it is back, Zenoh declares everything again.
        """
        self._keep(self._session.liveliness().declare_subscriber(key_expr, self._lively, history=True))

    def token(self, key: str) -> None:
        """Hold a liveliness token until the link is closed."""
        self._keep(self._session.liveliness().declare_token(key))

    def receive(self, timeout: float) -> list[Envelope]:
        """The oldest of what has arrived, waiting up to `timeout` seconds for the first; empty if nothing came.

        Also logs that the router is lost, or back.
        """
        self._withstand()
        self._tell_of_outage()
        return self._inbox.drain(timeout)

    def send(self, envelope: Envelope) -> None:
        """Publish a PUT or a DELETE, and keep the newest per key for queries.

        During an outage nothing is sent and nothing raised; the newest is answered afterwards.
        """
        key = envelope.key
        publisher = self._publishers.pop(key, None) or self._session.declare_publisher(
            key, encoding=ENCODING, congestion_control=zenoh.CongestionControl.DROP, priority=priority(key)
        )
        self._publishers[key] = publisher
        if len(self._publishers) > MAX_KEYS:
            oldest = next(iter(self._publishers))
            self._newest.pop(oldest, None)
            self._publishers.pop(oldest).undeclare()
        if envelope.kind is Kind.PUT:
            self._newest[key] = envelope.payload
            self._answer(_space(key))
            publisher.put(envelope.payload)
        elif envelope.kind is Kind.DELETE:
            self._newest.pop(key, None)
            publisher.delete()
        else:
            raise ValueError(f"{key}: liveliness is not sent; hold a token")
        self._sent += 1

    def get(self, key_expr: str, timeout: float = 2.0) -> list[Envelope]:
        """The newest values on a key expression, of every process that answers, sorted by key."""
        replies = self._session.get(key_expr, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE)
        envelopes = [_envelope(reply.ok, Kind.PUT) for reply in replies if reply.ok is not None]
        return sorted(envelopes, key=lambda envelope: envelope.key)

    def denials(self) -> str | None:
        """With keys: what the router has denied this process of late, in one line; None where nothing was."""
        return None if self._knock is None else self._knock.denials(self.get)

    def _tell_of_outage(self) -> None:
        with self._outage_lock:
            outages = self._outage.look(self._clock.now())
        for away in outages:
            if away is None:
                log.warning(
                    "%s: lost the router (%s); trying again, what is sent meanwhile is lost", self._name, self._where
                )
            else:
                log.info("%s: the router is back after %.1f s", self._name, away)

    # --- floods ---------------------------------------------------------------------------------------------------------------

    def _withstand(self) -> None:
        """Listen to less where strangers have begun to flood, and to all again after a while."""
        now, tokens, flood, floods = self._clock.now(), self._inbox.tokens, self._flood, self._flood.count
        changed = flood.look(now, self._inbox.strangers)
        if flood.count > floods:
            log.warning("strangers flood: only who holds a liveliness token is listened to, until they stop")
        if changed or (flood.on and tokens != self._tokens and now >= self._narrowed_at + WINDOW):
            self._tokens, self._narrowed_at = tokens, now
            fewer = narrowed(self._listens, tokens, zenoh.KeyExpr) if flood.on and tokens else frozenset()
            self._declare(fewer if 0 < len(fewer) <= MAX_SUBSCRIBERS else self._listens)

    def _declare(self, wanted: Collection[str]) -> None:
        """Subscribe to these key expressions and no others; first what is new, so that nothing is missed between the two."""
        for key_expr in wanted:
            if key_expr not in self._subscribers:
                self._subscribers[key_expr] = self._session.declare_subscriber(
                    key_expr, self._arrived, allowed_origin=zenoh.Locality.REMOTE
                )
        for key_expr in [declared for declared in self._subscribers if declared not in wanted]:
            self._subscribers.pop(key_expr).undeclare()

    # --- what is declared, and its callbacks: they run in other threads, so they only enqueue or look up ----------------------

    def _keep(self, declared: Any) -> None:
        self._kept.callback(declared.undeclare)

    def _listen_for_routers(self) -> None:
        def hear(event: Any) -> None:
            if event.transport.whatami == zenoh.WhatAmI.ROUTER:
                here, now = event.kind == zenoh.SampleKind.PUT, self._clock.now()
                with self._outage_lock:
                    self._outage.hear_router(str(event.transport.zid), now, here=here)

        # called in Zenoh's thread, without one of its own; those already connected to come first
        direct: Any = zenoh.handlers.Callback(hear, indirect=False)
        self._keep(self._session.info.declare_transport_events_listener(direct, history=True))

    def _listen_at_door(self, knock: Knock) -> None:
        def hear(sample: Any) -> None:
            if len(sample.payload) <= LARGEST:
                knock.hear_router(sample.payload.to_bytes())

        # called in Zenoh's thread, without one of its own
        direct: Any = zenoh.handlers.Callback(hear, indirect=False)
        self._keep(self._session.declare_subscriber(knock.key, direct))

    def _answer(self, space: str) -> None:
        """Declare a queryable for a key expression; not as `complete`, because other processes may have keys in it."""
        if space not in self._answered:
            self._answered.add(space)
            direct: Any = zenoh.handlers.Callback(  # called in Zenoh's thread instead of one more for each queryable
                lambda query: self._asked(query, space), indirect=False
            )
            self._keep(self._session.declare_queryable(space, direct))

    def _asked(self, query: Any, space: str) -> None:
        with query:  # a query that is not released keeps the other side waiting
            for key, payload in list(self._newest.items()):
                if _space(key) == space and query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=ENCODING)

    def _arrived(self, sample: Any) -> None:
        key, size = str(sample.key_expr), len(sample.payload)
        if not self._inbox.turns_away(key, size):  # then its payload need not be copied
            kind = Kind.DELETE if sample.kind == zenoh.SampleKind.DELETE else Kind.PUT
            self._inbox.put(_envelope(sample, kind), size)

    def _lively(self, sample: Any) -> None:
        kind = Kind.GONE if sample.kind == zenoh.SampleKind.DELETE else Kind.ALIVE
        self._inbox.put(Envelope(str(sample.key_expr), b"", kind), 0)


def _envelope(sample: Any, kind: Kind) -> Envelope:
    payload = sample.payload
    return Envelope(str(sample.key_expr), payload.to_bytes() if len(payload) <= MAX_BYTES else TOO_LARGE, kind)


def _space(key: str) -> str:
    """The key expression of the queryable that answers for a key: all subjects of its topic, or the key itself."""
    parsed = keys.parse(key)
    if parsed is None or "subject" not in parsed[1]:
        return key
    topic, parts = parsed
    return topic.key(**{**parts, "subject": "**"})


@cache
def _let_go_at_exit() -> None:
    """Wait a moment when this process ends: Zenoh's threads let go of Python's objects after a session is closed.

    An interpreter that is gone by then aborts the process ("FATAL: exception not rethrown").
    """
    atexit.register(threading.Event().wait, LET_GO)


def start_zenoh_log() -> None:
    """Start Zenoh's own log, on standard output, with the levels that RUST_LOG gives."""
    zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]


def _open(
    built: zenoh.Config,
    name: str,
    patience: float,
    stopped: Callable[[], bool],
    clock: UnixClock,
    identity: Identity | None,
    spelling: Spelling,
) -> zenoh.Session:
    """Open a session, trying again until a router answers; each try is short, because it cannot be interrupted.

    With keys a refused certificate ends it at once, because it is refused again.
    """
    if identity is not None and (warning := identity.check_time(clock.now())):
        log.warning("%s", warning)
    where = ", ".join(endpoints(built))
    start, pause, logged = clock.now(), threading.Event(), False
    while not stopped():
        try:
            return zenoh.open(built)
        except zenoh.ZError as error:
            if not str(error).startswith("Unable to connect"):
                raise UserError(f"{name}: {plain(error)}; name other endpoints with {spelling.endpoints}") from error
            waited = clock.now() - start
            last = waited >= patience
            asked = identity is not None or last
            wrong = fault(endpoints(built), identity, last=last, spelling=spelling) if asked else None
            if wrong:
                raise UserError(f"{name}: {wrong}") from error
            if last:
                raise UserError(
                    f"{name}: no Zenoh router answers at {where}; start `blackboard router` there, or name another endpoint "
                    f"with {spelling.endpoint.strip()} (RUST_LOG=zenoh=debug tells more)"
                ) from error
        if waited >= LOG_AFTER and not logged:
            log.info("%s: waiting for a router at %s", name, where)
            logged = True
        pause.wait(PAUSE)
    raise Stopped(f"{name}: stopped before it was connected")
