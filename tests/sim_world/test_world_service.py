"""The world process without a network: its ticks in lockstep and in real time, its boards, and its scorecard."""

import logging
import math

import pytest

from blackboard.judge.card import text
from blackboard.opinion.belief import gaussian
from blackboard.opinion.grid import Grid
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Readings, Solo, Status
from tests.sim_world.desk import NOW, Desk, begun
from tests.wire.envelopes import put


def test_a_tick_follows_the_other_once_all_have_answered() -> None:
    desk = Desk()
    desk.wait(1.0)
    assert desk.said == []  # nobody is there
    desk.tokens(Kind.ALIVE)
    assert desk.world.done
    assert desk.ticks == [0, 1, 2, 3, 4]
    assert [clock.time for clock in desk.clocks] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.0]
    assert [clock.end for clock in desk.clocks] == [False] * 5 + [True]
    assert desk.clocks[0].robots == {"a": ["r1", "r2"]}
    assert [clock.settled for clock in desk.clocks] == [{}, *[{"a": ["robot/r1", "robot/r2"]}] * 4, {}]
    assert desk.now - NOW < 1.1  # no time passed: it waits for facts, not for the clock


def test_readings_and_truth_come_before_the_clock() -> None:
    desk = begun()
    first = [envelope.key.split("/", 3)[3] for envelope in desk.said[:4]]
    assert first == ["reading/r1", "reading/r2", "truth", "clock"]
    readings = decode(Readings, desk.said[0].payload)
    assert (readings.run, readings.robot, readings.tick) == (desk.clocks[0].run, "r1", 0)
    assert len({clock.run for clock in desk.clocks}) == 1


def test_the_scorecard_has_what_was_agreed_upon() -> None:
    desk = begun({"a": ["r1", "r2"], "b": ["r3"]})
    desk.world.record_link_counters({"sent": 7, "received": 1, "dropped": 3, "bytes": 1})
    card = desk.card
    assert card["verdict"] == "PASS"
    assert list(card)[:12] == [
        *("verdict", "reasons", "hash", "seed", "rule", "ticks", "simulated_s", "wall_s", "messages", "bytes"),
        *("scores", "unit"),
    ]
    assert (card["seed"], card["rule"], card["ticks"], card["simulated_s"]) == (1, "coalition", 4, 2.0)
    assert card["messages"]["dropped"] == 3
    assert card["messages"]["sent"] == 7
    assert card["scores"]["robots"]["solo"]["n"] == 3 * 4
    assert set(card["scores"]["robots"]["by_name"]) == {"r1", "r2", "r3"}
    assert card["team_rmse"]["solo"] > card["team_rmse"]["agreed"] > 0
    assert "PASS, but too short to judge the regions of robots solo" in text(card)
    assert "robots agreed" in text(card)


def test_without_an_answer_the_tick_is_said_again_until_it_is_there() -> None:
    desk = begun(lose=lambda envelope: "/solo/r2" in envelope.key)
    assert desk.ticks == [0]
    desk.wait(1.9)
    assert desk.ticks == [0]
    desk.wait(0.2)
    assert desk.ticks == [0, 0]
    assert [e.payload for e in desk.said if e.key.endswith("/reading/r2")] == [desk.said[1].payload] * 2
    assert [e.payload for e in desk.said if e.key.endswith("/reading/r1")] == [desk.said[0].payload]
    assert desk.clocks[1] == desk.clocks[0].model_copy(update={"asked": ["robot/r2"], "again": []})
    desk.lose = lambda envelope: False
    desk.wait(2.0)
    assert desk.ticks == [0, 0, 0, 1, 2, 3, 4]
    assert desk.card["verdict"] == "PASS"
    assert desk.card["counters"]["repeated"] == 2


@pytest.mark.parametrize("lost", ["/a/consensus/robot/r1", "/a/agreed/robot/r2", "/status/a"])
def test_the_referee_misses_nothing_that_a_board_lists(lost: str) -> None:
    desk = begun(lose=lambda envelope: lost in envelope.key)
    desk.wait(1.0)
    assert desk.ticks == [0]
    desk.lose = lambda envelope: False
    desk.wait(2.0)
    assert desk.card["verdict"] == "PASS"
    assert desk.card["missing"] == {}


