"""Roster: who is there, by the liveliness tokens of a team, also while a router restarts. Pure.

When a router dies, all tokens vanish, a process's own among them, in any order. So a token that vanished still counts for
`grace` seconds. If `own` vanished too, this process is cut off: it is `away` until `own` is back, no token expires
meanwhile, and then everybody else has `comeback` seconds to return.
"""

import math

from blackboard.process.bounded import put
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind

GRACE = 0.5  # seconds
COMEBACK = 5.0  # seconds
MAX_GONE = 1024  # tokens that are remembered as gone
MAX_TOKENS = 1024  # that count as there; more are ignored until some of these have gone
TOKENS = (keys.MEMBER, keys.BOARD, keys.WORLD)


class Roster:
    """The tokens that a process watches. `forget` is due at `changes_at`; all times are Unix time in seconds."""

    def __init__(self, own: str | None = None, *, grace: float = GRACE, comeback: float = COMEBACK) -> None:
        """`own` is a token of this process that it watches itself, or None where it need not notice that it is cut off."""
        self.own = own
        self.away = False
        self.tokens: set[str] = set()  # that are held at this moment, without any grace
        self.robots: dict[str, list[str]] = {}  # sub-team -> its robots that count as there, sorted
        self.boards: dict[str, list[str]] = {}  # sub-team -> its boards that count as there, sorted
        self.world = False  # whether a world counts as there
        self.worlds = 0  # how often the token of a world has come
        self.arrivals = 0  # how often the token of a board has come
        self._grace, self._comeback = grace, comeback
        self._until: dict[str, float] = {}  # token -> until when it counts; infinity while it is held
        self._gone: dict[str, None] = {}  # tokens that counted once and do no longer, the oldest first

    def hear_token(self, envelope: Envelope, now: float) -> bool:
        """A token appeared or vanished. True if it came back while it still counted: its holder may have missed something."""
        token, here = envelope.key, envelope.kind is Kind.ALIVE
        if not any(topic.match(token) for topic in TOKENS):
            return False
        needed = token == self.own or keys.WORLD.match(token) is not None
        if here and not needed and token not in self._until and len(self._until) >= MAX_TOKENS:
            return False
        if here and token not in self.tokens and keys.WORLD.match(token):
            self.worlds += 1
        if here and token not in self.tokens and keys.BOARD.match(token):
            self.arrivals += 1
        (self.tokens.add if here else self.tokens.discard)(token)
        back = here and token in self._until
        if token == self.own:
            if self.away and here:
                self._until = {each: max(until, now + self._comeback) for each, until in self._until.items()}
            self.away, back = not here, False
        if here:
            self._gone.pop(token, None)
            self._until[token] = math.inf
            self._count()
        elif token in self._until:
            self._until[token] = now + self._grace
        return back

    def changes_at(self) -> float:
        """When the next token ceases to count; infinity if none does, or while this process is away."""
        return math.inf if self.away else min(self._until.values(), default=math.inf)

    def forget(self, now: float) -> None:
        """Drop the tokens whose time is over; none while this process is away."""
        if self.changes_at() > now:
            return
        for token in [token for token, until in self._until.items() if until <= now]:
            del self._until[token]
            put(self._gone, token, None, MAX_GONE)
        self._count()

    def holds_world(self) -> bool:
        """Whether a world holds its token at this moment, without any grace."""
        return any(keys.WORLD.match(token) for token in self.tokens)

    def has_gone(self, token: str) -> bool:
        """Whether a token was held once and counts no longer; False for one that was never seen."""
        return token in self._gone

    def has_lost_boards(self, sub_team: str) -> bool:
        """Whether some board of a sub-team was there once and counts no longer."""
        return any((parts := keys.BOARD.match(token)) and parts["sub_team"] == sub_team for token in self._gone)

    def _count(self) -> None:
        self.robots, self.boards, self.world = {}, {}, False
        for token in sorted(self._until):
            if parts := keys.MEMBER.match(token):
                self.robots.setdefault(parts["sub_team"], []).append(parts["robot"])
            elif parts := keys.BOARD.match(token):
                self.boards.setdefault(parts["sub_team"], []).append(parts["board"])
            elif keys.WORLD.match(token):
                self.world = True
