"""Which of a sub-team's boards publishes: one leads, the others settle the same and keep what they would publish. Pure.

The others publish their status alone, which says that they follow, and keep what they settled until the status of the one that leads
says that it has published that. So where one of them takes over, nothing is lost, and nothing is older than what was published before.

`Fact` is the table of when a board's part changes; `python -m blackboard.board.lead` prints it. Of two that lead, as after a freeze
or a cut network, the one that took over last has the better claim, because the other was found silent. Else the board that has
settled for longest has it, and among equals, as at the beginning of a run, the one whose name sorts first. A board that was frozen is
as one that starts: what reaches it first may be old.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from blackboard.process import transitions
from blackboard.process.roster import Roster
from blackboard.process.transitions import Transition
from blackboard.wire.envelope import Envelope
from blackboard.wire.messages import Status

HOLD = 1.5  # seconds that the first status of another board is waited for; statuses come once a second
FROZEN = 2.5  # seconds between two looks after which this board may have been taken for dead
MAX_KEPT = 256  # phases of ticks that are kept while no board is known to have published them
MAX_KEPT_BYTES = 8 << 20
MAX_TERM = (1 << 53) - 1
PHASES = ("consensus", "agreed")


class BoardRole(Enum):
    """What a board is among the boards of its sub-team."""

    UNKNOWN = "unknown"  # it has just started, or was frozen
    LEADS = "leads"
    FOLLOWS = "follows"


OTHERS = (BoardRole.UNKNOWN, BoardRole.FOLLOWS)


class Fact(Enum):
    """The table: the first fact that holds and counts decides."""

    FROZEN = Transition("it was frozen", tuple(BoardRole), BoardRole.UNKNOWN)
    OUTRANKED = Transition("another leads with a better claim", (BoardRole.LEADS,), BoardRole.FOLLOWS)
    STUCK = Transition("the leader publishes nothing", OTHERS, BoardRole.LEADS)
    LED = Transition("another leads", OTHERS, BoardRole.FOLLOWS)
    AWAITED = Transition("another has said nothing yet", OTHERS, BoardRole.UNKNOWN)
    FIRST = Transition("its own claim is the best", OTHERS, BoardRole.LEADS)
    SECOND = Transition("another has a better claim", OTHERS, BoardRole.FOLLOWS)


@dataclass(frozen=True)
class Publication:
    """What a board has to say at the end of a phase of a tick: envelopes, then the status that lists them."""

    tick: int
    phase: str
    time: float  # team time, seconds
    envelopes: tuple[Envelope, ...]
    status: Status


@dataclass(frozen=True)
class PartClaim:
    """What another board's newest status says of its part."""

    follows: bool
    term: int
    since: float  # team time in seconds since which it settles; infinity where it has not begun
    done: tuple[int, str]  # tick and phase
    progress: float  # Unix seconds when `done` changed last