def test_what_arrives_twice_or_late_changes_nothing() -> None:
    once, often = Desk(), Desk()
    often.lose = lambda envelope: "/solo/r2" in envelope.key
    once.tokens(Kind.ALIVE)
    often.tokens(Kind.ALIVE)
    often.wait(5.0)  # everything but one answer is there several times
    often.tell(often.solo("r1", 0), often.consensus("a", "agreed", "robot/r1", 0))
    often.lose = lambda envelope: False
    often.wait(5.0)
    often.tell(often.solo("r1", 1))
    assert once.card["hash"] == often.card["hash"]
    assert once.card["scores"] == often.card["scores"]


def test_an_answer_that_came_again_is_no_wait_that_time_ended() -> None:
    desk = Desk()
    desk.lose = lambda envelope: len(desk.ticks) > 1
    desk.tokens(Kind.ALIVE)
    assert desk.ticks == [0, 1]
    desk.tell(desk.solo("r1", 0))
    assert desk.card["counters"]["late"] == 1
    assert desk.card["messages"]["late"] == 0


def test_beliefs_that_the_referee_cannot_use_are_counted_with_what_was_refused() -> None:
    desk = begun(lose=lambda envelope: "/solo/r2" in envelope.key)
    strange = pack(gaussian(Grid((5, 5)), (2, 2), 1.0))
    for tick in (0, 1):
        said = Solo(robot="r2", tick=tick, time=0, beliefs={"robot/r2": strange})
        desk.tell(put(said, team="demo"))
    assert desk.card["messages"]["refused"] == {"grid": 1}  # nobody is judged in tick 0
    assert desk.card["protocol"] is None


def test_bad_bytes_are_counted_under_their_reason() -> None:
    desk = begun(silent={"r2"})
    before = len(desk.said)
    desk.tell(Envelope(keys.SOLO.key(team="demo", robot="r2"), b"\xc1"))
    desk.tell(Envelope(keys.SOLO.key(team="demo", robot="r1"), desk.solo("r2", 0).payload))
    desk.tell(Envelope("cop/demo/**", b""))
    desk.tell(Envelope("cop/demo/what/ever", kind=Kind.ALIVE))
    assert len(desk.said) == before
    assert desk.card["messages"]["refused"] == {"impostor": 1, "not-msgpack": 1, "wild-key": 1}


def test_a_run_that_is_stopped_fails_and_says_so() -> None:
    desk = begun(silent={"r2"})
    assert desk.card["verdict"] == "FAIL"
    assert desk.card["reasons"][0] == "stopped in tick 0 of 4"


def test_a_run_without_an_end_is_judged_as_it_is_when_it_is_stopped() -> None:
    desk = Desk(time={"mode": "realtime", "seconds": math.inf})
    assert desk.card["reasons"][0] == "stopped in tick -1"  # before it began
    desk.tokens(Kind.ALIVE)
    desk.wait(20.0)
    assert (desk.card["verdict"], desk.card["ticks"]) == ("PASS", 40)
    assert not any("stopped" in reason for reason in desk.card["reasons"])


# --- real time -------------------------------------------------------------------------------------------------------


def test_in_real_time_the_world_paces_and_waits_for_nobody() -> None:
    desk = begun(time={"mode": "realtime"}, silent={"r2"})
    when = [desk.now]
    while len(desk.ticks) < 5:
        before = len(desk.ticks)
        desk.wait(0.01)
        when += [desk.now] * (len(desk.ticks) - before)
    assert desk.ticks == [0, 1, 2, 3, 4]
    assert [round(t - when[0], 1) for t in when] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert all(clock.robots == clock.settled == {} for clock in desk.clocks)
    assert not desk.world.done  # the last tick may still be answered
    desk.wait(desk.world.settings.linger + 0.1)
    assert desk.world.done
    assert desk.card["missing"] == {"robot/r2": {"solo": 4}}


@pytest.mark.parametrize(("linger", "late"), [(1.0, 1), (3.0, 0)])
def test_in_real_time_a_late_answer_counts_for_a_while(linger: float, late: int) -> None:
    desk = begun(time={"mode": "realtime"}, linger=linger, silent={"r1"})
    desk.wait(1.2)
    assert desk.ticks == [0, 1, 2]
    desk.tell(desk.solo("r1", 1), desk.solo("r1", 0))  # 0.7 s late; 1.2 s late
    desk.wait(5.0)
    assert desk.card["missing"]["robot/r1"] == {"solo": 3}  # tick 0 is not judged
    assert desk.card["counters"].get("late", 0) == late


