"""What the page shows of a team: the newest frame, those of moments that are over, and a line of each for charts. Pure."""

import json
from collections import deque
from dataclasses import dataclass

from blackboard.state.fold import Fold
from blackboard.state.team import TeamFold
from blackboard.view.frame import frame, line, slim

LEAST_GAP = 0.1  # seconds between two frames at least; of ticks that come faster the newest is shown
BEAT = 1.0  # seconds after which a frame is made although nothing was settled: ages grow, processes vanish
MAX_CHOSEN = 64  # subjects for which a newest frame is kept: no more than browsers


@dataclass(frozen=True)
class Past:
    """A moment that is over: its line for charts and its processes, both as JSON, its pace, and when it was settled (Unix seconds)."""

    run: str
    tick: int
    at: float
    mode: str
    line: bytes
    processes: bytes


class Frames:
    """Makes a frame where there is something new to see. `number` grows with each.

    Each browser has chosen a subject, of which its frame has all beliefs; browsers with the same one share its bytes.
    """

    def __init__(self, fold: Fold, team: str) -> None:
        self._fold, self._team = fold, team
        self.number = 0
        self.gap = LEAST_GAP  # seconds between two frames; the server makes it longer where frames are costly
        self.made = 0  # lines of this run, also those that are kept no longer
        self._past: deque[Past] = deque()
        self._newest: dict[str, bytes] = {}  # by the chosen subject
        self._now = 0.0  # of the newest frame
        self._made_at = 0.0
        self._changes = -1

    @property
    def team(self) -> TeamFold:
        """What is known of the team; nothing before it is heard of."""
        return self._fold.team(self._team)

    def remember(self, now: float) -> None:
        """Keep a line of every moment that is new. Call it after each look at what has arrived."""
        team = self.team
        newest = team.moments.newest
        if newest is None or (self._past and self._past[-1].run != newest.run):
            self._past.clear()
            self.made = 0
        for moment in team.moments.since(self._past[-1].tick if self._past else -1):
            lines = [json.dumps(part, separators=(",", ":")).encode() for part in (line(moment), slim(team, now))]
            self._past.append(Past(moment.run, moment.tick, moment.at, team.mode, *lines))
            self.made += 1
        while len(self._past) > len(team.moments):
            self._past.popleft()

    def look(self, clock: float, now: float) -> bool:
        """Whether a new frame is due at `clock`, seconds that pass evenly; `now` is the team's Unix time."""
        team = self.team
        gap = clock - self._made_at
        if gap < self.gap or (team.changes == self._changes and gap < max(BEAT, self.gap)):
            return False
        self.number += 1
        self._newest.clear()
        self._now, self._made_at, self._changes = now, clock, team.changes
        return True

    def newest(self, chosen: str) -> bytes:
        """The newest frame for browsers that have chosen a subject; made when the first of them asks."""
        newest = self._newest.get(chosen)
        if newest is None:
            newest = frame(self.team, self.team.moments.newest, self.number, self._now, chosen)
            if len(self._newest) < MAX_CHOSEN:
                self._newest[chosen] = newest
        return newest

    def at(self, run: str, tick: int, chosen: str) -> bytes | None:
        """The frame of a moment, with the processes of then; None where it is no longer kept."""
        past = next((seen for seen in reversed(self._past) if seen.tick == tick and seen.run == run), None)
        moment = None if past is None else self.team.moments.at(tick)
        if past is None or moment is None or moment.run != run:
            return None
        return frame(self.team, moment, self.number, past.at, chosen, json.loads(past.processes), past.mode)

    def past(self, begin: int) -> bytes:
        """The lines that are kept from number `begin` on, the number of the first of them, and how many were made: as JSON."""
        first = max(begin, self.made - len(self._past))
        lines = list(self._past)[len(self._past) - (self.made - first) :] if first < self.made else []
        head = f'{{"first":{first},"made":{self.made},"lines":['.encode()
        return head + b",".join(seen.line for seen in lines) + b"]}"
