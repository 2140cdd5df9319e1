"""Liveliness tokens of processes that say nothing, or nothing more: the run goes on, and no bit changes where nothing was said."""

import pytest

from blackboard.wire import keys
from blackboard.wire.messages import Status
from tests.hostile.attack import Attack, calm, status_key
from tests.scenarios import SCENARIO

SOON = 6.0  # seconds of the bus in which a run of its own takes next to none; the world gives nobody up before 20


def members(n: int = 100) -> list[str]:
    return [keys.MEMBER.key(team="t", sub_team="ab"[i % 2], robot=f"x{i}") for i in range(n)]


def boards(sub_team: str, *names: str) -> list[str]:
    return [keys.BOARD.key(team="t", sub_team=sub_team, board=name) for name in names]


TOKENS = {
    "100 robots": members(),
    "a board before one's own": boards("a", "a"),
    "a board after one's own": boards("a", "z"),
    "boards of both sub-teams": [*boards("a", "a", "z"), *boards("b", "a", "z")],
    "a board of a sub-team of its own": boards("z", "board-z"),
    "robots with a board of their own": [*boards("z", "x"), keys.MEMBER.key(team="t", sub_team="z", robot="x0")],
}


@pytest.mark.parametrize("tick", [-1, 2], ids=["from the beginning", "in the middle of a run"])
@pytest.mark.parametrize("name", TOKENS)
def test_who_holds_a_token_and_says_nothing_costs_nothing_and_changes_not_a_bit(name: str, tick: int) -> None:
    attack = Attack(tick=tick)
    silent = attack.team.bus.connect()
    for token in TOKENS[name]:
        silent.token(token)
    attack.goes_on()
    assert attack.hash == calm()
    assert attack.card["counters"].get("given_up", 0) == 0
    assert attack.card["wall_s"] < SOON


def test_robots_that_spoke_once_are_waited_for_once_and_briefly() -> None:
    attack = Attack()
    silent = attack.team.bus.connect()
    for token in members(10):
        silent.token(token)
    for i in range(10):
        said = Status(process=f"x{i}", kind="robot", tick=0, time=0.0, phase="idle", subjects=[])
        attack.say(status_key(f"x{i}", "ab"[i % 2]), said)
    attack.goes_on()
    assert attack.card["wall_s"] < SOON
    assert len(attack.team.world.members.given_up) == 10


def test_a_board_that_spoke_once_is_given_up_once() -> None:
    attack = Attack()
    attack.team.bus.connect().token(*boards("b", "z"))
    said = Status(process="z", kind="board", tick=0, time=0.0, phase="idle", subjects=[], follows=True)
    attack.say(status_key("z", "b"), said)
    attack.goes_on()
    assert attack.team.world.members.given_up == {"board/b/z"}
    assert attack.card["wall_s"] < 20.0 + SOON


def test_a_robot_that_the_scenario_does_not_name_takes_part_once_it_speaks() -> None:
    from robot_agent.team import robot_of

    attack = Attack()
    late = robot_of(SCENARIO.changed("team", sub_teams={"a": ["r1", "r2", "r9"], "b": ["r3"]}), "r9")
    attack.team.join(late)
    attack.goes_on()
    assert late.tick == attack.team.world.tick
    assert "r9" in attack.card["scores"]["robots"]["by_name"]
