"""Who is not there: the world waits for them, gives up, goes on without them, and takes them in again."""

import pytest

from blackboard.wire.envelope import Envelope, Kind
from tests.sim_world.desk import OWN, Desk, begun


def test_who_does_not_come_is_not_waited_for_for_ever() -> None:
    desk = Desk()
    desk.tokens(Kind.ALIVE, {"a": ["r1"]})
    desk.wait(29.0)
    assert desk.said == []
    desk.wait(2.0)
    assert desk.world.done
    assert desk.clocks[0].robots == {"a": ["r1"]}
    assert desk.card["verdict"] == "FAIL"
    assert "r2 was never judged" in desk.card["reasons"]


def test_where_nobody_comes_it_ends() -> None:
    desk = Desk()
    desk.tokens(Kind.ALIVE, boards=[])  # robots, and no board
    desk.wait(40.0)
    assert desk.world.done
    assert desk.ticks == []
    assert desk.card["verdict"] == "FAIL"
    assert desk.card["reasons"][0] == "nobody (the board of a) there for 30 s, in tick -1 of 4"


def test_a_dead_robot_is_not_waited_for() -> None:
    desk = begun(silent={"r2"})
    desk.wait(1.0)
    assert desk.ticks == [0]
    desk.tokens(Kind.GONE, {"a": ["r2"]}, boards=[])
    desk.wait(0.4)
    assert desk.ticks == [0]  # perhaps it was the router
    desk.wait(0.2)
    assert desk.world.done
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1", "r2"]}, {"a": ["r1"]}]


def test_a_robot_that_comes_back_takes_part_again() -> None:
    desk = begun(lose=lambda envelope: "/solo/" in envelope.key)
    desk.tokens(Kind.GONE, {"a": ["r2"]}, boards=[])
    desk.wait(1.0)
    desk.tokens(Kind.ALIVE, {"a": ["r2"]}, boards=[])
    desk.lose = lambda envelope: False
    desk.wait(2.0)
    assert desk.world.done
    assert desk.clocks[-2].robots == {"a": ["r1", "r2"]}
    assert desk.card["verdict"] == "PASS"


def test_a_dead_board_is_not_waited_for_and_the_others_go_on() -> None:
    desk = begun({"a": ["r1"], "b": ["r2"]}, silent={"b"})
    desk.wait(1.0)
    assert desk.ticks == [0]
    desk.tokens(Kind.GONE, {}, boards=["b"])
    desk.wait(0.6)
    assert desk.ticks == [0, 1, 2, 3, 4]
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1"], "b": ["r2"]}, {"a": ["r1"]}]
    assert desk.clocks[1].settled == {"a": ["robot/r1"]}


def test_without_any_board_it_waits_for_one() -> None:
    desk = begun(silent={"a"})
    desk.tokens(Kind.GONE, {})
    desk.wait(20.0)
    assert not desk.world.done
    assert set(desk.ticks) == {0}
    desk.silent = set()
    desk.tokens(Kind.ALIVE, {})
    desk.wait(3.0)
    assert desk.card["verdict"] == "PASS"


def test_without_any_board_for_too_long_it_ends() -> None:
    desk = begun(silent={"a"})
    desk.tokens(Kind.GONE, {})
    desk.wait(40.0)
    assert desk.card["reasons"][0] == "nobody (all went) there for 30 s, in tick 0 of 4"


def test_who_lives_and_says_nothing_is_given_up_until_it_speaks() -> None:
    desk = begun(silent={"r2"})
    desk.wait(9.0)
    assert set(desk.ticks) == {0}
    desk.lose = lambda envelope: "/solo/r1" in envelope.key and desk.ticks[-1] == 1
    desk.wait(2.0)
    assert desk.clocks[-1].robots == {"a": ["r1"]}
    assert desk.card["counters"]["given_up"] == 1
    desk.silent, desk.lose = set(), lambda envelope: False
    desk.tell(desk.solo("r2", desk.ticks[-1]))
    desk.wait(3.0)
    assert desk.world.done
    assert desk.clocks[-2].robots == {"a": ["r1", "r2"]}