def test_in_real_time_a_world_that_fell_behind_does_not_catch_up() -> None:
    desk = begun(time={"mode": "realtime"})
    desk.now += 10.0
    desk.wait(0.0)
    assert desk.ticks == [0, 1]
    desk.wait(0.4)
    assert desk.ticks == [0, 1]
    desk.wait(0.2)
    assert desk.ticks == [0, 1, 2]


# --- boards ----------------------------------------------------------------------------------------------------------


def test_a_board_without_a_token_ends_no_tick() -> None:
    desk = begun(silent={"a"})
    for level in ("consensus", "agreed"):
        payload = Status(process="evil", kind="board", tick=0, time=0, phase=level, subjects=[])  # type: ignore[arg-type]
        desk.tell(put(payload, team="demo"))
    assert desk.ticks == [0]
    assert desk.card["messages"]["refused"] == {"unregistered": 2}


def test_each_board_of_a_sub_team_is_waited_for_and_one_that_stays_silent_is_given_up() -> None:
    desk = begun(lose=lambda envelope: "/solo/" in envelope.key)
    desk.tell(Envelope(keys.BOARD.key(team="demo", sub_team="a", board="b"), kind=Kind.ALIVE))
    desk.tell(desk.idle("board", "a", "b"))
    desk.lose = lambda envelope: False
    desk.wait(9.0)
    assert set(desk.ticks) == {0}
    desk.wait(2.0)
    assert desk.world.done
    assert desk.card["counters"]["given_up"] == 1
    assert all(clock.robots == {"a": ["r1", "r2"]} for clock in desk.clocks if not clock.end)
    assert desk.card["verdict"] == "PASS"


def test_the_teams_counters_are_summed_those_of_a_robot_in_two_sub_teams_once_and_the_worlds_own() -> None:
    desk = Desk()
    desk.world.record_link_counters({"sent": 5, "dropped": 1})
    for sub_team, kind in (("a", "robot"), ("b", "robot"), ("a", "board"), ("b", "board")):
        fields = {"counters": {"sent": 10, "dropped": 2, "bytes": 100}, "refused": {"mass": 1}}
        said = Status(process="x", kind=kind, tick=0, time=0, **fields)  # type: ignore[arg-type]
        desk.tell(put(said, team="demo", sub_team=sub_team))
    assert desk.card["messages"] == {"sent": 35, "received": 0, "dropped": 7, "late": 0, "refused": {"mass": 3}}
    assert desk.card["bytes"] == 300


@pytest.mark.parametrize(
    ("seconds", "logged"), [(2.0, [0, 1, 2, 3, 4]), (12.0, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24])]
)
def test_about_ten_ticks_of_a_run_are_logged(
    caplog: pytest.LogCaptureFixture, seconds: float, logged: list[int]
) -> None:
    caplog.set_level(logging.INFO, "sim_world.service")
    desk = Desk(time={"seconds": seconds})
    desk.wait(0.1)
    desk.tokens(Kind.ALIVE)
    desk.wait(1.0)
    assert desk.world.why == ""
    lines = [r.message for r in caplog.records if r.message.startswith("tick ")]
    assert lines == [f"tick {tick} of {round(seconds / 0.5)}" for tick in logged]


@pytest.mark.parametrize(("kind", "ticks"), [("robot", [0]), ("board", [0, 1])])
def test_only_a_board_ends_a_tick_by_its_statuses(kind: str, ticks: list[int]) -> None:
    desk = begun(silent={"a"})
    desk.wait(0.1)
    assert desk.ticks == [0]
    for level in ("consensus", "agreed"):
        subjects = ["robot/r1", "robot/r2"]
        desk.tell(*(desk.consensus("a", level, subject, 0) for subject in subjects))
        said = Status(process="a", kind=kind, tick=0, time=0, phase=level, subjects=subjects)  # type: ignore[arg-type]
        desk.tell(put(said, team="demo"))
    desk.wait(0.1)
    assert desk.ticks == ticks
    assert not desk.world.refused
