"""Link: one Zenoh session of a process, and the only file that names zenoh.

Callbacks only enqueue into one bounded inbox, so that one thread owns all state. What is sent is kept, newest per key, and
answered to queries.
"""

from __future__ import annotations

import json
import logging
import re
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import zenoh

from blackboard.clock import Clock
from blackboard.errors import Mistake
from blackboard.inbox import Inbox
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_BYTES

log = logging.getLogger(__name__)

ENCODING = "application/msgpack;cop.v1"
DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
TOO_LARGE = bytes(MAX_BYTES + 1)  # stands for any larger payload: it is refused for its size, and only that matters
PAUSE, TELL = 0.1, 5.0  # seconds between tries to connect, and until a person is told of them

#: Settings of a session where neither a file nor a flag says otherwise.
OURS: dict[str, Any] = {
    "scouting/multicast/enabled": False,  # endpoints are given; nobody joins a stranger's network
    "scouting/delay": 10,  # ms; the default costs a router half a second
    "timestamping/enabled": True,
    "queries_default_timeout": 2000,  # ms
    "transport/shared_memory/enabled": False,  # 16 MiB a process and seconds of latency with many small publishers
    "transport/link/tx/lease": 2000,  # ms until a frozen process is noticed
    # DROP with a long queue and a long wait: nothing is lost on a busy machine, and a frozen listener stalls nobody for long
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100_000,  # microseconds
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
}
OURS_BY_MODE: dict[str, dict[str, Any]] = {
    "client": {"connect/timeout_ms": 1000},  # of one try: `zenoh.open` cannot be interrupted
    "peer": {"listen/endpoints": []},  # Zenoh's own default is every interface
    "router": {"listen/endpoints": [DEFAULT_ENDPOINT], "adminspace/enabled": True},  # which is read-only
}


class Stopped(Exception):
    """Asked to stop before the session was open."""


@dataclass(frozen=True)
class LinkConfig:
    """Zenoh's usual settings, in the order of its own examples: `file`, then these, then `cfg` ("config/path:JSON5").

    Where none of them speaks, `OURS` does. The mode is client unless said otherwise.
    """

    mode: str | None = None
    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    file: str | None = None
    multicast: bool | None = None
    cfg: Sequence[str] = ()

    def build(self, name: str) -> zenoh.Config:
        """The session's configuration; a `Mistake` names what Zenoh does not take."""
        try:
            config = zenoh.Config.from_file(self.file) if self.file else zenoh.Config()
        except zenoh.ZError as error:
            raise Mistake(
                f"--config {self.file}: {_plain(error)}; give a Zenoh configuration (JSON5 or YAML)"
            ) from error
        flags = {
            "mode": self.mode,
            "connect/endpoints": list(self.connect) or None,
            "listen/endpoints": list(self.listen) or None,
            "scouting/multicast/enabled": self.multicast,
        }
        for key, value in flags.items():
            if value is not None:
                _insert(config, key, json.dumps(value), " ".join((*self.connect, *self.listen)) or key)
        for pair in self.cfg:
            key, colon, value = pair.partition(":")
            if not colon:
                raise Mistake(f"--cfg {pair}: write KEY:VALUE, the value in JSON5")
            _insert(config, key, value, f"--cfg {pair}")
        _fill(config, name)
        return config


def _insert(config: zenoh.Config, key: str, value: str, where: str) -> None:
    try:
        config.insert_json5(key, value)
    except zenoh.ZError as error:
        raise Mistake(f"{where}: Zenoh does not take it ({_plain(error)})") from error


def _fill(config: zenoh.Config, name: str) -> None:
    """Say what nobody said: what still is as Zenoh has it becomes as we want it."""
    stock = zenoh.Config()

    def fill(key: str, value: Any) -> None:
        if config.get_json(key) == stock.get_json(key):
            config.insert_json5(key, json.dumps(value))

    fill("mode", "client")
    fill("metadata", {"name": name})
    mode = json.loads(config.get_json("mode"))
    for key, value in (OURS | OURS_BY_MODE[mode]).items():
        fill(key, value)
    if mode == "client" and config.get_json("scouting/multicast/enabled") != "true":
        fill("connect/endpoints", [DEFAULT_ENDPOINT])


def _plain(error: Exception) -> str:
    """What Zenoh says, in one line and without the places in its source."""
    text = re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))
    found = re.search(r'msg: "(.*?)(?:", location|"\s*}|$)', text, re.DOTALL)
    return " ".join((found[1] if found else text).split())[:300]


