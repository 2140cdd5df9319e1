"""Who only hears a team: what is handed on, and that nothing is said."""

from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.process.listener import ClockNews, Listener
from blackboard.process.team_clock import WORLD_SILENT, News
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus
from blackboard.wire.types import Message
from tests.wire.envelopes import consensus, put, token

NOW = 1_000_000.0
AGREED = consensus(gaussian(Grid((5, 5)), (2, 2), 1.0))


class Ear:
    """A listener of all sub-teams, and what it handed on."""

    def __init__(self) -> None:
        self.heard: list[ClockNews | Message] = []
        self.listener = Listener("t", self.hear)

    def hear(self, event: ClockNews | Message, now: float) -> list[Envelope]:
        self.heard.append(event)
        return []

    def tell(self, *envelopes: Envelope) -> None:
        for envelope in envelopes:
            assert self.listener.receive(envelope, NOW) == []
            self.listener.check()


def test_it_holds_no_token_and_says_nothing() -> None:
    ear = Ear()
    assert (ear.listener.tokens, ear.listener.wake(NOW + 99.0)) == ((), [])
    assert ear.listener.listens == ("cop/t/world/clock", "cop/t/*/agreed/**")
    assert ear.listener.watches == ("cop/t/world/alive", "cop/t/*/board/*")


def test_it_hears_the_boards_of_all_sub_teams_that_hold_their_token() -> None:
    ear = Ear()
    other = AGREED.model_copy(update={"sub_team": "b", "board": "late"})
    ear.tell(token(keys.BOARD, "a"), put(AGREED), put(other))
    assert ear.heard == [AGREED]
    ear.tell(token(keys.BOARD, "late", sub_team="b"))
    assert ear.heard == [AGREED, other]
    ear.tell(token(keys.BOARD, "a", kind=Kind.GONE))
    ear.listener.wake(NOW + 1.0)
    ear.tell(put(AGREED))
    assert len(ear.heard) == 2


def test_it_hands_on_the_news_of_the_clock_with_the_clock() -> None:
    ear = Ear()
    clocks = [Clock(run="x", tick=tick, time=tick, mode="lockstep") for tick in range(2)]
    ear.tell(token(keys.WORLD), *map(put, clocks), put(clocks[1]), token(keys.WORLD, kind=Kind.GONE))
    news = [News.RUN, News.TICK, News.REPEATED]
    assert ear.heard == [ClockNews(kind, clock) for kind, clock in zip(news, [*clocks, clocks[1]], strict=True)]
    due = ear.listener.wake_at(NOW)
    assert NOW < due <= NOW + WORLD_SILENT
    ear.listener.wake(NOW + WORLD_SILENT + 1.0)
    assert ear.heard[3:] == [ClockNews(News.FREE)]


def test_who_comes_for_the_last_clock_of_a_run_learns_of_the_run_alone() -> None:
    ear = Ear()
    last = Clock(run="x", tick=9, time=9.0, mode="lockstep", end=True)
    ear.tell(token(keys.WORLD), put(last), put(last))
    assert ear.heard == [ClockNews(News.RUN, last)]


def test_what_cannot_be_read_is_counted() -> None:
    ear = Ear()
    ear.tell(token(keys.BOARD, "a"), Envelope(put(AGREED).key, b"\xc1"))
    assert ear.heard == []
    assert ear.listener.intake.refused.total() == 1
    assert isinstance(AGREED, Consensus)
