"""What goes wrong in a night, as data: each fault has a beginning, an end, and what it does meanwhile. Pure.

Times are seconds of virtual time since the night began. A process is named `world`, `robot/r1`, `board/a/board-a` or `guest/g1`. What a
stage does at any moment follows from the faults that are active then, so that any of them can be left out or made shorter.

Long, because the list of all faults is one table.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, ClassVar

from blackboard.wire.envelope import Envelope

STEP = 0.5  # seconds between two changes of a clock that drifts


@dataclass(frozen=True)
class Way:
    """An envelope on its way from one process to another."""

    sender: str
    receiver: str
    envelope: Envelope


@dataclass(frozen=True)
class Fault:
    """From `begin` until before `end`, in seconds of the night."""

    begin: float
    end: float

    #: Seconds after its end within which the team is well again.
    recovery: ClassVar[float] = 5.0

    def moments(self) -> Iterator[float]:
        """When what it does changes."""
        yield from (self.begin, self.end)

    def is_active(self, at: float) -> bool:
        return self.begin <= at < self.end

    def stops(self, process: str, at: float) -> bool:
        """Whether a process does not run."""
        return False

    def renews(self, process: str) -> bool:
        """Whether a process is started again at its beginning and at its end."""
        return False

    def freezes(self, process: str, at: float) -> bool:
        """Whether a process neither hears nor does anything; what comes waits."""
        return False

    def hides(self, process: str, at: float) -> bool:
        """Whether the others do not see the tokens of a process."""
        return False

    def parts(self, one: str, other: str) -> bool:
        """Whether two processes have no connection; of one with itself, whether it is cut off from its router."""
        return False

    def ahead(self, process: str, at: float) -> float:
        """Seconds by which the clock of a process is ahead, also before and after."""
        return 0.0

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        """The delays in seconds of the copies that arrive of an envelope; none of them: it is lost."""
        return delays

    def astray(self, way: Way, chance: Random) -> Sequence[float]:
        """The delays in seconds of further copies, which need not keep the order of their key."""
        return ()

    def adds(self) -> str | None:
        """A process that runs only meanwhile."""
        return None

    def lies(self) -> dict[str, str]:
        """Which robots lie, by their processes, and which lie of the catalogue each tells."""
        return {}

    def silences(self, process: str) -> str:
        """Which part of its readings a robot does not get; empty: it gets all."""
        return ""


# --- messages ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OnWay(Fault):
    """What goes wrong with messages from, or to, a process; of all with "*"."""

    who: str

    def concerns(self, way: Way) -> bool:
        return self.who in ("*", way.sender, way.receiver)


@dataclass(frozen=True)
class Lost(OnWay):
    """A share of the messages does not arrive."""

    share: float

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        return () if self.concerns(way) and chance.random() < self.share else delays


@dataclass(frozen=True)
class Late(OnWay):
    """Messages take up to so many seconds more, each key its own, so that they overtake those on other keys."""

    seconds: float

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        more = self.seconds * chance.random() if self.concerns(way) else 0.0
        return [delay + more for delay in delays]


@dataclass(frozen=True)
class Doubled(OnWay):
    """A share of the messages arrives a second time, up to so many seconds later."""

    share: float
    seconds: float

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        if not delays or not self.concerns(way) or chance.random() >= self.share:
            return delays
        return [*delays, delays[-1] + self.seconds * chance.random()]


@dataclass(frozen=True)
class Stale(OnWay):
    """A share of the messages comes again by another way, up to so many seconds later: also after newer ones on its key."""

    share: float
    seconds: float

    def astray(self, way: Way, chance: Random) -> Sequence[float]:
        return (self.seconds * chance.random(),) if self.concerns(way) and chance.random() < self.share else ()


@dataclass(frozen=True)
class TooLarge(OnWay):
    """Messages of more than so many bytes do not arrive."""

    size: int

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        return () if self.concerns(way) and len(way.envelope.payload) > self.size else delays


@dataclass(frozen=True)
class OneWay(Fault):
    """Nothing that one process sends reaches another one."""

    sender: str
    receiver: str

    def copies(self, way: Way, delays: Sequence[float], chance: Random) -> Sequence[float]:
        return () if (way.sender, way.receiver) == (self.sender, self.receiver) else delays


# --- connections -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parted(Fault):
    """Groups of processes without a connection between them; a process in no group belongs to the first. One alone has lost its router."""

    recovery = 8.0

    groups: tuple[tuple[str, ...], ...]

    def group(self, process: str) -> int:
        return next((n for n, group in enumerate(self.groups) if process in group), 0)

    def parts(self, one: str, other: str) -> bool:
        if one == other:
            return self.groups[self.group(one)] == (one,)
        return self.group(one) != self.group(other)


@dataclass(frozen=True)
class Routerless(Fault):
    """The router is gone: no process has a connection."""

    recovery = 8.0

    def parts(self, one: str, other: str) -> bool:
        return True


@dataclass(frozen=True)
class Flapping(Fault):
    """The tokens of a process vanish, and come back after half of each period, in seconds."""

    recovery = 8.0

    who: str
    period: float

    def moments(self) -> Iterator[float]:
        yield from _steps(self.begin, self.end, self.period / 2)

    def hides(self, process: str, at: float) -> bool:
        return process == self.who and math.floor((at - self.begin) / (self.period / 2) + 1e-9) % 2 == 0


# --- processes ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Killed(Fault):
    """A process is killed, and started again with nothing: at the end, or sooner with a token that is seen at the end."""

    who: str
    unseen: float = 0.0  # seconds

    def moments(self) -> Iterator[float]:
        yield from (self.begin, max(self.begin, self.end - self.unseen), self.end)

    def stops(self, process: str, at: float) -> bool:
        return process == self.who and at < self.end - self.unseen

    def hides(self, process: str, at: float) -> bool:
        return process == self.who and at >= self.end - self.unseen


@dataclass(frozen=True)
class WorldKilled(Killed):
    """A world is killed, and another run of it begins at the end."""

    recovery = 12.0

    who: str = "world"
    unseen: float = 0.0


@dataclass(frozen=True)
class Frozen(Fault):
    """A process is stopped, and goes on at the end with all that has come."""

    who: str

    def freezes(self, process: str, at: float) -> bool:
        return process == self.who


@dataclass(frozen=True)
class Slow(Fault):
    """A process has time only for an instant in each period, in seconds; then it takes all that has come."""

    who: str
    period: float

    def moments(self) -> Iterator[float]:
        for at in _steps(self.begin, self.end, self.period):
            yield from (at, min(self.end, at + self.period / 10))

    def freezes(self, process: str, at: float) -> bool:
        return process == self.who and (at - self.begin) % self.period >= self.period / 10 - 1e-9


@dataclass(frozen=True)
class ClockOff(Fault):
    """A process is started again with a clock that is ahead by so many seconds and gains `rate` in each; at the end with a right one.

    A clock never jumps while its process runs (`blackboard.process.clock`).
    """

    who: str
    seconds: float
    rate: float = 0.0

    @property
    def recovery(self) -> float:  # type: ignore[override]
        return WorldKilled.recovery if self.who == "world" else 8.0

    def moments(self) -> Iterator[float]:
        yield from _steps(self.begin, self.end, STEP) if self.rate else (self.begin, self.end)

    def renews(self, process: str) -> bool:
        return process == self.who

    def ahead(self, process: str, at: float) -> float:
        return self.seconds + self.rate * (at - self.begin) if process == self.who and self.is_active(at) else 0.0


@dataclass(frozen=True)
class Suspended(Frozen):
    """The machine of a process sleeps: its clock stands meanwhile, and is behind from then on.

    How far others are ahead of it is found by their statuses, one a second; until then it refuses what they say.
    """

    recovery = 12.0

    def moments(self) -> Iterator[float]:
        yield from _steps(self.begin, self.end, STEP)

    def ahead(self, process: str, at: float) -> float:
        return -max(0.0, min(at, self.end) - self.begin) if process == self.who else 0.0


#: What a sensor that is silent leaves out of a robot's readings, and what is there instead.
PARTS: dict[str, Any] = {"odometry": None, "compass": None, "sightings": ()}


@dataclass(frozen=True)
class Silent(Fault):
    """A sensor of a robot measures nothing."""

    process: str
    part: str

    def silences(self, process: str) -> str:
        return self.part if process == self.process else ""


# --- people ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SecondWorld(Fault):
    """Somebody starts another world for the same team, and stops it."""

    recovery = 12.0

    def adds(self) -> str:
        return "world/2"


@dataclass(frozen=True)
class AnotherBoard(Fault):
    """Somebody starts another board of a sub-team, and stops it; one that hangs holds its token and says nothing."""

    sub_team: str
    name: str
    hangs: bool = False

    def adds(self) -> str:
        return f"board/{self.sub_team}/{self.name}"

    def freezes(self, process: str, at: float) -> bool:
        return self.hangs and process == self.adds()


@dataclass(frozen=True)
class Crowd(Fault):
    """At its beginning so many strangers, who hold no token, speak to a sub-team, each under a name of its own."""

    sub_team: str
    count: int

    @property
    def names(self) -> list[str]:
        return [f"x{number}" for number in range(self.count)]


@dataclass(frozen=True)
class FullDisk(Fault):
    """The disk of the recorder takes nothing."""


@dataclass(frozen=True)
class Lies(Fault):
    """A robot tells a lie of the catalogue (`blackboard.chaos.lies`); a `partner` tells it, too."""

    who: str
    lie: str
    partner: str | None = None

    def lies(self) -> dict[str, str]:
        return dict.fromkeys([self.who, *([self.partner] if self.partner else [])], self.lie)


@dataclass(frozen=True)
class LyingGuest(Fault):
    """A robot that the scenario does not name joins a sub-team, and lies."""

    recovery = 8.0

    sub_team: str
    name: str
    lie: str

    def adds(self) -> str:
        return f"robot/{self.name}"

    def lies(self) -> dict[str, str]:
        return {self.adds(): self.lie}


def _steps(begin: float, end: float, step: float) -> Iterator[float]:
    at = begin
    while at < end:
        yield at
        at += step
    yield end