class Link:
    """A Zenoh session as a context manager; everything that arrives is an `Envelope` in one inbox."""

    def __init__(
        self,
        config: LinkConfig,
        name: str,
        *,
        patience: float = 10.0,
        stopped: Callable[[], bool] = lambda: False,
        clock: Clock | None = None,
    ) -> None:
        """Connects for at most `patience` wall seconds. Mistake: nobody answers there. Stopped: by `stopped`."""
        self._session = _open(config, name, patience, stopped, clock or Clock())
        self._inbox = Inbox()
        self._newest: dict[str, bytes] = {}
        self._publishers: dict[str, Any] = {}
        self._answered: set[str] = set()
        self._kept = ExitStack()  # what was declared: a token that is not kept vanishes
        self._kept.callback(self._session.close)  # last: an open session with callbacks keeps a process from ending
        self._sent = 0

    def __enter__(self) -> Link:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything, the newest first, then close the session."""
        self._kept.close()

    @property
    def counters(self) -> dict[str, int]:
        """Envelopes sent, received and dropped here, and bytes of payload received."""
        inbox = self._inbox
        return {
            "sent": self._sent,
            "received": inbox.received,
            "dropped": inbox.dropped,
            "bytes": inbox.bytes_received,
        }

    def subscribe(self, key_expr: str) -> None:
        """Deliver what others publish on a key expression; what this process publishes itself is not delivered."""
        self._keep(self._session.declare_subscriber(key_expr, self._arrived, allowed_origin=zenoh.Locality.REMOTE))

    def watch(self, key_expr: str) -> None:
        """Deliver the liveliness tokens on a key expression as ALIVE and GONE, those already there first.

        When the network is lost all are GONE, also this process's own; Zenoh restores everything when it is back.
        """
        self._keep(self._session.liveliness().declare_subscriber(key_expr, self._lively, history=True))

    def token(self, key: str) -> None:
        """Hold a liveliness token until the link is closed."""
        self._keep(self._session.liveliness().declare_token(key))

    def receive(self, timeout: float) -> list[Envelope]:
        """The oldest of what has arrived, waiting up to `timeout` seconds for the first; empty if nothing came."""
        return self._inbox.drain(timeout)

    def send(self, envelope: Envelope) -> None:
        """Publish a PUT or a DELETE, and keep the newest per key for queries.

        During an outage nothing is sent and nothing raised; the newest is answered afterwards.
        """
        key = envelope.key
        if key not in self._publishers:
            self._publishers[key] = self._session.declare_publisher(
                key, encoding=ENCODING, congestion_control=zenoh.CongestionControl.DROP
            )
        if envelope.kind is Kind.PUT:
            self._newest[key] = envelope.payload
            self._answer(_space(key))
            self._publishers[key].put(envelope.payload)
        elif envelope.kind is Kind.DELETE:
            self._newest.pop(key, None)
            self._publishers[key].delete()
        else:
            raise ValueError(f"{key}: liveliness is not sent; hold a token")
        self._sent += 1

    def get(self, key_expr: str, timeout: float = 2.0) -> list[Envelope]:
        """The newest values on a key expression, of every process that answers, sorted by key."""
        replies = self._session.get(key_expr, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE)
        found = [_envelope(reply.ok, Kind.PUT) for reply in replies if reply.ok is not None]
        return sorted(found, key=lambda envelope: envelope.key)

    # --- declared things, and their callbacks: other threads, so they only enqueue or look up --------------------------------

    def _keep(self, declared: Any) -> None:
        self._kept.callback(declared.undeclare)

    def _answer(self, space: str) -> None:
        """Answer queries about a space of keys, which others may share: not `complete`."""
        if space not in self._answered:
            self._answered.add(space)
            direct: Any = zenoh.handlers.Callback(
                lambda query: self._asked(query, space), indirect=False
            )  # no thread for each
            self._keep(self._session.declare_queryable(space, direct))

    def _asked(self, query: Any, space: str) -> None:
        with query:  # a query that is not let go makes the asker wait
            for key, payload in list(self._newest.items()):
                if _space(key) == space and query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=ENCODING)

    def _arrived(self, sample: Any) -> None:
        kind = Kind.DELETE if sample.kind == zenoh.SampleKind.DELETE else Kind.PUT
        self._inbox.put(_envelope(sample, kind), len(sample.payload))

    def _lively(self, sample: Any) -> None:
        kind = Kind.GONE if sample.kind == zenoh.SampleKind.DELETE else Kind.ALIVE
        self._inbox.put(Envelope(str(sample.key_expr), b"", kind), 0)


def _envelope(sample: Any, kind: Kind) -> Envelope:
    payload = sample.payload
    return Envelope(str(sample.key_expr), payload.to_bytes() if len(payload) <= MAX_BYTES else TOO_LARGE, kind)


def _space(key: str) -> str:
    """The keys that one queryable answers for: all subjects of a topic, or the key itself."""
    found = keys.parse(key)
    if found is None or "subject" not in found[1]:
        return key
    topic, parts = found
    return topic.key(**{**parts, "subject": "**"})


def log_as_environment_says() -> None:
    """Let Zenoh write its own log, to standard output, as RUST_LOG says."""
    zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]


def _open(config: LinkConfig, name: str, patience: float, stopped: Callable[[], bool], clock: Clock) -> zenoh.Session:
    """Try again until somebody answers: a try is short, because it cannot be interrupted."""
    built = config.build(name)
    where = ", ".join(json.loads(built.get_json("connect/endpoints")))
    start, pause, told = clock.now(), threading.Event(), False
    while not stopped():
        try:
            return zenoh.open(built)
        except zenoh.ZError as error:
            if not str(error).startswith("Unable to connect"):
                raise Mistake(f"{name}: {_plain(error)}; name other endpoints with -e or -l") from error
            waited = clock.now() - start
            if waited >= patience:
                raise Mistake(
                    f"{name}: no Zenoh router answers at {where}; start `blackboard router` there, or name another endpoint "
                    "with -e (RUST_LOG=zenoh=debug tells more)"
                ) from error
        if waited >= TELL and not told:
            log.info("%s: waiting for a router at %s", name, where)
            told = True
        pause.wait(PAUSE)
    raise Stopped(f"{name}: stopped before it was connected")
