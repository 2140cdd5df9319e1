"""Team time: by whose clock a process goes, and which tick it is. Pure.

A process follows the `Clock` of a world while the world's liveliness token is there. A Clock that comes without that token
is kept and followed as soon as the token appears; the first such Clock makes a process that has no world wait for the token,
for `WORLD_SILENT` seconds. So somebody who publishes a Clock and leaves delays nobody for longer. When the token of the world is
gone and the Clock that is followed is older than `WORLD_SILENT`, the process goes by Unix time again. A token without any Clock is
waited for `CLOCKLESS` seconds at most, and one whose Clock has stopped `STOPPED` seconds.

A world holds its token before it sends a Clock. So a run whose Clocks came for more than `EARLY` seconds before that token is somebody
else's: for `WORLD_SILENT` seconds after the token, the first Clock of any other run is followed instead.

Who has sent a Clock cannot be known without keys. So the Clock that is followed goes on by its next tick (in real time by up to
`LOST` ticks), and another one is a **rival** until it is confirmed: heard again, not earlier than `CONFIRMED` seconds later and
without the followed one in between. A rival of another run must also wait until the followed run was silent for `WORLD_SILENT`
seconds, unless the world's token has come anew. So a single Clock moves nobody, and a true clock is followed again soon after
a false one has stopped.
"""

from __future__ import annotations

import math
from enum import Enum

from blackboard.process.roster import Roster
from blackboard.wire.messages import Clock

