"""Roll call: has everything that a source lists for a tick arrived? Pure, and bounded: the oldest is forgotten first."""

from collections.abc import Collection
from typing import Generic, TypeVar

from blackboard.process.bounded import put

MAX_SOURCES = 256
MAX_SUBJECTS = 512  # of one source

Source = TypeVar("Source")  # a sender: a robot, (sub-team, board), ...


class RollCall(Generic[Source]):
    """The newest tick of what each source sent about each subject, and the list that each source sent last."""

    def __init__(self) -> None:
        self._lists: dict[Source, tuple[int, frozenset[str]]] = {}
        self._heard: dict[Source, dict[str, int]] = {}

    def record(self, source: Source, subject: str, tick: int) -> bool:
        """Record what a source sent about a subject. True if it is newer than what this source sent before."""
        subjects = self._heard.get(source, {})
        before = subjects.get(subject, -1)
        put(subjects, subject, max(tick, before), MAX_SUBJECTS)
        put(self._heard, source, subjects, MAX_SOURCES)
        return tick > before

    def record_list(self, source: Source, tick: int, subjects: Collection[str]) -> bool:
        """Record the list of all that a source sent in a tick. True if it is of another tick than its list before.

        The list that arrived last counts, because a source that was started again may count its ticks anew.
        """
        before = self._lists.get(source)
        put(self._lists, source, (tick, frozenset(subjects)), MAX_SOURCES)
        return before is None or tick != before[0]

    def list_of(self, source: Source) -> tuple[int, frozenset[str]] | None:
        """The newest tick that a source lists, and the subjects; None if it never listed any."""
        return self._lists.get(source)

    def answered(self, source: Source) -> int | None:
        """The tick that a source listed last, if everything on its list is here."""
        listed = self._lists.get(source)
        return listed[0] if listed is not None and self.arrived(source, *listed) else None

    def arrived(self, source: Source, tick: int, subjects: Collection[str]) -> bool:
        """Whether what `source` sent about each of these subjects in `tick`, or something newer, is here."""
        known = self._heard.get(source, {})
        return all(known.get(subject, -1) >= tick for subject in subjects)

    def check(self) -> None:
        """AssertionError: it is beyond its bounds."""
        assert max(len(self._lists), len(self._heard)) <= MAX_SOURCES
        assert all(len(subjects) <= MAX_SUBJECTS for subjects in self._heard.values())

    def complete(self, source: Source, tick: int) -> bool:
        """Whether a source has listed exactly this tick, and everything on its list is here."""
        return self.answered(source) == tick
