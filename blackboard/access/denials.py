"""What a router's access control denied, read from the router's log. Zenoh has no counter for it, and does not tell the sender.

Zenoh's access control logs each of its decisions at the level `trace` and has no other output. Where it decides about a declared key
for the first time, it lists all kinds of messages; only the decisions after that list are about a message that came.
"""

import mmap
import re
from collections import Counter
from dataclasses import dataclass

TARGET = "zenoh::net::routing::interceptor::access_control"
LEVELS = f"warn,{TARGET}=trace"  # for RUST_LOG
LISTED = 9  # lines that follow such a list's head: one for each kind of message
MAX_SESSIONS = 4096  # sessions whose certificate's name is remembered; the oldest is forgotten first
MAX_WARNINGS = 100  # different warnings of Zenoh that are passed on
LISTS = (b"ACL (ingress): caching permissions for `", b"ACL (egress): caching permissions for `")
#: A line without them has no denial.
TELLING = (b" unauthorized ", b": caching ", b" INFO ", b" WARN ", b" DEBUG ", b" ERROR ")
PACKET = mmap.PAGESIZE  # bytes; a longer write comes in several pieces

_LINE = re.compile(rb"^\S+\s+(\w+)\s+(?:\S+ )?ThreadId\((\d+)\) (\S+): (.*)$")
_DENIED = re.compile(
    rb"^(?:Using cached result: )?(\w+)(?: on \S+)? is unauthorized to ([\w/ ]+?) \((ingress|egress)\) on (.*)$"
)
_KNOWN = re.compile(rb"^(\w+) on \S*CertCommonName\(([^)]*)\)")
_STRANGE = re.compile(rb"^(\w+) did not match any configured ACL subject")


@dataclass(frozen=True)
class Denial:
    """One message, or one attempt to connect, that the router did not let through."""

    who: str  # the common name of a certificate; "" for who did not get in
    what: str  # "put", "declare subscriber", ... or why the connection was refused
    key: str = ""


class DenialReader:
    """Takes a router's log event by event and gives denials; other warnings, each kind once, are in `other` until somebody takes them.

    A key may contain line breaks, and Zenoh writes them as they are. So an event is what came in one write, and only its first line
    is read: otherwise a denied key could forge lines about others.
    """

    def __init__(self) -> None:
        self.enabled = False  # whether Zenoh has said that its access control is on
        self.other: list[str] = []
        self._said: set[str] = set()
        self._continued = False  # whether the next piece of the log goes on with the same event
        self._skip: Counter[bytes] = Counter()  # thread of the router -> lines of a list that it has still to log
        self._names: dict[bytes, str] = {}  # session -> common name of its certificate

    def read(self, event: bytes) -> Denial | None:
        """What one event says was denied. An event that fills a `PACKET` goes on in the next ones, which are left out."""
        continued, self._continued = self._continued, len(event) >= PACKET
        line = event.partition(b"\n")[0]
        if continued or not (any(self._skip.values()) or any(word in line for word in TELLING)):
            return None  # mostly lines about what is allowed
        parts = _LINE.match(line)
        if parts is None:
            return None
        level, thread, target, text = parts.groups()
        if target != TARGET.encode():
            return self._elsewhere(level, target, text)
        if self._skip[thread]:
            self._skip[thread] -= 1
            self._remember(text)
        elif text.startswith(LISTS):
            self._skip[thread] = LISTED
        else:
            return self._decision(text)
        return None

    def _decision(self, text: bytes) -> Denial | None:
        """What Zenoh decided about one message or session, where it denied it."""
        if text.startswith(b"Access control is enabled"):
            self.enabled = True
        if _STRANGE.match(text):
            return Denial("", "a certificate that is revoked, or not known to this router, opened a session")
        denied = _DENIED.match(text)
        if denied is None:
            return None
        self._remember(text)
        session, what, flow, key = denied.groups()
        if flow == b"egress":  # a subscriber that may not read it did not get it: nothing is wrong with its sender
            return None
        who = self._names.get(session, f"session {session.decode()[:64]}")
        return Denial(who, _plain(what.decode()), key.decode("utf-8", "replace"))

    def _remember(self, text: bytes) -> None:
        known = _KNOWN.match(text)
        if known and known[1] not in self._names:
            if len(self._names) >= MAX_SESSIONS:
                self._names.pop(next(iter(self._names)))
            self._names[known[1]] = known[2].decode("utf-8", "replace")

    def _elsewhere(self, level: bytes, target: bytes, text: bytes) -> Denial | None:
        """A refused connection; what else Zenoh warns of goes to `other`."""
        told = text.decode("utf-8", "replace").split(" Hint: ")[0].removesuffix(".")
        if target == b"zenoh_link_tls::unicast" and level == b"WARN":
            return Denial("", f"a connection was refused: {told}")
        said = f"{target.decode('utf-8', 'replace')}: {told}"[:400]
        kind = re.sub(r"\d+", "0", said)  # the same of another port is not new
        if kind not in self._said and len(self._said) < MAX_WARNINGS:
            self._said.add(kind)
            self.other.append(said)
        return None


def _plain(what: str) -> str:
    """Zenoh's name of a kind of message, as a person would say it."""
    return {"Liveliness Token": "hold the token"}.get(what, what.replace("Declare/Undeclare", "declare").lower())
