"""The world process against a scripted team, without a network: who is waited for, and for how long."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.opinion.belief import gaussian
from blackboard.wire import keys
from blackboard.wire.arrays import pack
from blackboard.wire.codec import decode, encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Clock, Consensus, Readings, Solo, Status, Truth
from sim_world.members import Members
from sim_world.referee import Referee
from sim_world.scenario import WorldSection
from sim_world.scorecard import scorecard, text
from sim_world.service import LINGER, WorldService
from sim_world.world import World

NOW = 1_000_000.0
WAITS = {"gather": 30.0, "patience": 2.0, "give_up": 10.0, "grace": 0.5, "comeback": 5.0}
OWN = keys.WORLD.key(team="demo")


def service(
    sub_teams: Mapping[str, list[str]], time: Mapping[str, object], world: Mapping[str, object]
) -> WorldService:
    scenario = Scenario(
        {
            "team": {"sub_teams": dict(sub_teams)},
            "grid": {"shape": [20, 20]},
            "time": {"tick": 0.5, "seconds": 2.0, **time},
            "world": {"speed": 0.5, "objects": {}, **WAITS, **world},
        }
    )
    settings, robots = scenario.section("world", WorldSection), scenario.team.robots
    it = World(settings, scenario.grid, robots, scenario.time.tick, lambda n: np.random.default_rng([1, *n.encode()]))
    return WorldService(scenario, it, Referee(scenario.grid, settings.check, robots))


class Desk:
    """A world under test, the team that answers it, and everything it said. Beliefs are sharper together than alone."""

    def __init__(
        self,
        sub_teams: Mapping[str, list[str]] | None = None,
        time: Mapping[str, object] | None = None,
        **world: object,
    ) -> None:
        self.teams = {"a": ["r1", "r2"]} if sub_teams is None else dict(sub_teams)
        self.world = service(self.teams, time or {}, world)
        self.grid = self.world.referee.grid
        self.now = NOW
        self.said: list[Envelope] = []
        self.silent: set[str] = set()  # "r1", or "a" for its board
        self.lose: Callable[[Envelope], bool] = lambda envelope: False
        self.truth: Truth | None = None

    # --- what happens -----------------------------------------------------------------------------------------------

    def tell(self, *envelopes: Envelope) -> None:
        """Deliver some envelopes, and the answers to what they cause, until it is quiet."""
        waiting = list(envelopes)
        while waiting and not self.world.done:
            out = self.world.receive(waiting.pop(0), self.now)
            waiting += self.heard(out)

    def wait(self, seconds: float) -> None:
        """Let time pass, waking the world when it asks for it."""
        end = self.now + seconds
        while not self.world.done and (due := self.world.wake_at(self.now)) is not None and due <= end:
            self.now = max(self.now, due)
            self.tell(*self.heard(self.world.wake(self.now)))
            self.now += 1e-4  # whoever asks to be woken at once for ever is found out by the time limit
        self.now = max(self.now, end)

    def tokens(
        self, kind: Kind, robots: Mapping[str, list[str]] | None = None, boards: list[str] | None = None
    ) -> None:
        for sub_team, names in (self.teams if robots is None else robots).items():
            self.tell(*(Envelope(keys.MEMBER.key(team="demo", sub_team=sub_team, robot=r), kind=kind) for r in names))
        for sub_team in list(self.teams) if boards is None else boards:
            self.tell(Envelope(keys.BOARD.key(team="demo", sub_team=sub_team, board=sub_team), kind=kind))

    def heard(self, out: list[Envelope]) -> list[Envelope]:
        """The team's answers to what the world sent."""
        self.said += out
        answers: list[Envelope] = []
        for envelope in out:
            if envelope.key.endswith("/truth"):
                self.truth = decode(Truth, envelope.payload)
            if envelope.key.endswith("/clock"):
                answers += self.answers(decode(Clock, envelope.payload))
        return [answer for answer in answers if not self.lose(answer)]

    def answers(self, clock: Clock) -> list[Envelope]:
        teams = clock.robots if clock.mode == "lockstep" else self.teams
        robots = sorted({r for names in teams.values() for r in names} - self.silent)
        found = [] if clock.end else [self.solo(robot, clock.tick) for robot in robots]
        for sub_team in sorted(set(teams) - self.silent) if not clock.end else []:
            for level in ("consensus", "agreed"):
                subjects = [f"robot/{robot}" for robot in teams[sub_team]]
                found += [self.consensus(sub_team, level, subject, clock.tick) for subject in subjects]
                found.append(self.status(sub_team, level, subjects, clock.tick))
        return found

    # --- what the team says -----------------------------------------------------------------------------------------

    def solo(self, robot: str, tick: int) -> Envelope:
        said = Solo(robot=robot, tick=tick, time=0, beliefs={f"robot/{robot}": self.belief(f"robot/{robot}", 3.0)})
        return Envelope(keys.SOLO.key(team="demo", robot=robot), encode(said))

    def belief(self, subject: str, off: float) -> Any:
        assert self.truth is not None
        x, y = self.truth.positions[subject]
        return pack(gaussian(self.grid, (x + off / 2, y), off))

    def consensus(self, sub_team: str, level: str, subject: str, tick: int) -> Envelope:
        said = Consensus(
            board=sub_team,
            sub_team=sub_team,
            level=level,  # type: ignore[arg-type]
            subject=subject,
            tick=tick,
            time=0,
            belief=self.belief(subject, 1.0),
            ancestors={},
            used=[],
            entropy=0,
            conflict=False,
            rule="cooperative",
        )
        topic = keys.CONSENSUS if level == "consensus" else keys.AGREED
        return Envelope(topic.key(team="demo", sub_team=sub_team, subject=subject), encode(said))

    def status(self, sub_team: str, phase: str, subjects: list[str], tick: int) -> Envelope:
        said = Status(process=sub_team, kind="board", tick=tick, time=0, phase=phase, subjects=subjects)  # type: ignore[arg-type]
        return Envelope(keys.STATUS.key(team="demo", sub_team=sub_team, process=sub_team), encode(said))

    # --- what was seen ----------------------------------------------------------------------------------------------

    @property
    def clocks(self) -> list[Clock]:
        return [decode(Clock, e.payload) for e in self.said if e.key.endswith("/clock")]

    @property
    def ticks(self) -> list[int]:
        return [clock.tick for clock in self.clocks if not clock.end]

    @property
    def card(self) -> dict[str, Any]:
        return scorecard(self.world)


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
    desk = Desk()
    desk.tokens(Kind.ALIVE)
    first = [envelope.key.split("/", 3)[3] for envelope in desk.said[:4]]
    assert first == ["reading/r1", "reading/r2", "truth", "clock"]
    readings = decode(Readings, desk.said[0].payload)
    assert (readings.run, readings.robot, readings.tick) == (desk.clocks[0].run, "r1", 0)
    assert len({clock.run for clock in desk.clocks}) == 1


