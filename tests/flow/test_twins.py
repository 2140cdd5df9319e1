"""Two boards of each sub-team: one speaks, whoever dies, and the beliefs are those of a team with one board each."""

from collections import Counter
from functools import cache
from typing import Any

import numpy as np
import pytest

from blackboard.board.lead import BoardRole
from blackboard.board.service import board_of
from blackboard.lab.team import InProcessTeam
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Consensus
from tests.flow.streams import Key, Stream
from tests.scenarios import SCENARIO

LONGER = SCENARIO.changed("time", seconds=4.0)  # ticks 0 to 8
FUSIONS = ("opinions", "joint")


def pair(fusion: str, mode: str = "lockstep", boards: int = 2) -> InProcessTeam:
    scenario = LONGER.changed("team", boards=boards).changed("board", fusion=fusion).changed("time", mode=mode)
    return InProcessTeam(scenario)


def is_clean(team: InProcessTeam) -> None:
    """Nobody was late, and nobody refused anything."""
    assert team.world.why == ""
    services: list[Any] = [*team.boards.values(), *team.robots.values(), team.world]
    assert [(service.counters["late"], +service.refused) for service in services] == [(0, Counter())] * len(services)


@cache
def calm(fusion: str) -> tuple[str, dict[Key, Consensus]]:
    """The hash and the beliefs of a team with one board each."""
    team = pair(fusion, boards=1)
    stream = Stream(team)
    team.run()
    return team.world.referee.hash, stream.beliefs


@pytest.mark.parametrize("fusion", FUSIONS)
def test_a_second_board_changes_not_a_bit(fusion: str) -> None:
    team = pair(fusion)
    stream = Stream(team)
    team.run()
    stream.check()
    is_clean(team)
    assert team.world.referee.hash == calm(fusion)[0]
    assert [team.boards[name].lead.leads for name in ("a", "a2", "b", "b2")] == [True, False, True, False]
    assert set(stream.boards("a")) == {"board-a"}


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
def test_the_order_of_arrival_decides_nothing(seed: int) -> None:
    team = pair("opinions")
    team.run_until(lambda: not team.bus.waiting)  # everybody knows everybody
    team.shuffle = np.random.default_rng(seed)
    team.run()
    assert team.world.referee.hash == calm("opinions")[0]


@pytest.mark.parametrize("fusion", FUSIONS)
@pytest.mark.parametrize("tick", [0, 3])
def test_the_death_of_a_leader_costs_no_tick_in_lockstep(fusion: str, tick: int) -> None:
    team = pair(fusion)
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == tick)
    team.leave(team.boards.pop("a"))
    began = team.now
    team.run_until(lambda: bool(team.boards["a2"].lead.leads))
    assert team.now - began < 1.0
    team.run()
    stream.check()
    is_clean(team)
    assert stream.beliefs == calm(fusion)[1]
    assert stream.boards("a")[-1] == "board-a2"


@pytest.mark.parametrize("sent", [5, *(pytest.param(n, marks=pytest.mark.long) for n in (0, 10))])
def test_a_leader_may_die_in_the_middle_of_what_it_says(sent: int) -> None:
    """What was on its way from it is lost: every belief is there, by one board or by the other."""
    team = pair("opinions")
    stream = Stream(team)
    dying, count = team.boards["a"], Counter[str]()

    def lose(envelope: Envelope) -> bool:
        mine = any(f"/a/{kind}" in envelope.key for kind in ("consensus/", "agreed/", "status/board-a"))
        if team.world.tick == 3 and mine and not envelope.key.endswith("board-a2"):
            count["mine"] += 1
        return team.world.tick >= 3 and mine and count["mine"] > sent and not team.boards["a2"].lead.leads

    team.bus.lose = lose
    team.run_until(lambda: count["mine"] >= sent and team.world.tick >= 3)
    team.leave(dying)
    team.boards.pop("a")
    team.run()
    assert team.world.why == ""
    assert stream.beliefs == calm("opinions")[1]
    assert team.boards["a2"].counters["late"] == team.boards["b"].counters["late"] == 0


