"""Whether a board without a world has reason to settle before a period is over: by the steps that robots told. Pure.

What is agreed would be up to a period old, however often robots step. So a board settles once everybody who told a step in the tick
before has told one again, or somebody two: that one steps more often than the others, or one of the others has fallen silent.
Robots may step shortly after each other. Where a tick ended in the midst of that, the next one ends at the longest pause.
"""

from __future__ import annotations

from blackboard.process.roll_call import MAX_SOURCES

LONGER = 2.0  # times the pause before a tick's first step, above which a pause within the tick is a better end


class Steps:
    """The steps that robots told since a tick began; `now` is Unix time in seconds."""

    def __init__(self) -> None:
        self._newest: dict[str, int] = {}  # robot -> its own count of the step that it told last
        self._pauses: dict[str, float] = {}  # robot -> seconds before its first step of this tick, in their order
        self._again = False  # whether a robot told two
        self._expected: frozenset[str] = frozenset()
        self._heard_at = 0.0  # when a step was told last

    def hear(self, robot: str, tick: int, now: float) -> None:
        """All that a robot says of one of its ticks is here; a tick that is told again does not count."""
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
        """A tick begins, in which all that was told until now is settled."""
        robots, pauses = list(self._pauses), list(self._pauses.values())
        longest = max(range(len(pauses)), key=pauses.__getitem__, default=0)
        end = longest if longest and pauses[longest] > LONGER * pauses[0] else len(robots)
        self._expected, self._pauses, self._again = frozenset(robots[:end]), {}, False

    @property
    def are_told(self) -> bool:
        """Whether there is something new, and nothing more to be expected soon."""
        return bool(self._pauses) and (self._again or self._expected <= self._pauses.keys())

    def check(self) -> None:
        """AssertionError: it is beyond its bounds."""
        assert self._pauses.keys() <= self._newest.keys()
        assert max(len(self._newest), len(self._expected)) <= MAX_SOURCES
