"""A machine as a table: what may happen in which of its states, and what follows. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from blackboard.process.columns import columns

S = TypeVar("S", bound=Enum)


@dataclass(frozen=True)
class Transition(Generic[S]):
    """What happens, the states in which it counts, the state that follows (None: the same), and what is new, if anything is."""

    text: str
    states: tuple[S, ...]
    then: S | None
    news: Any = None


def text(head: tuple[str, ...], states: Iterable[S], events: Iterable[Enum]) -> str:
    """The table of events, whose values are transitions, as text; `head` names as many columns as are shown."""
    rows = [
        (state.value, event.value.text, (event.value.then or state).value, getattr(event.value.news, "value", "-"))
        for state in states
        for event in events
        if state in event.value.states
    ]
    return "\n".join(columns([head, *(row[: len(head)] for row in rows)]))
