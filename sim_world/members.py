"""Who takes part: the liveliness tokens of robots and boards, with patience for a router that comes back. Pure."""

from __future__ import annotations

import math

from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind


class Members:
    """The tokens of a team, as told.

    When a router dies, all tokens vanish, the world's own among them, in any order. So a token that vanished still
    counts for `grace` seconds; if the world's own went too, the team is `away` until that is back, and then everybody
    has `comeback` seconds to return.
    """

    def __init__(self, team: str, grace: float, comeback: float) -> None:
        self.own = keys.WORLD.key(team=team)
        self.away = False
        self.boards: set[str] = set()  # the sub-teams that have a board
        self.robots: dict[str, list[str]] = {}  # sub-team -> its robots, sorted
        self._grace, self._comeback = grace, comeback
        self._until: dict[str, float] = {}  # token -> until when it counts; infinity while it is there

    def hear(self, envelope: Envelope, now: float) -> bool:
        """A token appeared or vanished. True if it came back before its time was over: it may have missed something."""
        here = envelope.kind is Kind.ALIVE
        if envelope.key == self.own:
            if self.away and here:
                self._until = {token: max(until, now + self._comeback) for token, until in self._until.items()}
            self.away = not here
        elif here:
            back = envelope.key in self._until
            self._until[envelope.key] = math.inf
            self._count()
            return back
        elif envelope.key in self._until:
            self._until[envelope.key] = now + self._grace
        return False

    def changes_at(self) -> float:
        """When the next token ceases to count, infinity if none does."""
        return min(self._until.values(), default=math.inf)

    def forget(self, now: float) -> None:
        """Drop the tokens whose time is over; not while the router is away."""
        if not self.away and self.changes_at() <= now:
            self._until = {token: until for token, until in self._until.items() if until > now}
            self._count()

    def _count(self) -> None:
        self.boards = {parts["sub_team"] for token in self._until if (parts := keys.BOARD.match(token))}
        self.robots = {}
        for token in sorted(self._until):
            if parts := keys.MEMBER.match(token):
                self.robots.setdefault(parts["sub_team"], []).append(parts["robot"])
