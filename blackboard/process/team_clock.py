"""Team time: by whose clock a process goes, and which tick it is. Pure.

A process follows the Clock of a world while the world's liveliness token is there. `ClockEvent` is the table of what may happen and
what that means; `python -m blackboard.process.team_clock` prints it.

A world holds its token before it sends a Clock. So a run whose Clocks came for more than `EARLY` seconds before that token is a
stranger's: for `WORLD_SILENT` seconds after the token, the first Clock of any other run is followed instead.

Who has sent a Clock cannot be known without keys. So the Clock that is followed goes on by its next tick (in real time by up to
`LOST` ticks), and another one is a **rival** until it is confirmed: heard again, not earlier than `CONFIRMED` seconds later and
without the followed one in between. A rival of another run must also wait until the followed run was silent for `WORLD_SILENT`
seconds, unless the world's token has come anew. So a single Clock moves no process, and a true clock is followed again soon after
a false one has stopped.
"""

import math
from collections.abc import Mapping
from enum import Enum

from blackboard.process import transitions
from blackboard.process.roster import Roster
from blackboard.process.transitions import Transition
from blackboard.wire.messages import Clock

WORLD_SILENT = 5.0  # seconds after its last Clock until a world without a token is no longer waited for
EARLY = 2.0  # seconds by which a Clock may come before the token of its world
CLOCKLESS = 10.0  # seconds that a world's token without a Clock is waited for
STOPPED = 60.0  # seconds after its last Clock until a world is given up though its token is there
CONFIRMED = 0.5  # seconds between the first and the second Clock that are heard of a rival
LOST = 10  # ticks in a row that may have been lost in real time
SLOWEST = 60.0  # seconds of team time that a tick may take
PARTS = 4  # ticks of a period where there is no world; most of them are left out


class Pace(Enum):
    """Whose time a process goes by."""

    FREE = "free"  # no world: ticks and stamps are Unix time
    WAITING = "waiting"  # a world is there without a Clock, or a Clock without a world
    LOCKSTEP = "lockstep"  # the world waits for everybody, team time stands still between two Clocks
    REALTIME = "realtime"  # the world paces, team time runs on between two Clocks


PACES: dict[str, Pace] = {pace.value: pace for pace in Pace}


class State(Enum):
    """What a process has heard of a world."""

    FREE = "free"  # nothing that is waited for
    CLOCK = "clock only"  # a Clock without a token, which is waited for
    TOKEN = "token only"  # a token without a Clock, which is waited for
    FOLLOWED = "followed"  # its token and its Clock; the pace is that of the Clock


class News(Enum):
    """What an event means for the process."""

    NOTHING = "nothing"
    REPEATED = "repeated"  # the Clock of this tick again: the world has not received every answer
    TICK = "tick"  # a tick begins
    RUN = "run"  # a tick begins, in another run: everything before is to be forgotten
    FREE = "free"  # the world is gone: everything is to be forgotten, stamps are Unix time from now on


class ClockEvent(Enum):
    """The table: what a Clock, or the time, is to a process."""

    STRAY = Transition("a Clock without a token", (State.FREE,), State.CLOCK)
    MORE = Transition("more Clocks without a token", (State.FREE, State.CLOCK, State.FOLLOWED), None)
    STRANGER = Transition("the Clock of a stranger", (State.FREE, State.TOKEN), None)
    FIRST = Transition("the first Clock", (State.FREE, State.TOKEN), State.FOLLOWED, News.RUN)
    NEXT = Transition("the next Clock", (State.FOLLOWED,), None, News.TICK)
    SAME = Transition("the same Clock", (State.FOLLOWED,), None, News.REPEATED)
    RIVAL = Transition("a rival", (State.FOLLOWED,), None)
    JUMP = Transition("a confirmed rival further on in the run", (State.FOLLOWED,), None, News.TICK)
    RUN = Transition("a confirmed rival of another run, or further back", (State.FOLLOWED,), None, News.RUN)
    TOKENLESS = Transition("no token in time", (State.CLOCK,), State.FREE)
    CLOCKLESS = Transition("no Clock in time", (State.TOKEN,), State.FREE)
    SILENT = Transition("no more Clocks in time", (State.FOLLOWED,), State.FREE, News.FREE)
    PERIOD = Transition("a period of Unix time is over, or a quarter with news", (State.FREE,), None, News.TICK)