class Lead:
    """The part of one board, from the tokens on its roster and the statuses of the other boards. All `now` are Unix seconds."""

    def __init__(self, roster: Roster, sub_team: str, board: str, silent: float) -> None:
        """`silent` is how many seconds a leader that is alive may publish nothing while this board settles."""
        self.roster, self.sub_team, self.board, self.silent = roster, sub_team, board, silent
        self._looked: float | None = None
        self.begin(None)

    def begin(self, since: float | None) -> None:
        """Everything begins anew, at a team time in seconds (None: it is not known yet)."""
        self.role = BoardRole.UNKNOWN
        self.term = 0  # how often the lead was taken over, as far as the newest leader knew
        self.since = since
        self._highest = -1  # term of a leader that was heard
        self._floor = -math.inf  # team time of what a leader published last
        self._others: dict[str, PartClaim] = {}
        self._unknown: dict[str, float] = {}  # boards that were not heard yet, and until when they are waited for
        self._kept: deque[tuple[float, Publication]] = deque()  # and when it was settled
        self._asks = True

    @property
    def leads(self) -> bool:
        """Whether it publishes; a board that does not know yet keeps what it settles, too."""
        return self.role is BoardRole.LEADS

    # --- events -------------------------------------------------------------------------------------------------------

    def hear_status(self, status: Status, now: float, newest: float, *, any_tick: bool) -> bool:
        """Take the status of another board of the sub-team. True if that should hear this board's own at once.

        `newest`: the latest team time (seconds) that it can have settled; a later one is of another run. `any_tick`: ticks are each
        board's own count, so that whatever it published stands for all that was kept until now.
        """
        before = self._others.get(status.process)
        since, done = math.inf if status.since is None else status.since, (status.tick, status.phase)
        progress = now if before is None or before.done != done else before.progress
        self._others[status.process] = PartClaim(status.follows, status.term, since, done, progress)
        self._unknown.pop(status.process, None)
        if not status.follows:
            self._highest = max(self._highest, status.term)
            if status.phase in PHASES and status.time <= newest and not self.leads:
                self._floor = max(self._floor, status.time)
                self._forget(status, any_tick)
        return before is None or before.since != since

    def look(self, now: float) -> bool:
        """Decide anew. True if the others should hear of it: the part has changed, or there is a board that does not know it."""
        before, frozen = self.role, self._looked is not None and now - self._looked > FROZEN
        self._looked = now
        if self.roster.away:
            return False
        others = [board for board in self.roster.boards.get(self.sub_team, []) if board != self.board]
        if frozen and others:
            self._enter(Fact.FROZEN)
            self.since, self._others, self._unknown = None, {}, {}
        new = self._keep_only(others, now) if others or self._others or self._unknown else []
        if not self.leads or self._others:  # a leader gives way to another one alone
            self._enter(next((fact for fact in self._facts(now) if self.role in fact.value.states), None))
        asks, self._asks = self._asks or bool(new), False
        changed = self.role is not before
        return (changed and before is not BoardRole.UNKNOWN) or (bool(others) and (asks or changed))

    def changes_at(self) -> float:
        """When time alone changes something; infinity if it does not."""
        if self.leads or self.roster.away:
            return math.inf
        heard_out = max(self._unknown.values(), default=math.inf) if self.role is BoardRole.UNKNOWN else math.inf
        return min(self._stuck_at(), heard_out)

    def may_say(self, time: float) -> bool:
        """Whether this board publishes what it settled at a team time in seconds: it leads, and nothing later was published."""
        return self.leads and time >= self._floor

    def keep(self, said: Publication, now: float) -> None:
        """Keep what is not published; the oldest goes where it is too much."""
        self._kept.append((now, said))
        while len(self._kept) > MAX_KEPT or self._kept_bytes > MAX_KEPT_BYTES:
            self._kept.popleft()

    def release(self) -> list[Publication]:
        """What was kept and not published by any board, the oldest first: this board is to publish it."""
        released = [said for _, said in self._kept if said.time >= self._floor]
        self._kept.clear()
        return released

    @property
    def leader(self) -> str | None:
        """Who leads, as far as this board knows."""
        if self.leads:
            return self.board
        return min(self._leaders())[2] if self._leaders() else None

    def check(self) -> None:
        """AssertionError: what holds between two events does not."""
        assert len(self._kept) <= MAX_KEPT
        assert self._kept_bytes <= MAX_KEPT_BYTES
        assert not self._others.keys() & self._unknown.keys()
        assert self.board not in self._others

    # --- inside -------------------------------------------------------------------------------------------------------

    def _keep_only(self, others: list[str], now: float) -> list[str]:
        """Drop the boards that are gone, and wait for the new ones, which are returned."""
        self._others = {board: claim for board, claim in self._others.items() if board in others}
        new = [board for board in others if board not in self._others and board not in self._unknown]
        self._unknown = {board: until for board, until in self._unknown.items() if board in others}
        self._unknown |= dict.fromkeys(new, now + HOLD)
        return new

    def _leaders(self) -> list[tuple[int, float, str]]:
        return [(-claim.term, claim.since, name) for name, claim in self._others.items() if not claim.follows]

    def _facts(self, now: float) -> Iterator[Fact]:
        """What holds now, in the order of `Fact`."""
        since = math.inf if self.since is None else self.since
        leaders = self._leaders()
        if leaders and (-self.term, since, self.board) > min(leaders):
            yield Fact.OUTRANKED
        if now >= self._stuck_at():
            yield Fact.STUCK
        if leaders:
            yield Fact.LED
        if any(now < until for until in self._unknown.values()):
            yield Fact.AWAITED
        is_first = all((since, self.board) < (claim.since, name) for name, claim in self._others.items())
        yield Fact.FIRST if is_first else Fact.SECOND

    def _enter(self, fact: Fact | None) -> None:
        if fact is not None:
            self.role = fact.value.then or self.role
            if self.leads:
                self.term = min(self._highest + 1, MAX_TERM)

    def _stuck_at(self) -> float:
        """When a leader that is alive and publishes nothing is given up."""
        if not self._kept:
            return math.inf
        waited = [self._others[name].progress for _, _, name in self._leaders()]
        return max([self._kept[0][0], *waited]) + self.silent

    def _forget(self, status: Status, any_tick: bool) -> None:
        """Drop what the leader has published."""
        done = status.tick, PHASES.index(status.phase)
        left = [(at, said) for at, said in self._kept if not any_tick and (said.tick, PHASES.index(said.phase)) > done]
        self._kept = deque(left)

    @property
    def _kept_bytes(self) -> int:
        return sum(len(envelope.payload) for _, said in self._kept for envelope in said.envelopes)


def text() -> str:
    return transitions.text(("role", "fact", "then"), BoardRole, Fact)


if __name__ == "__main__":
    print(text())  # noqa: T201
