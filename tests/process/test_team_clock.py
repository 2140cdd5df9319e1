"""Team time: whose clock is followed, and when it no longer is."""

from __future__ import annotations

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


def clock(tick: int, mode: Any = "lockstep", run: str = "one") -> Clock:
    return Clock(run=run, tick=tick, time=min(0.2 * tick, 1e12), mode=mode)


def clock_of(tick: int, run: str = "one", seconds: float | None = None) -> dict[str, Any]:
    """The fields of a Clock but its mode."""
    return {"run": run, "tick": tick, "time": min(0.2 * tick, 1e12) if seconds is None else seconds}


def world(it: TeamClock, kind: Kind, now: float = NOW) -> None:
    it.roster.hear_token(Envelope(WORLD, kind=kind), now)


def news(it: TeamClock, now: float) -> list[News]:
    """All that is new at a time."""
    it.roster.forget(now)
    found: list[News] = []
    while (one := it.look(now)) is not News.NOTHING:
        found.append(one)
    return found


def test_without_a_world_ticks_are_quarters_of_a_period_of_unix_time() -> None:
    it = TeamClock(Roster(), period=0.5)
    assert it.pace is Pace.FREE
    assert it.changes_at() <= NOW
    assert news(it, NOW) == [News.TICK]
    assert (it.tick, it.time(NOW), it.changes_at()) == (8 * NOW, NOW, NOW + 0.5)
    assert news(it, NOW + 0.4) == []
    assert news(it, NOW + 2.0) == [News.TICK]
    assert it.tick == 8 * NOW + 16


def test_without_a_world_a_tick_begins_early_where_there_is_reason() -> None:
    it = TeamClock(Roster(), period=0.5)
    assert news(it, NOW) == [News.TICK]
    assert it.changes_at(early=True) == NOW + 0.125
    assert it.look(NOW + 0.1, early=True) is News.NOTHING
    assert it.look(NOW + 0.2, early=True, ticks=False) is News.NOTHING
    assert it.look(NOW + 0.2, early=True) is News.TICK
    assert (it.tick, it.changes_at()) == (8 * NOW + 1, NOW + 0.625)


@given(st.sampled_from((0.1, 0.2, 0.5, 1.0)), st.lists(st.tuples(st.floats(0.0, 0.7), st.booleans()), max_size=60))
def test_each_tick_of_unix_time_begins_once_four_in_a_period_at_most(
    period: float, waits: list[tuple[float, bool]]
) -> None:
    """A process that is woken at any times, also when it asked for it, with and without reason to begin a tick early."""
    it, now, began = TeamClock(Roster(), period), NOW, list[tuple[int, float]]()
    for wait, early in waits:
        now = min(now + wait, max(now, it.changes_at(early=early)))
        due = it.changes_at(early=early)
        news = it.look(now, early=early)
        if abs(now - due) > 1e-9:
            assert (news is News.TICK) == (now > due)
        if news is News.TICK:
            began.append((it.tick, now))
        assert it.look(now, early=early) is News.NOTHING
    ticks = [tick for tick, _ in began]
    assert all(one < other for one, other in pairwise(ticks))
    for tick, at in began:
        assert tick * period / 4 - 1e-9 <= at <= (tick + 1) * period / 4 + 1e-9
        assert len([1 for _, other in began if at <= other < at + period - 1e-9]) <= 5  # a part at each end
    for (_, at), (_, after) in pairwise(began):
        assert after - at <= period + 1e-9


def test_a_clock_that_is_set_back_begins_a_tick_at_once() -> None:
    it = TeamClock(Roster(), period=0.5)
    assert news(it, NOW) == [News.TICK]
    assert news(it, NOW - 100.0) == [News.TICK]
    assert it.tick == 8 * (NOW - 100.0)


def test_without_a_period_there_are_no_ticks_without_a_world() -> None:
    it = TeamClock(Roster())
    assert news(it, NOW) == []
    assert (it.tick, it.changes_at()) == (-1, math.inf)


def test_a_world_without_a_clock_is_waited_for() -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    assert it.pace is Pace.WAITING
    assert news(it, NOW) == []
    assert it.changes_at() == NOW + CLOCKLESS
    world(it, Kind.GONE, NOW + 1)
    assert news(it, NOW + 2) == [News.TICK]  # nothing was said by a world's time: nothing is forgotten
    assert it.pace is Pace.FREE