class TeamClock:
    """Team time of one process. `look` is due at `changes_at`; `now` is Unix time in seconds."""

    def __init__(self, roster: Roster, period: float | None = None) -> None:
        """`period`: seconds from one tick to the next where there is no world, at most; None: such a process has no ticks then."""
        self.roster, self.period = roster, period
        self.followed: Clock | None = None  # the newest Clock of a world with a token; None: no world is followed
        self.tick = -1  # the newest that began: the world's count, or Unix time in quarters of a period
        self.heard_at = 0.0  # Unix seconds, when the Clock of this tick arrived first
        self._spoke_at = 0.0  # Unix seconds, when a Clock of the followed run arrived last
        #: the newest Clock that came without a world's token, and when the first one of its run came
        self._stray: tuple[Clock, float] | None = None
        self._stranger = "", 0.0  # a run that is not the world's, and until when that is believed
        self._token_due: float | None = None  # until when a token is waited for
        self._clock_due: float | None = None  # until when the Clock of a world that has a token is waited for
        self._has_waited = False  # whether that was in vain, so that a token alone is not waited for again
        self._token_seen = 0  # how often the world's token had come when its Clock was followed last
        # The newest, and when the first one arrived that it goes on from.
        self._rival: tuple[Clock, float] | None = None
        self._was_away = False  # whether no Clock could arrive when it was looked last

    @property
    def state(self) -> State:
        if self.followed is not None:
            return State.FOLLOWED
        if self._token_due is not None:
            return State.CLOCK
        return State.TOKEN if self.roster.world and not self._has_waited else State.FREE

    @property
    def pace(self) -> Pace:
        if self.followed is not None:
            return PACES[self.followed.mode]
        return Pace.FREE if self.state is State.FREE else Pace.WAITING

    @property
    def named(self) -> Mapping[str, list[str]] | None:
        """Sub-team -> the robots that take part, as the Clock names them in lockstep; None at any other pace."""
        return self.followed.robots if self.followed is not None and self.pace is Pace.LOCKSTEP else None

    @property
    def run(self) -> str:
        """The run of the world that is followed; empty where none is."""
        return "" if self.followed is None else self.followed.run

    @property
    def may_begin(self) -> bool:
        """Whether the next Clock may be that of another run: no world's token is held, or one has come since."""
        return not self.roster.holds_world() or self.roster.worlds > self._token_seen

    def hear_clock(self, clock: Clock, now: float) -> News:
        """Take a Clock. It is followed while a world's token is there, and kept until then; an older tick is ignored."""
        if self.roster.world:
            self._stray = self._token_due = None
        return self._enter(self._event_of(clock, now), now, clock)

    def look(self, now: float, *, ticks: bool = True, early: bool = False) -> News:
        """What has changed with the roster and the time; call it again until it is NOTHING.

        Without `ticks` no tick begins by Unix time: a process that hears more than it can settle begins one after a batch only.
        `early`: there is reason to begin one before a period is over.
        """
        if self._stray is not None and self.roster.world:
            clock, since = self._stray
            if self.followed is None and now - since > EARLY:
                self._stranger = clock.run, now + WORLD_SILENT
            return self.hear_clock(clock, now)
        if self.state is State.TOKEN and self._clock_due is None:
            self._clock_due = now + CLOCKLESS  # a token that comes and goes does not begin it anew
        if self._was_away and not self.roster.away:
            self._spoke_at = now
        self._was_away = self.roster.away
        while (event := self._event_at(now, ticks, early)) is not None:
            if (news := self._enter(event, now)) is not News.NOTHING:
                return news
        return News.NOTHING

    def changes_at(self, *, early: bool = False) -> float:
        """When time alone changes something; infinity if it does not. `early` as in `look`."""
        if self.followed is not None:
            return self._given_up_at()
        if self.pace is Pace.WAITING:
            due = (self._token_due, self._clock_due if self.roster.world else None)
            return min((at for at in due if at is not None), default=-math.inf)
        return math.inf if self.period is None else self._next(early) * self.period / PARTS

    def time(self, now: float) -> float:
        """Team time in seconds."""
        if self.followed is None:
            return now
        return self.followed.time + (now - self.heard_at if self.pace is Pace.REALTIME else 0.0)

    def check(self) -> None:
        """AssertionError: what holds between two events does not."""
        assert self.followed is None or self.tick == self.followed.tick
        assert self.followed is not None or self._rival is None
        assert self._token_due is None or (self.followed is None and self._stray is not None)

    # --- inside -------------------------------------------------------------------------------------------------------

    def _event_of(self, clock: Clock, now: float) -> ClockEvent:
        """What a Clock is to this process now."""
        followed = self.followed
        if not self.roster.world:
            return ClockEvent.STRAY if followed is None and self._stray is None else ClockEvent.MORE
        if followed is None:
            run, until = self._stranger
            return ClockEvent.STRANGER if clock.run == run and now < until else ClockEvent.FIRST
        if _goes_on(followed, clock):
            return ClockEvent.NEXT
        same = (clock.run, clock.tick, clock.time) == (followed.run, followed.tick, followed.time)
        return ClockEvent.SAME if same else self._doubted(clock, followed, now)

    def _doubted(self, clock: Clock, followed: Clock, now: float) -> ClockEvent:
        """What a Clock is that does not go on with the one that is followed."""
        confirmed = now - self._rival_since(clock, now) >= CONFIRMED
        if clock.run != followed.run:
            silent = confirmed and now - self._spoke_at >= WORLD_SILENT
            return ClockEvent.RUN if silent or self.roster.worlds > self._token_seen else ClockEvent.RIVAL
        if not confirmed:
            return ClockEvent.RIVAL
        return ClockEvent.JUMP if clock.tick > followed.tick and clock.time >= followed.time else ClockEvent.RUN

    def _event_at(self, now: float, ticks: bool, early: bool) -> ClockEvent | None:
        """What time alone has brought about; None: nothing."""
        if self._token_due is not None and now >= self._token_due:
            return ClockEvent.TOKENLESS
        if self.state is State.TOKEN and self._clock_due is not None and now >= self._clock_due:
            return ClockEvent.CLOCKLESS
        if self.followed is not None and now >= self._given_up_at():
            return ClockEvent.SILENT
        tick = self._unix_tick(now) if ticks and self.state is State.FREE else None
        return None if tick is None or self.tick <= tick < self._next(early) else ClockEvent.PERIOD

    def _enter(self, event: ClockEvent, now: float, clock: Clock | None = None) -> News:
        """Keep what an event brings, and return its news."""
        assert self.state in event.value.states, (self.state, event)
        match event:
            case ClockEvent.STRAY | ClockEvent.MORE if clock is not None:
                goes_on = self._stray is not None and self._stray[0].run == clock.run
                self._stray = clock, self._stray[1] if self._stray is not None and goes_on else now
                self._token_due = now + WORLD_SILENT if event is ClockEvent.STRAY else self._token_due
            case ClockEvent.FIRST | ClockEvent.NEXT | ClockEvent.JUMP | ClockEvent.RUN if clock is not None:
                self.followed, self.tick, self.heard_at, self._spoke_at = clock, clock.tick, now, now
                self._rival, self._clock_due, self._has_waited = None, None, False
                self._token_seen = self.roster.worlds
            case ClockEvent.RIVAL if clock is not None:
                self._rival = clock, self._rival_since(clock, now)
            case ClockEvent.SAME:
                self._spoke_at, self._rival = now, None
            case ClockEvent.TOKENLESS:
                self._token_due = None
            case ClockEvent.CLOCKLESS:
                self._has_waited = True
            case ClockEvent.SILENT:
                self.followed, self._rival, self.tick, self._has_waited = None, None, -1, self.roster.world
            case ClockEvent.PERIOD:
                self.tick = self._unix_tick(now) or 0
        news: News = event.value.news or News.NOTHING
        return news

    def _unix_tick(self, now: float) -> int | None:
        return None if self.period is None else int(PARTS * now / self.period)

    def _next(self, early: bool) -> int:
        """The first tick of Unix time that may begin; one before the newest may, too, because then the clock was set back."""
        return self.tick + (1 if early else PARTS)

    def _rival_since(self, clock: Clock, now: float) -> float:
        """When the first Clock came from which a rival goes on: now, if it is the first itself."""
        if self._rival is not None:
            before, since = self._rival
            if (before.run, before.tick) == (clock.run, clock.tick) or _goes_on(before, clock):
                return since
        return now

    def _given_up_at(self) -> float:
        if not self.roster.world:
            return self.heard_at + WORLD_SILENT
        return math.inf if self.roster.away else self._spoke_at + STOPPED


def _goes_on(before: Clock, clock: Clock) -> bool:
    """Whether a Clock is one that may come after another of the same run."""
    ticks, seconds = clock.tick - before.tick, clock.time - before.time
    most = 1 if before.mode == "lockstep" else LOST
    same = (clock.run, clock.mode) == (before.run, before.mode)
    return same and 0 < ticks <= most and 0 <= seconds <= SLOWEST * ticks


def text() -> str:
    return transitions.text(("state", "event", "then", "news"), State, ClockEvent)


if __name__ == "__main__":
    print(text())  # noqa: T201
