"""Reports to each member how many of its messages the router denied, and to the operator what was denied to whom. Pure."""

import json
import logging
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any

from blackboard.access.denials import Denial
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope

log = logging.getLogger(__name__)

MAX_DENIALS = 1024  # different denials (who, what, key) of which each is logged once; those beyond are only counted
EVERY = 0.5  # seconds between two messages about one member
CALM = 60.0  # seconds after a member's newest denial until its count is sent once more, with an empty `last`


class Doorkeeper:
    """Pure: denials in, envelopes on `door/...` and log lines out.

    A denial is logged when it is new (who, what, which key but for its subject), and then at every tenfold of its count.
    """

    def __init__(self, common_names: Iterable[str], team: str) -> None:
        self.team = team
        self.denied: Counter[str] = Counter()  # by common name; "" for who did not get in
        self._last: dict[str, str] = {}  # common name -> text of its newest denial, for `CALM` seconds
        self._told: dict[str, float] = {}  # common name -> time in seconds at which `_last` was sent
        self._seen: Counter[tuple[str, str, str]] = Counter()  # who, what, key -> how often it was denied
        self._changed: set[str] = set()  # common names with a denial that was not sent yet
        self._told_at = float("-inf")  # time in seconds of the newest message
        self._members = frozenset(common_names)

    def greet(self) -> list[Envelope]:
        """One message for each member; a member that gets it knows that the router has its name."""
        return [self._message(name) for name in sorted(self._members)]

    def count(self, denials: Iterable[Denial]) -> None:
        """Count denials, and log what is new."""
        for denial in denials:
            who = denial.who if denial.who in self._members else ""
            self.denied[who] += 1
            text = f"{denial.who or 'somebody'} may not {denial.what} {denial.key}" if denial.key else denial.what
            self._last[who] = text[:400]
            self._changed.add(who)
            seen = (denial.who, re.sub(r"\d+", "0", denial.what), _but_subject(denial.key))
            if seen not in self._seen and len(self._seen) >= MAX_DENIALS:
                seen = ("others", "", "")
            self._seen[seen] += 1
            if _is_round(self._seen[seen]):
                log.warning(
                    "denied: %r (%d times, %d denials in all)", text[:400], self._seen[seen], self.denied.total()
                )

    def messages_due(self, now: float) -> list[Envelope]:
        """The messages that are due at a time in seconds: of members with new denials, and of those without any for `CALM` seconds."""
        if now < self._told_at + EVERY:
            return []
        calm = [name for name, told in self._told.items() if now >= told + CALM and name not in self._changed]
        for name in calm:
            del self._last[name], self._told[name]
        changed, self._changed = self._changed, set()
        if changed or calm:
            self._told_at = now
        self._told |= dict.fromkeys(changed, now)
        return [self._message(name) for name in sorted((*changed, *calm))]

    def _message(self, name: str) -> Envelope:
        said = {"denied": self.denied[name], "last": self._last.get(name, "")}
        key = f"door/{self.team}/{name}" if name else f"door/{self.team}/strangers"
        return Envelope(key, json.dumps(said).encode())


def read(payload: bytes) -> tuple[int, str] | None:
    """The number of denials and the text of the newest one (empty if older than `CALM`) in a message; None if it is not one."""
    try:
        said: Any = json.loads(payload)
        return max(0, int(said["denied"])), str(said["last"])[:400]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def common_names(access_control: dict[str, Any]) -> list[str]:
    """The members that a router's access control knows."""
    return [name for subject in access_control["subjects"] for name in subject["cert_common_names"]]


def _but_subject(key: str) -> str:
    topic, parts = keys.parse(key[:200]) or (None, {})
    return key[:200] if topic is None else topic.key(**(parts | {"subject": "**"}))


def _is_round(count: int) -> bool:
    while count % 10 == 0:
        count //= 10
    return count == 1