def test_a_router_that_goes_pauses_the_run_and_everybody_may_come_back() -> None:
    desk = begun(lose=lambda envelope: "/solo/" in envelope.key)
    desk.tell(Envelope(OWN, kind=Kind.ALIVE))
    desk.tokens(Kind.GONE)  # all tokens vanish, its own last
    desk.wait(0.1)
    desk.tell(Envelope(OWN, kind=Kind.GONE))
    before = list(desk.ticks)
    desk.wait(12.0)
    assert desk.ticks == before  # nothing is said to nobody, and no one is given up
    desk.tell(Envelope(OWN, kind=Kind.ALIVE))
    desk.wait(1.0)
    desk.lose = lambda envelope: False
    desk.tokens(Kind.ALIVE)
    desk.wait(2.0)
    assert desk.world.done
    assert all(clock.robots == {"a": ["r1", "r2"]} for clock in desk.clocks if not clock.end)
    assert desk.card["verdict"] == "PASS"
    assert "given_up" not in desk.card["counters"]


def test_who_does_not_come_back_with_the_router_is_dead() -> None:
    desk = begun(silent={"r2"})
    desk.tell(Envelope(OWN, kind=Kind.GONE))
    desk.tokens(Kind.GONE)
    desk.wait(2.0)
    desk.tell(Envelope(OWN, kind=Kind.ALIVE))
    desk.tokens(Kind.ALIVE, {"a": ["r1"]})
    desk.wait(4.9)
    assert set(desk.ticks) == {0}
    desk.wait(0.2)
    assert desk.world.done
    assert desk.clocks[-2].robots == {"a": ["r1"]}


def test_the_time_without_a_router_does_not_count_against_anybody_and_the_time_before_does() -> None:
    desk = begun(silent={"r2"})
    desk.tell(Envelope(OWN, kind=Kind.ALIVE))
    desk.wait(6.0)
    desk.tell(Envelope(OWN, kind=Kind.GONE))
    desk.wait(20.0)
    desk.tell(Envelope(OWN, kind=Kind.ALIVE))
    desk.wait(3.8)
    assert set(desk.ticks) == {0}
    desk.wait(0.4)
    assert desk.card["counters"]["given_up"] == 1


def test_a_router_that_stays_away_ends_the_run() -> None:
    desk = begun(silent={"r2"})
    desk.tell(Envelope(OWN, kind=Kind.GONE))
    desk.wait(40.0)
    assert desk.card["reasons"][0] == "no router there for 30 s, in tick 0 of 4"


def test_a_stranger_is_welcome() -> None:
    desk = begun(silent={"r1"})
    desk.tokens(Kind.ALIVE, {"a": ["zoe"]}, boards=[])
    desk.silent = set()
    desk.wait(3.0)
    assert desk.world.done
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1", "r2"]}] * 2  # said again; zoe waits
    assert desk.clocks[-2].robots == {"a": ["r1", "r2", "zoe"]}
    assert desk.card["verdict"] == "PASS"
    assert desk.card["scores"]["robots"]["by_name"]["zoe"]["solo"]["n"] == 4


def test_a_world_takes_no_guest_where_the_team_has_none(caplog: pytest.LogCaptureFixture) -> None:
    desk = Desk(guests="none")
    desk.tokens(Kind.ALIVE, {"a": ["zoe"]}, boards=[])
    desk.tokens(Kind.ALIVE)
    desk.wait(3.0)
    assert desk.world.done
    assert all("zoe" not in clock.robots.get("a", []) for clock in desk.clocks)
    assert desk.card["counters"]["strangers"] == 1
    assert "zoe cannot take part: the scenario does not name it, and [team] guests is none" in caplog.text


def test_who_speaks_for_another_team_gets_no_body_and_is_not_waited_for() -> None:
    desk = Desk()
    desk.tokens(Kind.ALIVE, {"a": ["from.north"]}, boards=[])
    desk.tokens(Kind.ALIVE)
    desk.wait(3.0)
    assert desk.world.done
    assert not [clock for clock in desk.clocks if "from.north" in clock.robots.get("a", [])]
    assert set(desk.card["scores"]["robots"]["by_name"]) == {"r1", "r2"}


def test_a_stranger_without_sensor_data_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    monkeypatch.setattr(desk.world.sensors, "admit", lambda robot: robot in ("r1", "r2"))
    desk.tokens(Kind.ALIVE, {"a": ["zoe"]}, boards=[])
    desk.tokens(Kind.ALIVE)
    assert desk.world.done
    assert desk.clocks[0].robots == {"a": ["r1", "r2"]}
    assert desk.card["counters"]["strangers"] == 1
    assert desk.card["verdict"] == "PASS"
