"""Hearing a team: by whose clock it goes, and what its boards say. A listener speaks nothing. Pure."""

from collections.abc import Callable
from dataclasses import dataclass

from blackboard.errors import Refused
from blackboard.process.intake import Intake, TooEarly
from blackboard.process.roster import Roster
from blackboard.process.team_clock import News, TeamClock
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Refusal
from blackboard.wire.types import Message


@dataclass(frozen=True)
class ClockNews:
    """What is new about the team clock, and the Clock that was heard; None: the roster or the time changed it."""

    news: News
    clock: Clock | None = None


#: Takes what is new, and when it came (Unix seconds); returns the envelopes to send. Raises Refused, or `TooEarly`.
Hear = Callable[[ClockNews | Message, float], list[Envelope]]


class Listener:
    """A service (`blackboard.process.service.Service`) that hands on what it may believe: the clock's news, and messages.

    What a board says is believed while the board holds its liveliness token, and waits for that token.
    """

    tokens: tuple[str, ...] = ()
    done = False

    def __init__(self, team: str, hear: Hear, *, sub_teams: tuple[str, ...] = ("*",), own: str | None = None) -> None:
        """Hear `sub_teams` of a team. `own`: a token of this process, by which it notices that it is cut off."""
        self.team, self.sub_teams = team, sub_teams
        self.intake = Intake()
        self.roster = Roster(own)
        self.clock = TeamClock(self.roster)
        self._hear = hear

    @property
    def listens(self) -> tuple[str, ...]:
        """The Clock, and what the boards of its sub-teams agree on."""
        agreed = (keys.AGREED.key(team=self.team, sub_team=s, subject="**") for s in self.sub_teams)
        return (keys.CLOCK.key(team=self.team), *agreed)

    @property
    def watches(self) -> tuple[str, ...]:
        """The token of the world, its own, by which it notices that the network is lost, and those of its boards."""
        own = () if self.roster.own is None else (self.roster.own,)
        boards = (keys.BOARD.key(team=self.team, sub_team=s, board="*") for s in self.sub_teams)
        return (keys.WORLD.key(team=self.team), *own, *boards)

    def record_link_counters(self, counters: dict[str, int]) -> None:
        self.intake.record_link_counters(counters)

    def receive(self, envelope: Envelope, now: float) -> list[Envelope]:
        out: list[Envelope] = []
        if envelope.kind in (Kind.ALIVE, Kind.GONE):
            self.roster.hear_token(envelope, now)
            if envelope.kind is Kind.ALIVE:
                out = self.intake.retry(lambda _, message: self._take(message, now))
        else:
            out = self.intake.on_envelope(envelope, lambda _, message: self._take(message, now), now)
        return out + self.wake(now)

    def wake(self, now: float) -> list[Envelope]:
        self.roster.forget(now)
        out: list[Envelope] = []
        while (news := self.clock.look(now)) is not News.NOTHING:
            out += self._hear(ClockNews(news), now)
        return out

    def wake_at(self, now: float) -> float:
        return min(self.clock.changes_at(), self.roster.changes_at())

    def check(self) -> None:
        """AssertionError: an invariant does not hold."""
        assert self.clock.followed is None or self.clock.tick == self.clock.followed.tick

    def _take(self, message: Message, now: float) -> list[Envelope]:
        if isinstance(message, Clock):
            news = self.clock.hear_clock(message, now)
            begins = news is News.RUN or not message.end  # the last Clock of a run begins no tick and asks for nothing
            return self._hear(ClockNews(news, message), now) if begins and news is not News.NOTHING else []
        if isinstance(message, Consensus | Refusal) and message.board not in self.roster.boards.get(
            message.sub_team, []
        ):
            who = f"board {message.board} holds no liveliness token in sub-team {message.sub_team}"
            raise TooEarly(Refused("unregistered", who))
        return self._hear(message, now)
