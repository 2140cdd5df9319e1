"""The journal of a board: what it was given, in its order and when, so that a replay can give it the same. Pure.

The order in which a recorder receives messages is not the one in which a board received them, and in real time both order and time
count. So the board's process itself says what it handed to the board, by the digests of the messages; their bytes are on the tape.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Literal

from blackboard.process.service import Around, Service
from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import MAX_JOURNAL_NAME, Journal
from blackboard.wire.raw import MAX_BYTES
from blackboard.wire.types import MAX_OPINIONS

What = Literal["put", "delete", "alive", "gone", "wake"]
TOO_LARGE = "too-large"  # instead of the digest of such a payload, which no tape has
KINDS: dict[Kind, What] = {
    Kind.PUT: "put", Kind.DELETE: "delete", Kind.ALIVE: "alive", Kind.GONE: "gone",
}  # fmt: skip


def digest(envelope: Envelope) -> str:
    """The name of a message in a journal."""
    if len(envelope.payload) > MAX_BYTES:
        return TOO_LARGE
    return blake2b(envelope.key.encode() + b"\0" + envelope.payload, digest_size=8).hexdigest()


class Journaled(Around):
    """A board's service that also keeps a journal and sends it (`blackboard.process.service.Service`)."""

    def __init__(self, service: Service, *, team: str, sub_team: str, board: str) -> None:
        super().__init__(service)
        self._sub_team, self._board = sub_team, board
        self._key = keys.JOURNAL.key(team=team, sub_team=sub_team, board=board)
        self._began: float | None = None
        self._first = 0
        self._events: list[tuple[float, What, str]] = []

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        what = KINDS[envelope.kind]
        self._note(now, what, digest(envelope) if what == "put" else envelope.key[:MAX_JOURNAL_NAME])
        return self._with_journal(super().receive(envelope, now))

    def wake(self, now: float) -> list[Envelope]:
        self._note(now, "wake", "")
        return self._with_journal(super().wake(now))

    def _note(self, now: float, what: What, name: str) -> None:
        if self._began is None:
            self._began = now
        self._events.append((now, what, name))

    def _with_journal(self, out: list[Envelope]) -> list[Envelope]:
        """What is sent, the journal of what led to it first; where nothing is sent, a journal only once it is full."""
        if self._began is None or not (out or len(self._events) >= MAX_OPINIONS):
            return out
        journal = Journal(
            board=self._board,
            sub_team=self._sub_team,
            began=self._began,
            first=self._first,
            events=self._events,
            memory=next((digest(envelope) for envelope in reversed(out) if keys.MEMORY.match(envelope.key)), ""),
        )
        self._first, self._events = self._first + len(self._events), []
        return [Envelope(self._key, encode(journal)), *out]


@dataclass
class Life:
    """One board from its start to its end, by its journal."""

    sub_team: str
    board: str
    began: float  # Unix seconds
    first: int  # number of the first event that is there; above 0 where the recorder came later
    events: list[tuple[float, What, str]] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)  # Unix seconds of the event behind each gap in the journal
    #: after how many of `events` -> digest of the Memory that holds what the board remembered then
    memories: dict[int, str] = field(default_factory=dict)


def lives(journals: Iterable[Journal]) -> list[Life]:
    """The lives of all boards, in the order in which they began, from journals in any order; those that come twice count once."""
    parts: dict[tuple[float, str, str], dict[int, Journal]] = {}
    for journal in journals:
        if journal.events:
            parts.setdefault((journal.began, journal.sub_team, journal.board), {})[journal.first] = journal
    lives = []
    for (began, sub_team, board), journal_at in sorted(parts.items()):
        life = Life(sub_team, board, began, min(journal_at))
        expected = life.first
        for first, journal in sorted(journal_at.items()):
            if first > expected:
                life.gaps.append(journal.events[0][0])
            life.events += journal.events[max(0, expected - first) :]
            if journal.memory:
                life.memories[len(life.events)] = journal.memory
            expected = max(expected, first + len(journal.events))
        lives.append(life)
    return lives
