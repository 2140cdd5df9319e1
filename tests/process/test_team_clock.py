"""Team time: whose clock is followed, and when it no longer is."""

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.roster import Roster
from blackboard.process.team_clock import CLOCKLESS, STOPPED, WORLD_SILENT, News, Pace, TeamClock
from blackboard.wire import keys
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock

NOW = 1_000_000.0
OWN = keys.BOARD.key(team="t", sub_team="a", board="a")
WORLD = keys.WORLD.key(team="t")


def clock_message(tick: int, mode: Any = "lockstep", run: str = "one") -> Clock:
    return Clock(run=run, tick=tick, time=min(0.2 * tick, 1e12), mode=mode)


def clock_of(tick: int, run: str = "one", seconds: float | None = None) -> dict[str, Any]:
    """The fields of a Clock but its mode."""
    return {"run": run, "tick": tick, "time": min(0.2 * tick, 1e12) if seconds is None else seconds}


def world(clock: TeamClock, kind: Kind, now: float = NOW) -> None:
    clock.roster.hear_token(Envelope(WORLD, kind=kind), now)


def following(tick: int, mode: Any = "lockstep") -> TeamClock:
    """A team clock that follows a world, whose newest Clock came at `NOW`."""
    clock = TeamClock(Roster(grace=0.5), period=0.5)
    world(clock, Kind.ALIVE)
    assert clock.hear_clock(clock_message(tick, mode), NOW) is News.RUN
    return clock


def news(clock: TeamClock, now: float) -> list[News]:
    """All that is new at a time."""
    clock.roster.forget(now)
    heard: list[News] = []
    while (event := clock.look(now)) is not News.NOTHING:
        heard.append(event)
    return heard


def test_without_a_world_ticks_are_quarters_of_a_period_of_unix_time() -> None:
    clock = TeamClock(Roster(), period=0.5)
    assert clock.pace is Pace.FREE
    assert clock.changes_at() <= NOW
    assert news(clock, NOW) == [News.TICK]
    assert (clock.tick, clock.time(NOW), clock.changes_at()) == (8 * NOW, NOW, NOW + 0.5)
    assert news(clock, NOW + 0.4) == []
    assert news(clock, NOW + 2.0) == [News.TICK]
    assert clock.tick == 8 * NOW + 16


def test_without_a_world_a_tick_begins_early_where_there_is_reason() -> None:
    clock = TeamClock(Roster(), period=0.5)
    assert news(clock, NOW) == [News.TICK]
    assert clock.changes_at(early=True) == NOW + 0.125
    assert clock.look(NOW + 0.1, early=True) is News.NOTHING
    assert clock.look(NOW + 0.2, early=True, ticks=False) is News.NOTHING
    assert clock.look(NOW + 0.2, early=True) is News.TICK
    assert (clock.tick, clock.changes_at()) == (8 * NOW + 1, NOW + 0.625)


@given(st.sampled_from((0.1, 0.2, 0.5, 1.0)), st.lists(st.tuples(st.floats(0.0, 0.7), st.booleans()), max_size=60))
def test_each_tick_of_unix_time_begins_once_four_in_a_period_at_most(
    period: float, waits: list[tuple[float, bool]]
) -> None:
    """A process that is woken at any times, also when it asked for it, with and without reason to begin a tick early."""
    clock, now, began = TeamClock(Roster(), period), NOW, list[tuple[int, float]]()
    for wait, early in waits:
        now = min(now + wait, max(now, clock.changes_at(early=early)))
        due = clock.changes_at(early=early)
        news = clock.look(now, early=early)
        if abs(now - due) > 1e-9:
            assert (news is News.TICK) == (now > due)
        if news is News.TICK:
            began.append((clock.tick, now))
        assert clock.look(now, early=early) is News.NOTHING
    ticks = [tick for tick, _ in began]
    assert all(before < other for before, other in pairwise(ticks))
    for tick, at in began:
        assert tick * period / 4 - 1e-9 <= at <= (tick + 1) * period / 4 + 1e-9
        assert len([1 for _, other in began if at <= other < at + period - 1e-9]) <= 5  # a part at each end
    for (_, at), (_, after) in pairwise(began):
        assert after - at <= period + 1e-9


def test_a_clock_that_is_set_back_begins_a_tick_at_once() -> None:
    clock = TeamClock(Roster(), period=0.5)
    assert news(clock, NOW) == [News.TICK]
    assert news(clock, NOW - 100.0) == [News.TICK]
    assert clock.tick == 8 * (NOW - 100.0)


def test_without_a_period_there_are_no_ticks_without_a_world() -> None:
    clock = TeamClock(Roster())
    assert news(clock, NOW) == []
    assert (clock.tick, clock.changes_at()) == (-1, math.inf)