@pytest.mark.parametrize("fusion", FUSIONS)
def test_who_comes_back_follows_and_takes_over_in_turn(fusion: str) -> None:
    team = pair(fusion)
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == 2)
    team.leave(team.boards["a"])
    team.run_until(lambda: team.world.tick == 4)
    back = team.boards["a"] = board_of(team.scenario, "a", "board-a")
    team.join(back)
    team.run_until(lambda: team.world.tick == 7)  # it has what the other one remembered after tick 6
    assert (back.lead.leads, team.boards["a2"].lead.leads) == (False, True)
    team.leave(team.boards.pop("a2"))
    team.run()
    stream.check()
    assert team.world.why == ""
    spoke = stream.boards("a")
    assert (spoke[0], spoke[5], spoke[-1]) == ("board-a", "board-a2", "board-a")
    assert {key[3] for key in stream.beliefs} == set(range(9))
    if fusion == "opinions":  # a joint begins with what robots say of themselves
        assert stream.beliefs == calm(fusion)[1]


def test_a_board_that_comes_back_at_once_does_not_lead_with_nothing() -> None:
    """Its token was away for less than the grace: the others never saw it go."""
    team = pair("opinions")
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == 3)
    team.leave(team.boards["a"])
    back = team.boards["a"] = board_of(team.scenario, "a", "board-a")
    team.join(back)
    team.run()
    stream.check()
    assert team.world.why == ""
    assert stream.boards("a")[3:] == ["board-a2"] * 6


@pytest.mark.parametrize(("fusion", "tick"), [("opinions", 1), ("joint", 4)])
def test_in_real_time_the_death_of_a_leader_costs_two_ticks_at_most(fusion: str, tick: int) -> None:
    team = pair(fusion, "realtime")
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == tick)
    team.leave(team.boards.pop("a"))
    team.run()
    stream.check()
    assert team.world.why == ""
    assert not any(board.refused for board in team.boards.values())
    assert not any(robot.refused for robot in team.robots.values())
    agreed = {(c.sub_team, c.tick) for c in stream.sent if c.level == "agreed" and c.subject == "robot/r1"}
    assert len({t for sub_team, t in agreed if sub_team == "a"}) >= 9 - 2
    missing = team.world.referee.missing().get("robot/r1", {}).get("agreed", 0)
    assert missing <= 2


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_frozen_leader_is_given_up_and_follows_when_it_thaws(mode: str) -> None:
    team = pair("opinions", mode)
    stream = Stream(team)
    team.run_until(lambda: team.world.tick == 3)
    frozen = team.boards["a"]
    team.freeze(frozen)
    since = team.now
    team.run_until(lambda: bool(team.boards["a2"].lead.leads))
    assert team.now - since < 8.0
    later = team.world.tick
    team.run_until(lambda: team.world.done or team.world.tick >= min(later + 2, 8))
    team.thaw(frozen)
    team.run_until(lambda: frozen.lead.role is BoardRole.FOLLOWS)
    team.run_until(lambda: team.world.done)
    stream.check()
    assert team.world.why == ""
    assert (frozen.lead.leads, team.boards["a2"].lead.leads) == (False, True)


def test_a_router_that_is_away_moves_no_lead() -> None:
    team = pair("opinions")
    team.run_until(lambda: team.world.tick == 3)
    before = {name: (board.lead.leads, board.lead.term) for name, board in team.boards.items()}
    tokens = [token for link in team.bus.links for token in link.tokens]
    for kind in (Kind.GONE, Kind.ALIVE):
        for token in tokens:
            team.bus.announce(token, kind)
        team.run_until(lambda: not team.bus.waiting)
    team.run()
    assert team.world.why == ""
    assert {name: (board.lead.leads, board.lead.term) for name, board in team.boards.items()} == before
