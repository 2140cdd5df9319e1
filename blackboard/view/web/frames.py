"""The newest frames of a team, encoded once for all browsers: the newest one, and those of the last minutes. Pure."""

from __future__ import annotations

from collections import deque

from blackboard.view.fold import Fold, TeamFold
from blackboard.view.frame import frame

LEAST_GAP = 0.1  # seconds between two frames at least; of ticks that come faster the newest is shown
BEAT = 1.0  # seconds after which a frame is made although nothing was settled: ages grow, processes vanish
MAX_PAST = 32 << 20  # bytes of frames that are kept


class Frames:
    """Makes a frame where there is something new to see. `number` grows with each."""

    def __init__(self, fold: Fold, team: str, most_bytes: int = MAX_PAST) -> None:
        self._fold, self._team = fold, team
        self.newest = b""
        self.number = 0
        self.gap = LEAST_GAP  # seconds between two frames; the server makes it longer where frames are costly
        self._most_bytes = most_bytes
        self._past: deque[bytes] = deque()
        self._bytes = 0
        self._made_at = 0.0
        self._changes = -1
        self._moment: tuple[str, int] | None = None

    @property
    def team(self) -> TeamFold:
        """What is known of the team; nothing before it is heard of."""
        return self._fold.teams.get(self._team) or TeamFold(self._team)

    def look(self, now: float) -> bool:
        """Make a frame if one is due at `now`, Unix time in seconds; whether there is a new one."""
        team = self.team
        gap = now - self._made_at
        if gap < self.gap or (team.changes == self._changes and gap < max(BEAT, self.gap)):
            return False
        moment = team.moments.newest
        self.number += 1
        self.newest = frame(team, moment, self.number, now)
        self._made_at, self._changes = now, team.changes
        shown = None if moment is None else (moment.run, moment.tick)
        if shown is not None and shown != self._moment:
            self._moment = shown
            self._past.append(self.newest)
            self._bytes += len(self.newest)
            while self._bytes > self._most_bytes and len(self._past) > 1:
                self._bytes -= len(self._past.popleft())
        return True

    def past(self) -> bytes:
        """The frames of the last minutes, the oldest first, each behind its length in 4 bytes, little-endian."""
        return b"".join(part for one in self._past for part in (len(one).to_bytes(4, "little"), one))
