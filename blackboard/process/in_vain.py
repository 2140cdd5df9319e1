"""Who was waited for in vain is not waited for again before it has answered, each time for more ticks. Pure."""

from collections.abc import Mapping
from typing import NamedTuple

from blackboard.process.bounded import put

FACTOR = 4  # times as many ticks as the time before
MOST = 256  # ticks
MAX_NAMES = 1024  # that are remembered, the newest


class Debt(NamedTuple):
    """For how long a process that was waited for in vain is not waited for."""

    times: int  # how often it was waited for in vain
    left: int  # ticks that it must answer until it is waited for again; 0: it is
    newest: int  # tick that it has answered


class InVain:
    """Processes that were waited for in vain. A tick counts once, and ticks that are answered need not follow each other."""

    def __init__(self) -> None:
        self._debts: dict[str, Debt] = {}

    @property
    def names(self) -> set[str]:
        """The processes that are not waited for."""
        return {name for name, debt in self._debts.items() if debt.left}

    @property
    def debts(self) -> Mapping[str, Debt]:
        """Who was ever waited for in vain, and what is left of it."""
        return self._debts

    def __contains__(self, name: str) -> bool:
        """Whether a process is not waited for."""
        return name in self._debts and self._debts[name].left > 0

    def add(self, name: str, tick: int) -> int:
        """A process was waited for in vain in a tick: how many ticks it must answer now, of which this may be the first."""
        times = self._debts[name].times if name in self._debts else 0
        left: int = min(FACTOR**times, MOST)
        put(self._debts, name, Debt(times + 1, left, tick - 1), MAX_NAMES)
        return left

    def answered(self, name: str, tick: int) -> None:
        if name in self and tick > (debt := self._debts[name]).newest:
            self._debts[name] = Debt(debt.times, debt.left - 1, tick)

    def check(self) -> None:
        """AssertionError: it is beyond its bounds."""
        assert len(self._debts) <= MAX_NAMES
        assert all(debt.times and 0 <= debt.left <= MOST for debt in self._debts.values())
