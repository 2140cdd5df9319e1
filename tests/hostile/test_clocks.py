"""Clocks that are not the world's: none is followed for longer than it must be."""

import pytest

from blackboard.process.team_clock import CLOCKLESS
from blackboard.wire import keys
from tests.board.desk import NOW, WORLD, Desk, clock, levels, report
from tests.hostile.attack import Attack, calm


def test_where_no_world_runs_a_stranger_s_clock_or_token_delays_for_seconds_only() -> None:
    desk = Desk(world=False, period=0.5)
    desk.register("r1")
    desk.tell(WORLD)  # a token without a Clock
    desk.tell(report("r1", 7, time=NOW))
    assert desk.wait(1.0) == [] or levels(desk.said) == []
    desk.wait(CLOCKLESS)
    desk.tell(report("r1", 8, time=desk.now))
    desk.wait(0.6)
    assert "agreed" in levels(desk.said)


@pytest.mark.parametrize("goes_on", [False, True])
def test_who_sends_a_clock_from_before_the_world_began_is_not_followed_when_it_begins(goes_on: bool) -> None:
    desk = Desk(world=False, period=0.5)
    desk.register("r1")
    for i in range(60):
        if i == 20:
            desk.tell(WORLD)
        desk.tell(clock(i if goes_on else 0, "r1", run="false"))
        if i > 20:
            desk.tell(clock(i - 20, "r1", run="true"))
            assert desk.service.clock.followed is not None
            assert (desk.service.clock.followed.run, desk.service.clock.tick) == ("true", i - 20)
        desk.wait(0.25)


def test_a_clock_whose_token_comes_very_late_is_followed_after_a_while() -> None:
    desk = Desk(world=False, period=0.5)
    for i in range(60):
        if i == 20:
            desk.tell(WORLD)
        desk.tell(clock(i, "r1", run="true"))
        desk.wait(0.25)
    assert desk.service.clock.followed is not None
    assert desk.service.clock.tick == 59


@pytest.mark.parametrize("token", [keys.MEMBER.key(team="t", sub_team="a", robot="r1"), keys.WORLD.key(team="t")])
def test_a_token_that_two_processes_hold_changes_not_a_bit(token: str) -> None:
    attack = Attack()
    second = attack.team.bus.connect()
    second.token(token)
    attack.team.run_until(lambda: attack.team.world.tick == 3)
    second.close()
    attack.goes_on()
    assert attack.hash == calm()
