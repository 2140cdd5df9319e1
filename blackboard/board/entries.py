"""What a board keeps until it is replaced: the newest of each source about each subject, bounded and fair. Pure.

Where there is no room, the source that says most gives way to one that says less. So a source that invents subjects loses
its own, and what a robot reports of itself, and what a board settled itself, always has room.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from blackboard.errors import Refused
from blackboard.opinion.believed import MAX_SOURCES, MAX_SUBJECTS
from blackboard.opinion.provenance import Opinion

MAX_HELD = 256 << 20  # bytes of all beliefs in one of a board's two tables; each entry has up to two

Source = TypeVar("Source", str, tuple[str, str])  # a robot; or a sub-team and one of its boards


@dataclass(frozen=True)
class Entry:
    """The newest report of one source about one subject, or the newest consensus of one sub-team's board."""

    tick: int
    time: float
    opinions: tuple[Opinion, ...]
    existence: float | None = None  # of a consensus on a track: the probability that there is such a thing


class Entries(Generic[Source]):
    """Entries by subject and source."""

    def __init__(self, cells: int, own: Source | None = None) -> None:
        """`cells` of one belief decide how many entries are kept; `own` is the source that always has room, if any."""
        self._table: dict[str, dict[Source, Entry]] = {}
        self._most = max(MAX_SUBJECTS, MAX_HELD // (16 * cells))
        self._count = 0
        self._own: Source | None = own

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._table))

    def of(self, subject: str, source: Source) -> Entry | None:
        """What is kept of a source about a subject."""
        return self._table.get(subject, {}).get(source)

    def sources(self) -> set[Source]:
        """Everybody of whom something is kept."""
        return {source for entries in self._table.values() for source in entries}

    def keep(self, subject: str, source: Source, entry: Entry) -> None:
        """Keep an entry unless a newer one of the same source is kept.

        Refused: "too-many", where the table is full and no other source holds more entries than this one.
        """
        known = self._table.get(subject, {}).get(source)
        if known is None:
            self._make_room(subject, source)
            self._count += 1
        elif entry.time < known.time:
            return
        self._table.setdefault(subject, {})[source] = entry

    def withdraw(self, source: Source, tick: int, subjects: Collection[str]) -> None:
        """Drop what a source said before `tick` on subjects that it no longer lists."""
        for subject, entries in list(self._table.items()):
            if subject not in subjects and source in entries and entries[source].tick < tick:
                self._drop(subject, source)

    def young(self, subject: str, now: float, max_age: float) -> dict[Source, Entry]:
        """The entries on a subject that are young enough, by source."""
        return {source: entry for source, entry in self._table.get(subject, {}).items() if entry.time >= now - max_age}

    def usable(self, subject: str, now: float, max_age: float) -> tuple[dict[Source, Entry], dict[Source, float]]:
        """The entries on a subject that are young enough; the others are forgotten, and returned once as source -> age (s)."""
        entries, young = self._table.get(subject, {}), self.young(subject, now, max_age)
        silent = {source: now - entries[source].time for source in sorted(entries) if source not in young}
        for source in silent:
            self._drop(subject, source)
        return young, silent

    def check(self) -> None:
        """AssertionError: there are more entries than are counted, or than there may be."""
        assert self._count == sum(map(len, self._table.values())) <= self._most
        assert len(self._table) <= MAX_SUBJECTS
        assert all(0 < len(entries) <= MAX_SOURCES for entries in self._table.values())

    # --- room ---------------------------------------------------------------------------------------------------------

    def _drop(self, subject: str, source: Source) -> None:
        del self._table[subject][source]
        self._count -= 1
        if not self._table[subject]:
            del self._table[subject]

    def _is_safe(self, subject: str, source: Source) -> bool:
        return source == self._own or subject == f"robot/{source}"

    def _make_room(self, subject: str, source: Source) -> None:
        here = self._table.get(subject, {})
        said = Counter(one for entries in self._table.values() for one in entries) if self._is_full(subject) else {}
        while self._is_full(subject):
            if len(here) >= MAX_SOURCES:
                oldest = [(said[one], subject, [one]) for one in here]
            elif not here and len(self._table) >= MAX_SUBJECTS:  # of a subject the least that any of its sources says
                oldest = [(min(said[one] for one in at), name, list(at)) for name, at in self._table.items()]
            else:
                oldest = [(said[one], name, [one]) for name, at in self._table.items() for one in at]
            oldest = [option for option in oldest if not any(self._is_safe(option[1], one) for one in option[2])]
            most, loser, sources = max(oldest, default=(0, "", []))
            if not oldest or not (self._is_safe(subject, source) or most > said[source] + 1):
                raise Refused(
                    "too-many",
                    f"{subject} of {source}: there is room for {MAX_SUBJECTS} subjects of {MAX_SOURCES} sources",
                )
            for one in sources:
                self._drop(loser, one)
                said[one] -= 1

    def _is_full(self, subject: str) -> bool:
        here = self._table.get(subject)
        return self._count >= self._most or len(self._table if here is None else here) >= (
            MAX_SUBJECTS if here is None else MAX_SOURCES
        )