def test_the_scorecard_has_what_was_agreed_upon() -> None:
    desk = Desk({"a": ["r1", "r2"], "b": ["r3"]})
    desk.tokens(Kind.ALIVE)
    desk.world.note({"sent": 1, "received": 1, "dropped": 3, "bytes": 1})
    card = desk.card
    assert card["verdict"] == "PASS"
    assert list(card)[:12] == [
        *("verdict", "reasons", "hash", "seed", "rule", "ticks", "simulated_s", "wall_s", "messages", "bytes"),
        *("scores", "unit"),
    ]
    assert (card["seed"], card["rule"], card["ticks"], card["simulated_s"]) == (1, "coalition", 4, 2.0)
    assert card["messages"]["dropped"] == 3
    assert card["messages"]["sent"] == len(desk.said)
    assert card["scores"]["robots"]["solo"]["n"] == 3 * 4
    assert set(card["scores"]["robots"]["by_name"]) == {"r1", "r2", "r3"}
    assert card["team_rmse"]["solo"] > card["team_rmse"]["agreed"] > 0
    assert "PASS" in text(card).splitlines()
    assert "robots agreed" in text(card)


def test_without_an_answer_the_tick_is_said_again_until_it_is_there() -> None:
    desk = Desk()
    desk.lose = lambda envelope: "/solo/r2" in envelope.key
    desk.tokens(Kind.ALIVE)
    assert desk.ticks == [0]
    desk.wait(1.9)
    assert desk.ticks == [0]
    desk.wait(0.2)
    assert desk.ticks == [0, 0]
    assert [e.payload for e in desk.said[:4]] == [e.payload for e in desk.said[4:8]]
    desk.lose = lambda envelope: False
    desk.wait(2.0)
    assert desk.ticks == [0, 0, 0, 1, 2, 3, 4]
    assert desk.card["verdict"] == "PASS"
    assert desk.card["counters"]["repeated"] == 2