def test_a_world_without_a_clock_is_waited_for() -> None:
    clock = TeamClock(Roster(), period=0.5)
    world(clock, Kind.ALIVE)
    assert clock.pace is Pace.WAITING
    assert news(clock, NOW) == []
    assert clock.changes_at() == NOW + CLOCKLESS
    world(clock, Kind.GONE, NOW + 1)
    assert news(clock, NOW + 2) == [News.TICK]  # nothing was said by a world's time: nothing is forgotten
    assert clock.pace is Pace.FREE


def test_a_token_without_a_clock_stops_nobody_for_long() -> None:
    clock = TeamClock(Roster(grace=0.5), period=0.5)
    world(clock, Kind.ALIVE)
    assert news(clock, NOW) == []
    assert news(clock, NOW + CLOCKLESS) == [News.TICK]
    for i in range(100):  # nor does one that comes and goes
        world(clock, Kind.GONE, NOW + 20 + i)
        news(clock, NOW + 20.9 + i)
        world(clock, Kind.ALIVE, NOW + 20.9 + i)
        assert clock.pace is Pace.FREE
    assert clock.hear_clock(clock_message(7), NOW + 200.0) is News.RUN
    assert clock.pace is Pace.LOCKSTEP


def test_a_token_whose_clock_has_stopped_is_given_up() -> None:
    clock = following(3)
    assert clock.changes_at() == NOW + STOPPED
    assert news(clock, NOW + STOPPED) == [News.FREE, News.TICK]
    assert clock.pace is Pace.FREE
    assert clock.hear_clock(clock_message(4), NOW + 100.0) is News.RUN


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
@pytest.mark.parametrize(
    "false",
    [clock_of(2**53 - 1), clock_of(30), clock_of(5, "other"), clock_of(2**53 - 1, "other"), clock_of(6, seconds=1e9)],
)
def test_one_clock_moves_nobody_whoever_sends_it(false: dict[str, Any], mode: str) -> None:
    clock = TeamClock(Roster(), period=0.5)
    world(clock, Kind.ALIVE)
    for tick in range(6):
        clock.hear_clock(clock_message(tick, mode), NOW + 0.2 * tick)
    said = Clock(mode=mode, **false)  # type: ignore[arg-type]
    assert clock.hear_clock(said, NOW + 1.1) is News.NOTHING
    assert clock.hear_clock(clock_message(6, mode), NOW + 1.2) is News.TICK
    assert clock.hear_clock(said, NOW + 1.3) is News.NOTHING
    assert clock.hear_clock(clock_message(6, mode), NOW + 1.9) is News.REPEATED
    assert clock.hear_clock(said, NOW + 2.1) is News.NOTHING
    assert (clock.tick, clock.time(NOW + 1.2)) == (6, pytest.approx(1.2))


@pytest.mark.parametrize("jump", [8, 2**53 - 20])
def test_a_jump_is_believed_with_the_second_clock_and_the_true_one_again_when_it_stops(jump: int) -> None:
    clock = following(5)
    assert [clock.hear_clock(clock_message(jump), NOW + 0.2 * i) for i in range(4)] == [News.NOTHING] * 3 + [News.TICK]
    assert clock.tick == jump
    assert clock.hear_clock(clock_message(5), NOW + 2.0) is News.NOTHING  # the true world repeats its tick
    assert clock.hear_clock(clock_message(5), NOW + 4.0) is News.RUN
    assert clock.tick == 5


def test_a_new_run_is_believed_at_once_only_with_a_new_token() -> None:
    clock = following(5)
    assert clock.hear_clock(clock_message(0, run="two"), NOW + 1.0) is News.NOTHING
    world(clock, Kind.GONE, NOW + 1.1)
    world(clock, Kind.ALIVE, NOW + 1.2)
    assert clock.hear_clock(clock_message(0, run="two"), NOW + 1.3) is News.RUN
    assert clock.hear_clock(clock_message(9, run="one"), NOW + 1.4) is News.NOTHING


def test_a_run_that_has_fallen_silent_is_left_for_one_that_is_heard() -> None:
    clock = following(5)
    assert [clock.hear_clock(clock_message(i, run="two"), NOW + 1.0 + i) for i in range(4)] == [News.NOTHING] * 4
    assert clock.hear_clock(clock_message(4, run="two"), NOW + WORLD_SILENT) is News.RUN


def test_one_clock_of_another_run_is_not_enough_even_in_silence() -> None:
    clock = following(5)
    assert clock.hear_clock(clock_message(0, run="two"), NOW + 30.0) is News.NOTHING
    assert clock.hear_clock(clock_message(6), NOW + 31.0) is News.TICK


