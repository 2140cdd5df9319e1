"""When a board without a world settles before its period is over: once all robots have reported a step. Pure.

Otherwise what is agreed would be up to a period old, however often robots report. A board expects a step of each robot that reported
one in the tick before. It settles when all of these have come, or when one robot has reported twice: then it is faster than the
others, or one of them has fallen silent. Robots may report shortly after each other. A tick that ended in the midst of such a series
is followed by one that ends where the longest pause was.
"""

from blackboard.process.roll_call import MAX_SOURCES

LONGER = 2.0  # a pause within a tick that is longer by this factor than the one before its first step is where ticks should end


class Steps:
    """The steps that robots have reported since the tick began. `now` is Unix time in seconds."""

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}  # robot -> the number of its newest step, by its own count
        #: Robot -> seconds without any step before its first one in this tick; in the order of arrival.
        self._pauses: dict[str, float] = {}
        self._again = False  # whether a robot has reported two steps in this tick
        self._expected: frozenset[str] = frozenset()  # robots of which a step is waited for
        self._heard_at = 0.0  # when the newest step arrived

    def on_step(self, robot: str, tick: int, now: float) -> None:
        """All reports of a robot's step have arrived; a step that is repeated does not count."""
        if self._newest.pop(robot, None) != tick:
            self._again |= robot in self._pauses
            self._pauses.setdefault(robot, now - self._heard_at)
            self._heard_at = now
        self._newest[robot] = tick
        if len(self._newest) > MAX_SOURCES:
            gone = next(iter(self._newest))
            del self._newest[gone]
            self._pauses.pop(gone, None)

    def begin_tick(self) -> None:
        """A tick begins, which settles all steps until now."""
        robots, pauses = list(self._pauses), list(self._pauses.values())
        longest = max(range(len(pauses)), key=pauses.__getitem__, default=0)
        end = longest if longest and pauses[longest] > LONGER * pauses[0] else len(robots)
        self._expected, self._pauses, self._again = frozenset(robots[:end]), {}, False

    @property
    def are_told(self) -> bool:
        """Whether steps have arrived, and no further one is waited for."""
        return bool(self._pauses) and (self._again or self._expected <= self._pauses.keys())

    def check(self) -> None:
        """AssertionError: it keeps more robots than it may."""
        assert self._pauses.keys() <= self._newest.keys()
        assert max(len(self._newest), len(self._expected)) <= MAX_SOURCES
