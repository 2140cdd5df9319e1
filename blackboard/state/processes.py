"""The processes of a team as an observer sees them: who is alive, how far it is, how fast, and what it refused. Pure."""

from collections import deque
from dataclasses import dataclass, field

from blackboard.wire.messages import Status

MAX_PROCESSES = 512  # of a team
WINDOW = 32  # ticks over which a rate is measured
SILENT = 5.0  # seconds without a word after which a process counts as silent
RECENT = 4  # of what one source gave, because some of it is newer than the moment that is settled


@dataclass
class Process:
    """A robot, a board or the world. Times are Unix seconds of arrival."""

    kind: str
    name: str
    sub_teams: set[str] = field(default_factory=set)
    tokens: set[str] = field(default_factory=set)  # that it holds
    expected: bool = False  # a scenario names it
    gone_at: float | None = None  # since when its last token is gone
    tick: int = -1
    time: float = 0.0  # team time of that tick, seconds
    heard_at: float = 0.0
    messages: int = 0
    bytes: int = 0
    status: Status | None = None
    believed: tuple[int, float] | None = None  # of a robot: tick and team time of the newest belief about it
    #: of a robot: team time (s) and speed (unit/s) of its newest ticks
    speeds: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=RECENT))
    _ticks: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))

    @property
    def alive(self) -> bool:
        """Whether it holds a liveliness token."""
        return bool(self.tokens)

    @property
    def speaks(self) -> bool:
        """Whether it is alive, and no board that follows another one of its sub-team."""
        return self.alive and not (self.status is not None and self.status.follows)

    def state(self, now: float) -> tuple[str, float | None]:
        """What it does: "alive", "silent" or "gone"; and for how many seconds the latter two, None where it was never heard."""
        if self.alive:
            silent = now - self.heard_at
            return ("silent", silent) if self.heard_at > 0 and silent > SILENT else ("alive", None)
        since = self.gone_at if self.gone_at is not None else self.heard_at
        return "gone", now - since if since > 0 else None

    def note_message(self, now: float, size: int) -> None:
        self.heard_at = now
        self.messages += 1
        self.bytes += size

    def finished(self, tick: int, time: float, now: float) -> None:
        """Note that the process has finished a tick; one that is repeated does not count."""
        if tick != self.tick:
            self._ticks.append(now)
        self.tick, self.time = tick, time

    def learn_speed(self, status: Status) -> None:
        """Take the speed of a robot's tick; one that is given again replaces the one before."""
        if self.speeds and self.speeds[-1][0] == status.time:
            self.speeds.pop()
        if status.speed is not None:
            self.speeds.append((status.time, status.speed))

    def speed_at(self, time: float) -> float | None:
        """The newest speed that is not later than a team time in seconds."""
        return next((speed for at, speed in reversed(self.speeds) if at <= time), None)

    def rate(self, now: float) -> float:
        """Ticks finished per second, over the last ones; it falls while nothing comes."""
        if len(self._ticks) < 2:
            return 0.0
        span = self._ticks[-1] - self._ticks[0]
        mean = span / (len(self._ticks) - 1)
        silent = now - self._ticks[-1]
        return len(self._ticks) / (span + silent) if silent > 2 * mean else (1.0 / mean if mean else 0.0)

    @property
    def refused(self) -> dict[str, int]:
        """Reason -> how many messages it refused for it."""
        return {} if self.status is None else self.status.refused
