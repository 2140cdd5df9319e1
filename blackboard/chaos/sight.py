"""What an observer of a team sees of its recovery: whether every board's newest beliefs rest on what each robot said just now. Pure.

A board's belief about an object is settled while the newest agreed one is at most `FRESH` seconds of team time old. One about a
robot must also contain what the robot itself said at most `FRESH` seconds ago.
"""

from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass

from blackboard.config import TeamSection
from blackboard.errors import Refused
from blackboard.wire import keys
from blackboard.wire.codec import open_envelope
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Status

FRESH = 2.0  # seconds of team time
STEADY = 2.0  # seconds without anything that is not settled, until a recovery counts

Pair = tuple[str, str]  # sub-team and subject


@dataclass(frozen=True)
class Look:
    """What was seen at one time."""

    at: float  # seconds, of the observer
    team_time: float
    missing: tuple[Pair, ...]  # those that are not settled
    of: int  # pairs that there are


class Sight:
    """Takes what an observer receives."""

    def __init__(self, team: TeamSection) -> None:
        self.team = team
        self.time, self.tick, self.clock_at = 0.0, -1, 0.0  # team time, and when the observer heard it
        self.tokens: set[str] = set()
        self.seen: Counter[str] = Counter()  # key's writer -> messages
        #: process -> its newest status, and how many of its messages had come when it came
        self.statuses: dict[str, tuple[Status, int]] = {}
        self._agreed: dict[Pair, Consensus] = {}

    def hear_envelope(self, envelope: Envelope, now: float) -> None:
        """Take what was received at a time (s)."""
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            (self.tokens.add if envelope.kind is Kind.ALIVE else self.tokens.discard)(envelope.key)
            return
        self.seen[keys.writer(envelope.key) or ""] += 1
        topic = keys.parse(envelope.key)
        if envelope.kind is not Kind.PUT or topic is None or topic[0] not in (keys.CLOCK, keys.AGREED, keys.STATUS):
            return
        with suppress(Refused):
            _, _, message = open_envelope(envelope)
            if isinstance(message, Clock):
                self.time, self.tick, self.clock_at = message.time, message.tick, now
            elif isinstance(message, Consensus):
                self._agreed[message.sub_team, message.subject] = message
            elif isinstance(message, Status):
                self.statuses[message.process] = message, self._heard_of(message, topic[1]["sub_team"])

    def _heard_of(self, status: Status, sub_team: str) -> int:
        """How many messages of a robot, or of the one board of a sub-team, have come."""
        team = self.team.name
        mine = [f"{team}/{sub_team}/" if status.kind == "board" else f"{team}//{status.process}"]
        subs = self.team.of(status.process) if status.kind == "robot" else [sub_team]
        return sum(self.seen[who] for who in (*mine, *(f"{team}/{s}/{status.process}" for s in subs)))

    def look(self, now: float, away: Collection[str] = ()) -> Look:
        """What is settled now; `away` names robots and boards of which nothing is expected.

        Nor is anything expected about the robots of a sub-team whose boards are all away, because the exchange goes through them.
        """
        time = self.time + max(0.0, now - self.clock_at)  # it goes on while the observer hears no Clock
        pairs = self._expected(frozenset(away))
        missing = tuple(pair for pair in pairs if not self._is_settled(pair, time))
        return Look(now, time, missing, len(pairs))

    def holds(self, name: str) -> bool:
        """Whether a process of this name holds a token in all its sub-teams."""
        mine = [token for token in self.tokens if token.rsplit("/", 1)[-1] == name]
        return len(mine) >= max(1, len(self.team.of(name)))

    def _expected(self, away: frozenset[str]) -> list[Pair]:
        there = [s for s in self.team.sub_teams if not away.issuperset(self.team.boards_of(s))]
        robots = [r for r in self.team.robots if r not in away and set(self.team.of(r)) & set(there)]
        objects = sorted({subject for _, subject in self._agreed if subject.startswith("object/")})
        subjects = [*(f"robot/{robot}" for robot in robots), *(objects if robots else [])]
        return [(sub_team, subject) for sub_team in there for subject in subjects]

    def _is_settled(self, pair: Pair, time: float) -> bool:
        agreed = self._agreed.get(pair)
        if agreed is None or time - agreed.time > FRESH:
            return False
        kind, _, name = pair[1].partition("/")
        return kind != "robot" or time - agreed.ancestors.get(name, -FRESH) <= FRESH


def recovery(looks: Sequence[Look], begin: float, end: float) -> float | None:
    """Seconds from the `end` of a trouble that began at `begin` until all was settled, for at least `STEADY` seconds.

    0 where nothing was missing, or no longer at the end; None: never.
    """
    last = end
    for look in looks:
        if look.at < begin:
            continue
        if look.missing:
            last = max(last, look.at)
        elif look.at - last >= STEADY:
            return last - end
    return None


def settled(looks: Sequence[Look], begin: float, end: float) -> float:
    """The mean share of the pairs that were settled from `begin` to `end`; 1 where nothing was observed."""
    shares = [1 - len(look.missing) / max(1, look.of) for look in looks if begin <= look.at <= end]
    return sum(shares) / len(shares) if shares else 1.0