@pytest.mark.parametrize("lost", ["/a/consensus/robot/r1", "/a/agreed/robot/r2", "/status/a"])
def test_the_referee_misses_nothing_that_a_board_lists(lost: str) -> None:
    desk = Desk()
    desk.lose = lambda envelope: lost in envelope.key
    desk.tokens(Kind.ALIVE)
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
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
    desk.wait(1.0)
    assert desk.ticks == [0]
    desk.tokens(Kind.GONE, {"a": ["r2"]}, boards=[])
    desk.wait(0.4)
    assert desk.ticks == [0]  # perhaps it was the router
    desk.wait(0.2)
    assert desk.world.done
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1", "r2"]}, {"a": ["r1"]}]


def test_a_robot_that_comes_back_takes_part_again() -> None:
    desk = Desk()
    desk.lose = lambda envelope: "/solo/" in envelope.key
    desk.tokens(Kind.ALIVE)
    desk.tokens(Kind.GONE, {"a": ["r2"]}, boards=[])
    desk.wait(1.0)
    desk.tokens(Kind.ALIVE, {"a": ["r2"]}, boards=[])
    desk.lose = lambda envelope: False
    desk.wait(2.0)
    assert desk.world.done
    assert desk.clocks[-2].robots == {"a": ["r1", "r2"]}
    assert desk.card["verdict"] == "PASS"


def test_a_dead_board_is_not_waited_for_and_the_others_go_on() -> None:
    desk = Desk({"a": ["r1"], "b": ["r2"]})
    desk.silent = {"b"}
    desk.tokens(Kind.ALIVE)
    desk.wait(1.0)
    assert desk.ticks == [0]
    desk.tokens(Kind.GONE, {}, boards=["b"])
    desk.wait(0.6)
    assert desk.ticks == [0, 1, 2, 3, 4]
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1"], "b": ["r2"]}, {"a": ["r1"]}]
    assert desk.clocks[1].settled == {"a": ["robot/r1"]}


def test_without_any_board_it_waits_for_one() -> None:
    desk = Desk()
    desk.silent = {"a"}
    desk.tokens(Kind.ALIVE)
    desk.tokens(Kind.GONE, {})
    desk.wait(20.0)
    assert not desk.world.done
    assert set(desk.ticks) == {0}
    desk.silent = set()
    desk.tokens(Kind.ALIVE, {})
    desk.wait(3.0)
    assert desk.card["verdict"] == "PASS"


def test_without_any_board_for_too_long_it_ends() -> None:
    desk = Desk()
    desk.silent = {"a"}
    desk.tokens(Kind.ALIVE)
    desk.tokens(Kind.GONE, {})
    desk.wait(40.0)
    assert desk.card["reasons"][0] == "nobody (all went) there for 30 s, in tick 0 of 4"


def test_who_lives_and_says_nothing_is_given_up_until_it_speaks() -> None:
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
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
    desk = Desk()
    desk.lose = lambda envelope: "/solo/" in envelope.key
    desk.tokens(Kind.ALIVE)
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
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
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


def test_a_router_that_stays_away_ends_the_run() -> None:
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
    desk.tell(Envelope(OWN, kind=Kind.GONE))
    desk.wait(40.0)
    assert desk.card["reasons"][0] == "no router there for 30 s, in tick 0 of 4"


def test_a_stranger_is_welcome() -> None:
    desk = Desk()
    desk.silent = {"r1"}
    desk.tokens(Kind.ALIVE)
    desk.tokens(Kind.ALIVE, {"a": ["zoe"]}, boards=[])
    desk.silent = set()
    desk.wait(3.0)
    assert desk.world.done
    assert [clock.robots for clock in desk.clocks[:2]] == [{"a": ["r1", "r2"]}] * 2  # said again; zoe waits
    assert desk.clocks[-2].robots == {"a": ["r1", "r2", "zoe"]}
    assert desk.card["verdict"] == "PASS"
    assert desk.card["scores"]["robots"]["by_name"]["zoe"]["solo"]["n"] == 4


def test_a_stranger_without_sensor_data_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    monkeypatch.setattr(desk.world.source, "welcome", lambda robot: robot in ("r1", "r2"))
    desk.tokens(Kind.ALIVE, {"a": ["zoe"]}, boards=[])
    desk.tokens(Kind.ALIVE)
    assert desk.world.done
    assert desk.clocks[0].robots == {"a": ["r1", "r2"]}
    assert desk.card["counters"]["strangers"] == 1
    assert desk.card["verdict"] == "PASS"