@pytest.mark.parametrize(("mode", "pace", "runs"), [("lockstep", Pace.LOCKSTEP, 0.0), ("realtime", Pace.REALTIME, 1.5)])
def test_a_world_gives_the_ticks_and_the_time(mode: str, pace: Pace, runs: float) -> None:
    clock = TeamClock(Roster(), period=0.5)
    world(clock, Kind.ALIVE)
    assert clock.hear_clock(clock_message(3, mode), NOW) is News.RUN
    assert (clock.pace, clock.tick) == (pace, 3)
    assert clock.time(NOW + 1.5) == pytest.approx(0.6 + runs)
    assert clock.hear_clock(clock_message(3, mode), NOW + 1.0) is News.REPEATED
    assert clock.time(NOW + 1.5) == pytest.approx(0.6 + runs)  # from its first arrival on
    assert clock.hear_clock(clock_message(2, mode), NOW + 1.0) is News.NOTHING
    assert clock.hear_clock(clock_message(4, mode), NOW + 2.0) is News.TICK
    assert news(clock, NOW + 2.0 + STOPPED - 0.1) == []  # a world that is there may take its time
    assert clock.changes_at() == NOW + 2.0 + STOPPED


def test_a_clock_without_a_world_is_not_followed() -> None:
    clock = TeamClock(Roster(), period=0.5)
    for seconds in range(12):  # however often it is said: its token is waited for once
        assert clock.hear_clock(clock_message(seconds), NOW + seconds) is News.NOTHING
        waits = seconds < WORLD_SILENT
        assert news(clock, NOW + seconds) == ([] if waits else [News.TICK])
        assert clock.pace is (Pace.WAITING if waits else Pace.FREE)
        assert clock.changes_at() == NOW + (WORLD_SILENT if waits else seconds + 0.5)
        assert clock.time(NOW + seconds) == NOW + seconds


def test_a_clock_that_comes_before_its_token_is_followed_with_it() -> None:
    clock = TeamClock(Roster(), period=0.5)
    clock.hear_clock(clock_message(3), NOW)
    world(clock, Kind.ALIVE)
    assert news(clock, NOW + 0.1) == [News.RUN]
    assert (clock.pace, clock.tick, clock.heard_at) == (Pace.LOCKSTEP, 3, NOW + 0.1)


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_world_that_is_gone_and_silent_is_given_up(mode: str) -> None:
    clock = following(3, mode)
    world(clock, Kind.GONE, NOW + 1.0)
    assert news(clock, NOW + 1.5) == []
    assert clock.changes_at() == NOW + WORLD_SILENT
    assert news(clock, NOW + WORLD_SILENT - 0.01) == []
    assert clock.pace is not Pace.FREE
    assert news(clock, NOW + WORLD_SILENT) == [News.FREE, News.TICK]
    assert (clock.pace, clock.time(NOW + 6.0)) == (Pace.FREE, NOW + 6.0)
    world(clock, Kind.ALIVE, NOW + 7.0)
    assert clock.pace is Pace.WAITING
    # Also of the same run: what was said since is Unix time.
    assert clock.hear_clock(clock_message(3, mode), NOW + 7.0) is News.RUN


def test_the_clocks_of_a_world_that_is_gone_do_not_keep_it() -> None:
    clock = following(3)
    world(clock, Kind.GONE, NOW)
    clock.roster.forget(NOW + 0.5)
    assert clock.hear_clock(clock_message(4), NOW + 4.0) is News.NOTHING
    assert news(clock, NOW + WORLD_SILENT) == [News.FREE, News.TICK]


def test_a_world_that_is_back_in_time_goes_on() -> None:
    clock = following(3)
    world(clock, Kind.GONE, NOW + 1.0)
    assert news(clock, NOW + 2.0) == []
    world(clock, Kind.ALIVE, NOW + 4.0)
    assert news(clock, NOW + 50.0) == []
    assert clock.hear_clock(clock_message(4), NOW + 50.0) is News.TICK


def test_while_the_router_is_away_the_world_is_not_given_up() -> None:
    clock = TeamClock(Roster(OWN, grace=0.5, comeback=5.0), period=0.5)
    clock.roster.hear_token(Envelope(OWN, kind=Kind.ALIVE), NOW)
    world(clock, Kind.ALIVE)
    clock.hear_clock(clock_message(3), NOW)
    world(clock, Kind.GONE, NOW + 1.0)
    clock.roster.hear_token(Envelope(OWN, kind=Kind.GONE), NOW + 1.2)
    assert news(clock, NOW + 50.0) == []
    clock.roster.hear_token(Envelope(OWN, kind=Kind.ALIVE), NOW + 50.0)
    assert news(clock, NOW + 54.0) == []
    world(clock, Kind.ALIVE, NOW + 54.0)
    assert clock.hear_clock(clock_message(3), NOW + 54.0) is News.REPEATED
