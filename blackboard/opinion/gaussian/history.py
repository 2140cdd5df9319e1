"""What a state was some ticks ago and what came since, so that it can be settled again with what was found out later."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

EVERY, KEPT = 5, 3  # ticks between two copies of the state, and how many are kept: ten to fifteen ticks

State = TypeVar("State")
News = TypeVar("News")


@dataclass(frozen=True)
class History(Generic[State, News]):
    """States, the oldest first, each with what came since and before the next one."""

    parts: tuple[tuple[State, tuple[News, ...]], ...] = ()

    def plus(self, state: Callable[[], State], news: News) -> History[State, News]:
        """With what comes now; `state` makes a copy of the state before it."""
        if not self.parts or len(self.parts[-1][1]) >= EVERY:
            return History((*self.parts[-KEPT + 1 :], (state(), (news,))))
        before, came = self.parts[-1]
        return History((*self.parts[:-1], (before, (*came, news))))

    def since(self) -> list[News]:
        """All that came since the oldest state."""
        return [news for _, came in self.parts for news in came]
