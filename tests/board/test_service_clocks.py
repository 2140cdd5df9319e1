"""By whose time a board process goes: a world's Clock, its token, real time, and Unix time without a world."""

import pytest

from blackboard.process.team_clock import WORLD_SILENT
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from tests.board.desk import NOW, WORLD, Desk, clock, idle, levels, report, reported


def test_without_a_world_it_settles_by_unix_time() -> None:
    desk = Desk("r1", world=False, period=0.5)
    desk.tell(report("r1", 7, time=NOW))
    assert levels(desk.wait(0.6)) == ["consensus", "agreed"]
    assert levels(desk.wait(0.5)) == ["consensus", "agreed"]  # what a silent robot said last stands, and spreads


def test_without_a_world_it_settles_no_oftener_than_it_is_woken() -> None:
    """A board that takes longer to settle than its period still hears all that waits between two settlements."""
    desk = Desk("r1", world=False, period=0.1)
    for n in range(8):
        desk.now += 0.25
        assert levels(desk.tell(report("r1", 7 + n, time=desk.now))) == []
    said = desk.wait(0.0)
    assert levels(said) == ["consensus", "agreed"]
    assert decode(Consensus, said[0].payload).used[0].age == 0.0


def test_without_a_world_it_settles_once_all_robots_have_told_a_step() -> None:
    """At the first step nobody is known to follow, so a tick ends in the midst of it; from the third on each ends after it."""
    desk = Desk("r1", "r2", world=False, period=0.8)
    desk.wait(0.03)
    settlements, ticks = [], []
    for step in range(7, 12):
        for robot, before in (("r1", 0.3), ("r2", 0.12)):
            desk.wait(before)
            desk.tell(report(robot, step, time=desk.now), reported(robot, step, "object/ball"))
            said = desk.wait(0.0)
            settlements += [(step, robot)] if levels(said) == ["consensus", "agreed"] else []
            ticks += [decode(Consensus, envelope.payload).tick for envelope in said if "/agreed/" in envelope.key]
    assert settlements == [(7, "r1"), (8, "r1"), (8, "r2"), (9, "r2"), (10, "r2"), (11, "r2")]
    assert ticks == sorted(set(ticks))


def test_a_list_that_overtakes_its_reports_is_no_step_yet() -> None:
    desk = Desk("r1", world=False, period=1.0)
    desk.wait(0.0)
    desk.tell(reported("r1", 7, "object/ball"))
    assert levels(desk.wait(0.3)) == []
    desk.tell(report("r1", 7, time=desk.now))
    assert levels(desk.wait(0.0)) == ["consensus", "agreed"]


def test_one_clock_of_somebody_who_leaves_freezes_no_board() -> None:
    """Without a world's token a Clock is not followed; the token is waited for, once, and then Unix time counts."""
    desk = Desk("r1", world=False, period=0.5)
    desk.tell(clock(10**6, "r1"))
    desk.tell(report("r1", 7, time=NOW))
    assert levels(desk.wait(WORLD_SILENT - 0.1)) == []
    assert levels(desk.wait(0.2)) == ["consensus", "agreed"]
    desk.tell(clock(10**6 + 1, "r1"), report("r1", 8, time=desk.now))
    assert levels(desk.wait(0.5)) == ["consensus", "agreed"]
    assert desk.status().counters["unannounced"] == 2


def test_a_clock_counts_from_its_token_on() -> None:
    desk = Desk(world=False)
    desk.tell(clock(3, "r1"), report("r1", 3), reported("r1", 3, "object/ball"))
    assert desk.said == []
    assert levels(desk.tell(WORLD)) == ["consensus", "agreed"]
    assert desk.status().refused == {}


def test_a_report_that_comes_before_its_world_is_refused_for_now_and_counts_later() -> None:
    desk = Desk("r1", world=False)
    desk.tell(report("r1", 3))
    assert desk.service.refused == {"past": 1}
    assert levels(desk.tell(clock(3, "r1"), WORLD, reported("r1", 3, "object/ball"))) == ["consensus", "agreed"]
    assert desk.service.refused == {"past": 1}


