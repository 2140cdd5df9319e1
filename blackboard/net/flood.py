"""To what a link listens while strangers, who hold no liveliness token, flood it. Pure.

A router carries whatever somebody listens to, and drops messages of honest processes too once a receiver does not keep up. So while
strangers flood, a link listens only to what the holders of tokens write under their own names, and the router carries nobody else's to
it. After a pause it listens to all again, to find out whether the flood is over.
"""

import math
from collections.abc import Callable, Iterable
from typing import Protocol

from blackboard.wire import keys

RATE = 1000.0  # messages of strangers a second from which they flood; to refuse so many takes a tenth of a core
WINDOW = 0.1  # seconds over which they are counted, at least
FIRST, LONGEST = 5.0, 60.0  # seconds of the first pause, and of the longest; each is twice the one before
CALM = 1.0  # seconds after a pause in which a flood is the same one, that goes on


class KeyExpr(Protocol):
    """What is needed of `zenoh.KeyExpr`."""

    def includes(self, other: str, /) -> bool: ...

    def intersects(self, other: str, /) -> bool: ...


class Flood:
    """Whether strangers flood, or did so less than a pause ago. `now` is Unix time in seconds."""

    def __init__(self) -> None:
        self.on = False
        self.count = 0  # floods
        self._pause = FIRST
        self._since, self._seen = -math.inf, 0  # when the window began, and how many had come by then
        self._until = self._over = -math.inf  # the end of this pause, and of the one before

    def look(self, now: float, strangers: int) -> bool:
        """Take how many messages of strangers have come until now; True where `on` has changed."""
        if self.on:
            if self._until - self._pause <= now < self._until:
                return False
            self.on, self._over = False, now
            self._since, self._seen = now, strangers
            return True
        passed = now - self._since
        if 0.0 <= passed < WINDOW:
            return False
        rate = (strangers - self._seen) / passed
        self._since, self._seen = now, strangers
        if rate < RATE:
            return False
        goes_on = now - self._over < CALM
        self._pause = min(2 * self._pause, LONGEST) if goes_on else FIRST
        self.count += not goes_on
        self.on, self._until = True, now + self._pause
        return True


def narrowed(listens: Iterable[str], tokens: Iterable[str], key_expr: Callable[[str], KeyExpr]) -> frozenset[str]:
    """The key expressions that are left of `listens` where only the holders of `tokens` are listened to.

    One that crosses what some holder writes and does not include it stays as it is, and so does a key without wildcards.
    """
    written = {expression for token in tokens for expression in keys.written_by(token)}
    narrow: set[str] = set()
    for listened in listens:
        mine = key_expr(listened)
        crossing = {expression for expression in written if mine.intersects(expression)}
        whole = "*" in listened and all(mine.includes(expression) for expression in crossing)
        narrow |= crossing if whole else {listened}
    return frozenset(narrow)
