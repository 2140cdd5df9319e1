"""The newest messages of each source about each subject, bounded. Pure."""

from collections import deque
from typing import Generic

from blackboard.errors import Refused
from blackboard.state.processes import RECENT
from blackboard.state.received import M, Received
from blackboard.wire.messages import Status

MAX_SUBJECTS = 256  # of a team
MAX_SOURCES = 64  # of a subject; sub-teams count as such
FORGET = 60.0  # seconds of team time after which an old belief is not shown any more; in which a source still counts as known


class Store(Generic[M]):
    """Reports by subject and robot, or consensuses by subject and sub-team: of each the newest few, the newest last."""

    def __init__(self) -> None:
        self._kept: dict[str, dict[str, deque[Received[M]]]] = {}

    @property
    def subjects(self) -> set[str]:
        """All subjects that something is kept about."""
        return set(self._kept)

    def keep(self, subject: str, source: str, received: Received[M]) -> None:
        """Keep what a source said about a subject, unless it is older than what is kept. Refused: "too-many"."""
        if subject not in self._kept and len(self._kept) >= MAX_SUBJECTS:
            raise Refused("too-many", f"{subject} would be one more than {MAX_SUBJECTS} subjects")
        by_source = self._kept.setdefault(subject, {})
        if source not in by_source and len(by_source) >= MAX_SOURCES:
            raise Refused("too-many", f"{source} would be one more than {MAX_SOURCES} sources on {subject}")
        recent = by_source.setdefault(source, deque(maxlen=RECENT))
        if not recent or received.message.time >= recent[-1].message.time:
            recent.append(received)

    def newest(self, subject: str, source: str) -> Received[M] | None:
        """The newest message of a source about a subject."""
        recent = self._kept.get(subject, {}).get(source)
        return recent[-1] if recent else None

    def withdraw(self, source: str, status: Status) -> None:
        """Drop what a source said before the tick of its status on subjects that the status lists no longer."""
        listed = {*status.subjects, *status.kept}
        for subject, by_source in self._kept.items():
            newest = self.newest(subject, source)
            if subject not in listed and newest is not None and newest.message.tick < status.tick:
                del by_source[source]

    def drop_before(self, oldest: float) -> None:
        """Drop what was stamped before `oldest`, team time in seconds."""
        kept = {
            subject: {source: recent for source, recent in by_source.items() if recent[-1].message.time >= oldest}
            for subject, by_source in self._kept.items()
        }
        self._kept = {subject: by_source for subject, by_source in kept.items() if by_source}

    def until(self, subject: str, time: float) -> dict[str, Received[M]]:
        """The newest of each source, by name, that is not later than a team time, and at most FORGET seconds older."""
        newest = dict[str, Received[M]]()
        for source, recent in sorted(self._kept.get(subject, {}).items()):
            fitting = [received for received in recent if time - FORGET <= received.message.time <= time]
            newest |= {source: fitting[-1]} if fitting else {}
        return newest

    def check(self) -> None:
        """AssertionError: it holds more than its bounds."""
        assert len(self._kept) <= MAX_SUBJECTS
        assert all(len(by_source) <= MAX_SOURCES for by_source in self._kept.values())
