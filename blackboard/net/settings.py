"""The settings of a Zenoh session: what a person sets by file or flag, and our own defaults for the rest."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from blackboard.access.identity import Identity, find, find_link
from blackboard.access.probe import ARGUMENTS, FLAGS, Spelling
from blackboard.errors import UserError
from blackboard.wire.keys import parse

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
SECURE_ENDPOINT = "tls/127.0.0.1:7447"  # with keys
SECURE = ("tls/", "quic/")  # the protocols of endpoints that carry certificates
#: The protocols of Zenoh's Python package. To an endpoint of any other protocol Zenoh says only that nobody answers there.
PROTOCOLS = ("tcp/", *SECURE, "udp/", "ws/", "unixsock-stream/")

#: Our defaults, by Zenoh's configuration key.
OURS: dict[str, Any] = {
    "scouting/multicast/enabled": False,  # endpoints are given; a session joins no other network by chance
    "scouting/delay": 10,  # ms; the default costs a router half a second
    "timestamping/enabled": True,
    "queries_default_timeout": 2000,  # ms
    "transport/shared_memory/enabled": False,  # 16 MiB a process and seconds of latency with many small publishers
    "transport/link/tx/lease": 2000,  # ms until a frozen process is noticed
    # Messages may be dropped, but only after 100 ms in a full queue: a busy machine loses none, a frozen receiver delays 100 ms
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/size/interactive_high": 16,  # the queues of the other priorities of the topic table
    "transport/link/tx/queue/size/data_low": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100_000,  # microseconds
    "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
}
#: More of them, by the mode of the session.
OURS_BY_MODE: dict[str, dict[str, Any]] = {
    "client": {"connect/timeout_ms": 1000},  # of one try: `zenoh.open` cannot be interrupted
    "peer": {"listen/endpoints": []},  # Zenoh's own default is every interface
    "router": {"adminspace/enabled": True},  # which is read-only; it listens where a client looks for it
}


@dataclass(frozen=True)
class LinkConfig:
    """Zenoh's usual settings, applied in the order of its own examples: `file`, then these, then `cfg` ("config/path:JSON5").

    Where none of them sets a key, `OURS` does. The mode is client unless set otherwise. With `keys`, a directory made by
    `blackboard keys`, the certificate of `who` in it is used, and every endpoint must be one that carries certificates.
    """

    mode: str | None = None
    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    file: str | None = None
    multicast: bool | None = None
    cfg: Sequence[str] = ()
    keys: str | None = None
    #: "robot/r1", "board/board-a", or a kind of which a team has one; commands that look on are viewers.
    who: str = "viewer"
    #: By a call in Python, of which lines on mistakes then name the arguments; otherwise by flags.
    called: bool = False

    @property
    def spelling(self) -> Spelling:
        """How who made this gives endpoints and keys."""
        return ARGUMENTS if self.called else FLAGS

    def identity(self) -> Identity | None:
        """The certificate of this process, or None without keys. UserError: the directory has none that can be used."""
        return None if self.keys is None else find(self.keys, self.who, self.spelling.directory)

    def _link_settings(self) -> dict[str, Any]:
        """The certificate with which a router with keys connects to another one; nothing where it connects to none."""
        if self.keys is None or self.who != "router" or not self.connect:
            return {}
        link, tls = find_link(self.keys), "transport/link/tls/"
        names = {"connect_certificate": str(link.certificate), "connect_private_key": str(link.key)}
        return {f"{tls}{name}": value for name, value in names.items()} | {f"{tls}verify_name_on_connect": True}

    def build(self, name: str) -> zenoh.Config:
        """The configuration of a session called `name`. UserError: Zenoh does not accept a setting; the text names it."""
        try:
            config = zenoh.Config.from_file(self.file) if self.file else zenoh.Config()
        except zenoh.ZError as error:
            raise UserError(
                f"--config {self.file}: {plain(error)}; give a Zenoh configuration (JSON5 or YAML)"
            ) from error
        identity = self.identity()
        if identity is not None:
            for key, value in (identity.settings() | self._link_settings()).items():
                _insert(config, key, json.dumps(value), f"{identity.folder}: {key}")
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
                raise UserError(f"--cfg {pair}: write KEY:VALUE, the value in JSON5")
            _insert(config, key, value, f"--cfg {pair}")
        _apply_defaults(config, name, SECURE_ENDPOINT if self.keys else DEFAULT_ENDPOINT)
        _check_protocols(config)
        if self.keys:
            _check_shut(config, self.spelling, is_router=self.who == "router")
        return config


def endpoints(config: zenoh.Config) -> list[str]:
    """The endpoints that a session of this configuration connects to."""
    addresses: list[str] = json.loads(config.get_json("connect/endpoints"))
    return addresses


def priority(key: str) -> zenoh.Priority:
    """Zenoh's priority of what is put on a key, by the topic table; for a key of no topic Zenoh's own default."""
    parsed = parse(key)
    name = "data" if parsed is None else parsed[0].priority
    chosen: zenoh.Priority = getattr(zenoh.Priority, name.upper().replace("-", "_"))
    return chosen


def plain(error: Exception) -> str:
    """The message of a Zenoh error in one line, without the places in its source."""
    text = re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))
    message = re.search(r'msg: "(.*?)(?:", location|"\s*}|$)', text, re.DOTALL)
    return " ".join((message[1] if message else text).split())[:300]


def _insert(config: zenoh.Config, key: str, value: str, where: str) -> None:
    try:
        config.insert_json5(key, value)
    except zenoh.ZError as error:
        raise UserError(f"{where}: Zenoh does not take it ({plain(error)})") from error


def _check_protocols(config: zenoh.Config) -> None:
    """UserError: an endpoint to connect to is of no protocol that there is, as `http://host`."""
    for endpoint in endpoints(config):
        protocol, slash, _ = endpoint.partition("/")  # a mode has none, where endpoints are given for each mode
        if slash and f"{protocol}/" not in PROTOCOLS:
            there = f"the protocols are {', '.join(PROTOCOLS)}"
            raise UserError(f"{endpoint}: {protocol} is no protocol of an endpoint; write tcp/HOST:PORT ({there})")


def _check_shut(config: zenoh.Config, spelling: Spelling, *, is_router: bool) -> None:
    """UserError: with keys, an endpoint without certificates, or one who listens beside the router and its access control."""
    listening = json.loads(config.get_json("listen/endpoints"))
    if isinstance(listening, dict):  # Zenoh's own default, which a client does not use
        listening = []
    for endpoint in (*endpoints(config), *listening):
        if not endpoint.startswith(SECURE):
            raise UserError(
                f"{endpoint}: with {spelling.keys} write tls/{endpoint.partition('/')[2]}, which carries certificates"
            )
    if is_router and endpoints(config) and not config.get_json("transport/link/tls/connect_certificate").strip('"'):
        raise UserError("connect/endpoints: with --keys name the other router with --connect (-e)")
    if not is_router and (json.loads(config.get_json("mode")) != "client" or listening):
        raise UserError(
            "--mode, --listen: with --keys only `blackboard router` listens, because it decides who may do what"
        )


def _apply_defaults(config: zenoh.Config, name: str, endpoint: str) -> None:
    """Apply our defaults where neither file nor flag set a key, that is, where it still has Zenoh's own default."""
    stock = zenoh.Config()

    def default(key: str, value: Any) -> None:
        if config.get_json(key) == stock.get_json(key):
            config.insert_json5(key, json.dumps(value))

    default("mode", "client")
    default("metadata", {"name": name})
    mode = json.loads(config.get_json("mode"))
    for key, value in (
        OURS | OURS_BY_MODE[mode] | ({"listen/endpoints": [endpoint]} if mode == "router" else {})
    ).items():
        default(key, value)
    if mode == "client" and config.get_json("scouting/multicast/enabled") != "true":
        default("connect/endpoints", [endpoint])