def test_a_token_without_a_clock_stops_nobody_for_long() -> None:
    it = TeamClock(Roster(grace=0.5), period=0.5)
    world(it, Kind.ALIVE)
    assert news(it, NOW) == []
    assert news(it, NOW + CLOCKLESS) == [News.TICK]
    for i in range(100):  # nor does one that comes and goes
        world(it, Kind.GONE, NOW + 20 + i)
        news(it, NOW + 20.9 + i)
        world(it, Kind.ALIVE, NOW + 20.9 + i)
        assert it.pace is Pace.FREE
    assert it.hear_clock(clock(7), NOW + 200.0) is News.RUN
    assert it.pace is Pace.LOCKSTEP


def test_a_token_whose_clock_has_stopped_is_given_up() -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(3), NOW)
    assert it.changes_at() == NOW + STOPPED
    assert news(it, NOW + STOPPED) == [News.FREE, News.TICK]
    assert it.pace is Pace.FREE
    assert it.hear_clock(clock(4), NOW + 100.0) is News.RUN


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
@pytest.mark.parametrize(
    "false",
    [clock_of(2**53 - 1), clock_of(30), clock_of(5, "other"), clock_of(2**53 - 1, "other"), clock_of(6, seconds=1e9)],
)
def test_one_clock_moves_nobody_whoever_sends_it(false: dict[str, Any], mode: str) -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    for tick in range(6):
        it.hear_clock(clock(tick, mode), NOW + 0.2 * tick)
    said = Clock(mode=mode, **false)  # type: ignore[arg-type]
    assert it.hear_clock(said, NOW + 1.1) is News.NOTHING
    assert it.hear_clock(clock(6, mode), NOW + 1.2) is News.TICK
    assert it.hear_clock(said, NOW + 1.3) is News.NOTHING
    assert it.hear_clock(clock(6, mode), NOW + 1.9) is News.REPEATED
    assert it.hear_clock(said, NOW + 2.1) is News.NOTHING
    assert (it.tick, it.time(NOW + 1.2)) == (6, pytest.approx(1.2))


@pytest.mark.parametrize("jump", [8, 2**53 - 20])
def test_a_jump_is_believed_with_the_second_clock_and_the_true_one_again_when_it_stops(jump: int) -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(5), NOW)
    assert [it.hear_clock(clock(jump), NOW + 0.2 * i) for i in range(4)] == [News.NOTHING] * 3 + [News.TICK]
    assert it.tick == jump
    assert it.hear_clock(clock(5), NOW + 2.0) is News.NOTHING  # the true world repeats its tick
    assert it.hear_clock(clock(5), NOW + 4.0) is News.RUN
    assert it.tick == 5


def test_a_new_run_is_believed_at_once_only_with_a_new_token() -> None:
    it = TeamClock(Roster(grace=0.5), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(5), NOW)
    assert it.hear_clock(clock(0, run="two"), NOW + 1.0) is News.NOTHING
    world(it, Kind.GONE, NOW + 1.1)
    world(it, Kind.ALIVE, NOW + 1.2)
    assert it.hear_clock(clock(0, run="two"), NOW + 1.3) is News.RUN
    assert it.hear_clock(clock(9, run="one"), NOW + 1.4) is News.NOTHING


def test_a_run_that_has_fallen_silent_is_left_for_one_that_is_heard() -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(5), NOW)
    assert [it.hear_clock(clock(i, run="two"), NOW + 1.0 + i) for i in range(4)] == [News.NOTHING] * 4
    assert it.hear_clock(clock(4, run="two"), NOW + WORLD_SILENT) is News.RUN


def test_one_clock_of_another_run_is_not_enough_even_in_silence() -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(5), NOW)
    assert it.hear_clock(clock(0, run="two"), NOW + 30.0) is News.NOTHING
    assert it.hear_clock(clock(6), NOW + 31.0) is News.TICK