@pytest.mark.parametrize("anew", [[], [WORLD]], ids=["the next world's token is late", "its token is there"])
def test_a_report_of_a_new_run_may_come_before_its_clock(
    anew: list[Envelope], caplog: pytest.LogCaptureFixture
) -> None:
    """A robot hears the new world before the board does, and its stamp is seconds before the time of the run that ended."""
    desk = Desk("r1")
    desk.tell(clock(99, "r1"), report("r1", 99), reported("r1", 99, "object/ball"))
    desk.tell(Envelope(WORLD.key, kind=Kind.GONE), *anew)
    desk.tell(report("r1", 0))
    assert desk.service.refused == {"past": 1}
    said = desk.tell(WORLD, clock(0, "r1", run="two"), reported("r1", 0, "object/ball"))
    assert levels(said) == ["consensus", "agreed"]
    assert caplog.messages == []


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_board_goes_on_by_unix_time_when_its_world_dies(mode: str, caplog: pytest.LogCaptureFixture) -> None:
    """A world that held its token and died, while a robot runs on by its own clock."""
    desk = Desk("r1", "r2", period=0.5)
    desk.tell(idle("r1"), idle("r2"), clock(10, "r1", "r2", mode=mode))
    desk.tell(report("r2", 10), reported("r2", 10, "object/ball"), report("r1", 10), reported("r1", 10, "object/ball"))
    assert levels(desk.said) == ["consensus", "agreed"]
    desk.tell(Envelope(WORLD.key, kind=Kind.GONE))
    assert levels(desk.wait(WORLD_SILENT - 0.1)) == []
    desk.wait(0.2)
    desk.tell(report("r1", 77, time=desk.now))
    said = desk.wait(0.5)
    assert levels(said) == ["consensus", "agreed"]
    consensus = decode(Consensus, said[0].payload)
    assert consensus.time == desk.now
    assert [u.source for u in consensus.used] == ["r1"]  # what r2 said was stamped with the world's time
    desk.wait(0.5)
    assert [m for m in caplog.messages if "going by Unix time" in m] == caplog.messages
    assert len(caplog.messages) == 1
    desk.tell(WORLD, clock(0, "r1", run="two"))
    assert levels(desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))) == ["consensus", "agreed"]


def test_in_real_time_a_silent_robot_is_waited_for_half_a_period() -> None:
    desk = Desk("r1", "r2", period=1.0)
    desk.tell(idle("r1"), idle("r2"), clock(4, mode="realtime"))
    desk.tell(report("r1", 4), reported("r1", 4, "object/ball"))
    assert levels(desk.wait(0.45)) == []
    assert levels(desk.wait(0.1)) == ["consensus", "agreed"]
    assert desk.status().counters["late"] == 1


def test_in_real_time_a_token_whose_holder_says_nothing_is_not_waited_for() -> None:
    desk = Desk("r1", *(f"x{i}" for i in range(100)), period=1.0)
    desk.tell(idle("r1"), clock(4, mode="realtime"), report("r1", 4))
    assert levels(desk.tell(reported("r1", 4, "object/ball"))) == ["consensus", "agreed"]
    assert "late" not in desk.status().counters


def test_a_world_that_is_alive_may_take_its_time() -> None:
    desk = Desk()
    desk.tell(clock(0, "r1"), report("r1", 0), reported("r1", 0, "object/ball"))
    desk.wait(1000.0)
    assert levels(desk.said) == ["consensus", "agreed"]


def test_a_status_that_is_said_again_tells_of_the_tick_that_was_settled() -> None:
    desk = Desk("r1", "r2")
    assert desk.status().phase == "idle"
    desk.tell(clock(4, "r1"), report("r1", 4), reported("r1", 4, "object/ball"), clock(5, "r1", "r2"))
    said = desk.status()
    assert (said.tick, said.time, said.phase, said.subjects) == (4, pytest.approx(0.8), "agreed", ["object/ball"])


def test_in_real_time_a_status_does_not_look_younger_than_what_was_settled() -> None:
    desk = Desk(period=0.5)
    desk.tell(clock(4, mode="realtime"))
    assert [desk.status().time, desk.status().time] == [0.8, 0.8]


def test_it_asks_to_be_woken_only_for_what_time_can_change() -> None:
    """Walk a board's wakes without any message: it never asks to be woken at once for ever, at any pace."""
    for start in ([], [WORLD], [WORLD, clock(0, "r1")], [clock(0, "r1")], [WORLD, clock(0, mode="realtime")]):
        desk = Desk("r1", world=False)
        desk.tell(*start)
        wakes = 0
        while desk.now < NOW + 20.0:
            due = desk.service.wake_at(desk.now)
            assert due is not None
            desk.now = max(desk.now, due)
            desk.tell()
            desk.said += desk.service.wake(desk.now)
            wakes += 1
            if wakes == 3:
                desk.tell(*(Envelope(e.key, kind=Kind.GONE) for e in start if e is WORLD))
            assert wakes < 400
        assert levels(desk.said) == []
        assert len([e for e in desk.said if "/status/" in e.key]) >= 19