def test_bad_bytes_are_counted_under_their_reason() -> None:
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
    before = len(desk.said)
    desk.tell(Envelope(keys.SOLO.key(team="demo", robot="r2"), b"\xc1"))
    desk.tell(Envelope(keys.SOLO.key(team="demo", robot="r1"), desk.solo("r2", 0).payload))
    desk.tell(Envelope("cop/demo/**", b""))
    desk.tell(Envelope("cop/demo/what/ever", kind=Kind.ALIVE))
    assert len(desk.said) == before
    assert desk.card["messages"]["refused"] == {"impostor": 1, "not-msgpack": 1, "wild-key": 1}


def test_the_teams_counters_are_summed_from_the_statuses() -> None:
    desk = Desk()
    for sub_team in ("a", "b"):
        said = Status(process="r1", kind="robot", tick=0, time=0, counters={"dropped": 2}, refused={"mass": 1})
        desk.tell(Envelope(keys.STATUS.key(team="demo", sub_team=sub_team, process="r1"), encode(said)))
    messages = desk.card["messages"]
    assert (messages["dropped"], messages["refused"]) == (2, {"mass": 1})  # one robot in two sub-teams


def test_a_run_that_is_stopped_fails_and_says_so() -> None:
    desk = Desk()
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
    assert desk.card["verdict"] == "FAIL"
    assert desk.card["reasons"][0] == "stopped in tick 0 of 4"


# --- real time -------------------------------------------------------------------------------------------------------


def test_in_real_time_the_world_paces_and_waits_for_nobody() -> None:
    desk = Desk(time={"mode": "realtime"})
    desk.silent = {"r2"}
    desk.tokens(Kind.ALIVE)
    when = [desk.now]
    while len(desk.ticks) < 5:
        seen = len(desk.ticks)
        desk.wait(0.01)
        when += [desk.now] * (len(desk.ticks) - seen)
    assert desk.ticks == [0, 1, 2, 3, 4]
    assert [round(t - when[0], 1) for t in when] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert all(clock.robots == clock.settled == {} for clock in desk.clocks)
    assert not desk.world.done  # the last tick may still be answered
    desk.wait(LINGER + 0.1)
    assert desk.world.done
    assert desk.card["missing"] == {"robot/r2": {"solo": 4}}


def test_in_real_time_a_late_answer_counts_for_a_while() -> None:
    desk = Desk(time={"mode": "realtime"})
    desk.silent = {"r1"}
    desk.tokens(Kind.ALIVE)
    desk.wait(1.2)
    assert desk.ticks == [0, 1, 2]
    desk.tell(desk.solo("r1", 1), desk.solo("r1", 0))  # 0.7 s late; 1.2 s late
    desk.wait(5.0)
    assert desk.card["missing"]["robot/r1"] == {"solo": 3}
    assert desk.card["counters"]["late"] == 1


def test_in_real_time_a_world_that_fell_behind_does_not_catch_up() -> None:
    desk = Desk(time={"mode": "realtime"})
    desk.tokens(Kind.ALIVE)
    desk.now += 10.0
    desk.wait(0.0)
    assert desk.ticks == [0, 1]
    desk.wait(0.4)
    assert desk.ticks == [0, 1]
    desk.wait(0.2)
    assert desk.ticks == [0, 1, 2]


# --- tokens ----------------------------------------------------------------------------------------------------------


def test_members_count_until_their_time_is_over() -> None:
    it = Members("t", grace=1.0, comeback=5.0)
    r1, board = keys.MEMBER.key(team="t", sub_team="a", robot="r1"), keys.BOARD.key(team="t", sub_team="a", board="x")
    assert not it.hear(Envelope(r1, kind=Kind.ALIVE), 0.0)
    it.hear(Envelope(board, kind=Kind.ALIVE), 0.0)
    assert (it.robots, it.boards) == ({"a": ["r1"]}, {"a"})
    it.hear(Envelope(r1, kind=Kind.GONE), 10.0)
    assert it.changes_at() == 11.0
    it.forget(10.9)
    assert it.robots == {"a": ["r1"]}
    assert it.hear(Envelope(r1, kind=Kind.ALIVE), 10.9)  # back in time
    it.hear(Envelope(r1, kind=Kind.GONE), 12.0)
    it.forget(13.0)
    assert (it.robots, it.boards) == ({}, {"a"})
    assert not it.hear(Envelope(r1, kind=Kind.ALIVE), 14.0)