@pytest.mark.parametrize(("mode", "pace", "runs"), [("lockstep", Pace.LOCKSTEP, 0.0), ("realtime", Pace.REALTIME, 1.5)])
def test_a_world_gives_the_ticks_and_the_time(mode: str, pace: Pace, runs: float) -> None:
    it = TeamClock(Roster(), period=0.5)
    world(it, Kind.ALIVE)
    assert it.hear_clock(clock(3, mode), NOW) is News.RUN
    assert (it.pace, it.tick) == (pace, 3)
    assert it.time(NOW + 1.5) == pytest.approx(0.6 + runs)
    assert it.hear_clock(clock(3, mode), NOW + 1.0) is News.REPEATED
    assert it.time(NOW + 1.5) == pytest.approx(0.6 + runs)  # from its first arrival on
    assert it.hear_clock(clock(2, mode), NOW + 1.0) is News.NOTHING
    assert it.hear_clock(clock(4, mode), NOW + 2.0) is News.TICK
    assert news(it, NOW + 2.0 + STOPPED - 0.1) == []  # a world that is there may take its time
    assert it.changes_at() == NOW + 2.0 + STOPPED


def test_a_clock_without_a_world_is_not_followed() -> None:
    it = TeamClock(Roster(), period=0.5)
    for seconds in range(12):  # however often it is said: its token is waited for once
        assert it.hear_clock(clock(seconds), NOW + seconds) is News.NOTHING
        waits = seconds < WORLD_SILENT
        assert news(it, NOW + seconds) == ([] if waits else [News.TICK])
        assert it.pace is (Pace.WAITING if waits else Pace.FREE)
        assert it.changes_at() == NOW + (WORLD_SILENT if waits else seconds + 0.5)
        assert it.time(NOW + seconds) == NOW + seconds


def test_a_clock_that_comes_before_its_token_is_followed_with_it() -> None:
    it = TeamClock(Roster(), period=0.5)
    it.hear_clock(clock(3), NOW)
    world(it, Kind.ALIVE)
    assert news(it, NOW + 0.1) == [News.RUN]
    assert (it.pace, it.tick, it.heard_at) == (Pace.LOCKSTEP, 3, NOW + 0.1)


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_world_that_is_gone_and_silent_is_given_up(mode: str) -> None:
    it = TeamClock(Roster(grace=0.5), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(3, mode), NOW)
    world(it, Kind.GONE, NOW + 1.0)
    assert news(it, NOW + 1.5) == []
    assert it.changes_at() == NOW + WORLD_SILENT
    assert news(it, NOW + WORLD_SILENT - 0.01) == []
    assert it.pace is not Pace.FREE
    assert news(it, NOW + WORLD_SILENT) == [News.FREE, News.TICK]
    assert (it.pace, it.time(NOW + 6.0)) == (Pace.FREE, NOW + 6.0)
    world(it, Kind.ALIVE, NOW + 7.0)
    assert it.pace is Pace.WAITING
    assert (
        it.hear_clock(clock(3, mode), NOW + 7.0) is News.RUN
    )  # also of the same run: what was said since is Unix time


def test_the_clocks_of_a_world_that_is_gone_do_not_keep_it() -> None:
    it = TeamClock(Roster(grace=0.5), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(3), NOW)
    world(it, Kind.GONE, NOW)
    it.roster.forget(NOW + 0.5)
    assert it.hear_clock(clock(4), NOW + 4.0) is News.NOTHING
    assert news(it, NOW + WORLD_SILENT) == [News.FREE, News.TICK]


def test_a_world_that_is_back_in_time_goes_on() -> None:
    it = TeamClock(Roster(grace=0.5), period=0.5)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(3), NOW)
    world(it, Kind.GONE, NOW + 1.0)
    assert news(it, NOW + 2.0) == []
    world(it, Kind.ALIVE, NOW + 4.0)
    assert news(it, NOW + 50.0) == []
    assert it.hear_clock(clock(4), NOW + 50.0) is News.TICK


def test_while_the_router_is_away_the_world_is_not_given_up() -> None:
    it = TeamClock(Roster(OWN, grace=0.5, comeback=5.0), period=0.5)
    it.roster.hear_token(Envelope(OWN, kind=Kind.ALIVE), NOW)
    world(it, Kind.ALIVE)
    it.hear_clock(clock(3), NOW)
    world(it, Kind.GONE, NOW + 1.0)
    it.roster.hear_token(Envelope(OWN, kind=Kind.GONE), NOW + 1.2)
    assert news(it, NOW + 50.0) == []
    it.roster.hear_token(Envelope(OWN, kind=Kind.ALIVE), NOW + 50.0)
    assert news(it, NOW + 54.0) == []
    world(it, Kind.ALIVE, NOW + 54.0)
    assert it.hear_clock(clock(3), NOW + 54.0) is News.REPEATED
