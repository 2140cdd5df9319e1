"""Team time: by whose clock a process goes, and which tick it is. Pure.

A process follows the `Clock` of a world while the world's liveliness token is there. A Clock that comes without that token
is kept and followed as soon as the token appears; the first such Clock makes a process that has no world wait for the token,
for `WORLD_SILENT` seconds. So somebody who publishes a Clock and leaves delays nobody for longer. When the token of the world is
gone and the Clock that is followed is older than `WORLD_SILENT`, the process goes by Unix time again.
"""

from __future__ import annotations

import math
from enum import Enum

from blackboard.process.roster import Roster
from blackboard.wire.messages import Clock

WORLD_SILENT = 5.0  # seconds after its last Clock until a world without a token is no longer waited for


class Pace(Enum):
    """By what a process goes."""

    FREE = "free"  # no world: ticks and stamps are Unix time
    WAITING = "waiting"  # a world is there without a Clock, or a Clock without a world
    LOCKSTEP = "lockstep"  # the world waits for everybody, team time stands still between two Clocks
    REALTIME = "realtime"  # the world paces, team time runs on between two Clocks


class News(Enum):
    """What a Clock, or the time, means for the process."""

    NOTHING = "nothing"
    REPEATED = "repeated"  # the Clock of this tick again: the world has not received every answer
    TICK = "tick"  # a tick begins
    RUN = "run"  # a tick begins, in another run: everything before is to be forgotten
    FREE = "free"  # the world is gone: everything is to be forgotten, stamps are Unix time from now on


class TeamClock:
    """Team time of one process. `look` is due at `changes_at`; `now` is Unix time in seconds."""

    def __init__(self, roster: Roster, period: float | None = None) -> None:
        """`period` is the length of a tick in seconds where there is no world; None: such a process has no ticks then."""
        self.roster, self.period = roster, period
        self.followed: Clock | None = None  # the newest Clock of a world with a token; None: no world is followed
        self.tick = -1  # the newest that began: the world's count, or Unix time in periods
        self.heard_at = 0.0  # Unix seconds, when the Clock of this tick arrived first
        self._unannounced: Clock | None = None  # the newest Clock that came without a world's token
        self._token_due: float | None = None  # until when that token is waited for

    @property
    def pace(self) -> Pace:
        if self.followed is None:
            return Pace.FREE if not self.roster.world and self._token_due is None else Pace.WAITING
        return Pace.LOCKSTEP if self.followed.mode == "lockstep" else Pace.REALTIME

    def hear(self, clock: Clock, now: float) -> News:
        """Take a Clock. It is followed while a world's token is there, and kept until then; an older tick is ignored."""
        if not self.roster.world:
            if self.followed is None and self._unannounced is None:
                self._token_due = now + WORLD_SILENT
            self._unannounced = clock
            return News.NOTHING
        self._unannounced = self._token_due = None
        news = News.TICK
        if self.followed is None or clock.run != self.followed.run:
            news = News.RUN
        elif clock.tick <= self.tick:
            return News.REPEATED if clock.tick == self.tick else News.NOTHING
        self.followed, self.tick, self.heard_at = clock, clock.tick, now
        return news

    def look(self, now: float) -> News:
        """What has changed with the roster and the time; call it again until it is NOTHING."""
        if self._unannounced is not None and self.roster.world:
            return self.hear(self._unannounced, now)
        if self._token_due is not None and now >= self._token_due:
            self._token_due = None
        if self.followed is not None and now >= self._given_up_at():
            self.followed, self.tick = None, -1
            return News.FREE
        if self.pace is Pace.FREE and self.period is not None and (tick := int(now / self.period)) != self.tick:
            self.tick = tick
            return News.TICK
        return News.NOTHING

    def changes_at(self) -> float:
        """When time alone changes something; infinity if it does not."""
        if self.followed is not None:
            return self._given_up_at()
        if self._token_due is not None:
            return self._token_due
        if self.pace is not Pace.FREE or self.period is None:
            return math.inf
        return (self.tick + 1) * self.period

    def time(self, now: float) -> float:
        """Team time in seconds."""
        if self.followed is None:
            return now
        return self.followed.time + (now - self.heard_at if self.pace is Pace.REALTIME else 0.0)

    def _given_up_at(self) -> float:
        return math.inf if self.roster.world else self.heard_at + WORLD_SILENT