WORLD_SILENT = 5.0  # seconds after its last Clock until a world without a token is no longer waited for
EARLY = 2.0  # seconds by which a Clock may come before the token of its world
CLOCKLESS = 10.0  # seconds that a world's token without a Clock is waited for
STOPPED = 60.0  # seconds after its last Clock until a world is given up though its token is there
CONFIRMED = 0.5  # seconds between the first and the second Clock that are heard of a rival
LOST = 10  # ticks in a row that may have been lost in real time
SLOWEST = 60.0  # seconds of team time that a tick may take


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
        self._spoke_at = 0.0  # Unix seconds, when a Clock of the followed run arrived last
        self._unannounced: Clock | None = None  # the newest Clock that came without a world's token
        self._unannounced_since = 0.0  # Unix seconds, when the first Clock of its run came
        self._stranger, self._stranger_until = "", 0.0  # a run that is not the world's, and until when that is believed
        self._token_due: float | None = None  # until when that token is waited for
        self._clock_due: float | None = None  # until when the Clock of a world that has a token is waited for
        self._has_waited = False  # whether that was in vain, so that a token alone is not waited for again
        self._token_seen = 0  # how often the world's token had come when its Clock was followed last
        self._rival: Clock | None = None  # the newest Clock that does not go on with the followed one
        self._rival_since = 0.0  # Unix seconds, when the first of these arrived
        self._was_away = False  # whether no Clock could arrive when it was looked last

    @property
    def pace(self) -> Pace:
        if self.followed is not None:
            return Pace.LOCKSTEP if self.followed.mode == "lockstep" else Pace.REALTIME
        waits = (self.roster.world and not self._has_waited) or self._token_due is not None
        return Pace.WAITING if waits else Pace.FREE

    def hear(self, clock: Clock, now: float) -> News:
        """Take a Clock. It is followed while a world's token is there, and kept until then; an older tick is ignored."""
        if not self.roster.world:
            if self.followed is None and self._unannounced is None:
                self._token_due = now + WORLD_SILENT
            if self._unannounced is None or self._unannounced.run != clock.run:
                self._unannounced_since = now
            self._unannounced = clock
            return News.NOTHING
        self._unannounced = self._token_due = None
        if self.followed is None:
            strange = clock.run == self._stranger and now < self._stranger_until
            return News.NOTHING if strange else self._follow(clock, now, News.RUN)
        if self._goes_on(self.followed, clock):
            return self._follow(clock, now, News.TICK)
        if (clock.run, clock.tick, clock.time) == (self.followed.run, self.tick, self.followed.time):
            self._spoke_at, self._rival = now, None
            return News.REPEATED
        return self._doubt(clock, self.followed, now)

    def look(self, now: float, *, ticks: bool = True) -> News:
        """What has changed with the roster and the time; call it again until it is NOTHING.

        Without `ticks` no tick begins by Unix time: a process that hears more than it can settle begins one after a batch only.
        """
        if self._unannounced is not None and self.roster.world:
            if self.followed is None and now - self._unannounced_since > EARLY:
                self._stranger, self._stranger_until = self._unannounced.run, now + WORLD_SILENT
            return self.hear(self._unannounced, now)
        if self._token_due is not None and now >= self._token_due:
            self._token_due = None
        self._wait_for_the_first(now)
        if self._was_away and not self.roster.away:
            self._spoke_at = now
        self._was_away = self.roster.away
        if self.followed is not None and now >= self._given_up_at():
            self.followed, self._rival, self.tick, self._has_waited = None, None, -1, self.roster.world
            return News.FREE
        if (
            ticks
            and self.pace is Pace.FREE
            and self.period is not None
            and (tick := int(now / self.period)) != self.tick
        ):
            self.tick = tick
            return News.TICK
        return News.NOTHING

    def changes_at(self) -> float:
        """When time alone changes something; infinity if it does not."""
        if self.followed is not None:
            return self._given_up_at()
        if self.pace is Pace.WAITING:
            due = (self._token_due, self._clock_due if self.roster.world else None)
            return min((at for at in due if at is not None), default=-math.inf)
        return math.inf if self.period is None else (self.tick + 1) * self.period

    def time(self, now: float) -> float:
        """Team time in seconds."""
        if self.followed is None:
            return now
        return self.followed.time + (now - self.heard_at if self.pace is Pace.REALTIME else 0.0)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _follow(self, clock: Clock, now: float, news: News) -> News:
        self.followed, self.tick, self.heard_at, self._spoke_at = clock, clock.tick, now, now
        self._rival, self._clock_due, self._has_waited = None, None, False
        self._token_seen = self.roster.worlds
        return news

    @staticmethod
    def _goes_on(before: Clock, clock: Clock) -> bool:
        """Whether a Clock is one that may come after another of the same run."""
        ticks, seconds = clock.tick - before.tick, clock.time - before.time
        most = 1 if before.mode == "lockstep" else LOST
        same = (clock.run, clock.mode) == (before.run, before.mode)
        return same and 0 < ticks <= most and 0 <= seconds <= SLOWEST * ticks

    def _doubt(self, clock: Clock, followed: Clock, now: float) -> News:
        """A Clock that does not go on with the followed one: believe it if it is confirmed, else remember it."""
        rival, self._rival = self._rival, clock
        goes_on = rival is not None and (
            (rival.run, rival.tick) == (clock.run, clock.tick) or self._goes_on(rival, clock)
        )
        if not goes_on:
            self._rival_since = now
        confirmed = goes_on and now - self._rival_since >= CONFIRMED
        if clock.run == followed.run:
            ahead = clock.tick > followed.tick and clock.time >= followed.time
            return self._follow(clock, now, News.TICK if ahead else News.RUN) if confirmed else News.NOTHING
        if self.roster.worlds > self._token_seen or (confirmed and now - self._spoke_at >= WORLD_SILENT):
            return self._follow(clock, now, News.RUN)
        return News.NOTHING

    def _wait_for_the_first(self, now: float) -> None:
        """Count down how long a world's token without a Clock is waited for; a token that comes and goes does not begin it anew."""
        if self.followed is None and self.roster.world and not self._has_waited:
            if self._clock_due is None:
                self._clock_due = now + CLOCKLESS
            self._has_waited = now >= self._clock_due

    def _given_up_at(self) -> float:
        if not self.roster.world:
            return self.heard_at + WORLD_SILENT
        return math.inf if self.roster.away else self._spoke_at + STOPPED
