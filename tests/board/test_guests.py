"""Robots that the scenario does not name: whom a board hears, and how much many of them count."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.board import Board
from blackboard.board.guests import TURN, Guests
from blackboard.config import BoardSection, TeamSection
from blackboard.opinion.pools import POOLS
from blackboard.wire import keys
from blackboard.wire.arrays import unpack
from blackboard.wire.codec import decode
from blackboard.wire.messages import Consensus, Refusal
from tests.board.desk import Desk, clock, reported
from tests.board.desk import report as told
from tests.board.reports import GRID, at, report

THING = "object/ball"


def team(guests: str) -> TeamSection:
    return TeamSection.model_validate({"sub_teams": {"a": ["r1", "r2"]}, "guests": guests})


def board(**settings: object) -> Board:
    return Board("a", "board-a", GRID, BoardSection.model_validate(settings), guests=Guests(team("vote")))


def about(subject: str, found: list[Consensus]) -> Consensus:
    return next(it for it in found if it.subject == subject)


def test_a_guest_that_may_only_listen_is_refused_is_told_the_cure_and_is_not_waited_for() -> None:
    desk = Desk(members=team("watch"))
    desk.register("r1", "zoe")
    said = desk.tell(clock(0, "r1", "zoe"), told("zoe", 0), told("r1", 0), reported("r1", 0, THING))
    assert any("/consensus/" in it.key for it in said)  # r1 has reported, and that is all there is to come
    assert desk.it.refused["guest"] == 1
    (refusal,) = [decode(Refusal, it.payload) for it in desk.said if keys.REFUSED.match(it.key)]
    assert (refusal.robot, refusal.reason) == ("zoe", "guest")
    assert (
        refusal.text == 'zoe is not named in the scenario: name it in [team] sub_teams, or set [team] guests = "vote"'
    )


def test_a_guest_that_is_heard_is_waited_for() -> None:
    desk = Desk(members=team("vote"))
    desk.register("r1", "zoe")
    assert not [
        it
        for it in desk.tell(clock(0, "r1", "zoe"), told("r1", 0), reported("r1", 0, THING))
        if "/consensus/" in it.key
    ]
    assert [it for it in desk.tell(told("zoe", 0), reported("zoe", 0, THING)) if "/consensus/" in it.key]


def test_where_the_scenario_names_nobody_nobody_is_a_guest() -> None:
    for nobody in (Guests(), Guests(TeamSection())):
        assert nobody.may_report("zoe")
        assert not nobody.waits("zoe")
    assert Guests(team("none")).may_report("r1")
    assert not Guests(team("none")).may_report("zoe")


@settings(deadline=None, max_examples=15)
@given(
    st.sampled_from(sorted(POOLS)),
    st.sampled_from(["paper", "guarded", "off"]),
    st.sampled_from(["joint", "opinions"]),
    st.integers(1, 9),
)
def test_guests_that_nobody_has_seen_count_together_for_one(rule: str, feedback: str, fusion: str, guests: int) -> None:
    chosen = {"rule": rule, "feedback": feedback, "fusion": fusion}
    crowd, one = board(**chosen), board(**chosen)
    names = [f"g{number}" for number in range(guests)]
    for it in (crowd, one):
        for robot in ("r1", "r2"):
            it.hear(report(robot, at(10, 10, 1)), 0.0)
    for name in names:
        crowd.hear(report(name, at(30, 20, 1)), 0.0)
    one.hear(report("g0", at(30, 20, 1)), 0.0)
    (found,), (expected,) = crowd.settle(0, 0.0), one.settle(0, 0.0)
    assert np.array_equal(unpack(found.belief).p, unpack(expected.belief).p)
    assert [it.source for it in found.left_out] == names[1:]
    assert [it.source for it in found.used] == ["g0", "r1", "r2"]


def test_they_take_turns_and_all_of_them_count_where_nobody_else_speaks() -> None:
    def counted(time: float, *robots: str) -> list[str]:
        it = board()
        for robot in robots:
            it.hear(report(robot, at(10, 10, 1), time), time)
        return [one.source for one in it.settle(0, time)[0].used]

    assert [counted(time, "r1", "g1", "g2") for time in (0.0, TURN, 2 * TURN)] == [
        ["g1", "r1"],
        ["g2", "r1"],
        ["g1", "r1"],
    ]
    assert counted(0.0, "g1", "g2") == ["g1", "g2"]


@pytest.mark.parametrize(
    ("seer", "x", "counts"),
    [("r1", 12.0, True), ("r1", 25.0, False), ("g3", 12.0, False)],
    ids=["seen where it says", "seen elsewhere", "seen by another guest"],
)
def test_a_guest_counts_once_a_named_robot_has_seen_it_where_it_says_it_is(seer: str, x: float, counts: bool) -> None:
    it = board()
    for time in (0.0, 0.2):
        for robot in ("g1", "g2"):
            it.hear(report(robot, at(12, 12, 2), time, subject=f"robot/{robot}"), time)
        it.hear(report(seer, at(x, 12, 1), time, subject="robot/g2"), time)
        for robot in ("r1", "g1", "g2"):
            it.hear(report(robot, at(10, 10, 1), time), time)
        found = about(THING, it.settle(0, time))
    assert ("g2" in [one.source for one in found.used]) == counts


def test_what_an_echo_says_of_a_guest_confirms_nothing() -> None:
    it, everybody = board(feedback="guarded"), {"g2": 0.0, "r1": 0.0}
    for time in (0.0, 0.2):
        it.hear(report("g2", at(12, 12, 2), time, subject="robot/g2"), time)
        vague = at(20, 15, 40)
        it.hear(report("r1", vague, time, subject="robot/g2", informed=(at(12, 12, 1), everybody)), time)
        for robot in ("r1", "g1", "g2"):
            it.hear(report(robot, at(10, 10, 1), time), time)
        found = about(THING, it.settle(0, time))
    assert [one.source for one in found.left_out] == ["g2"]


def test_who_comes_under_the_name_of_one_that_left_is_another_guest() -> None:
    guests = Guests(team("vote"))
    it = Board("a", "board-a", GRID, BoardSection(), guests=guests)
    it.hear(report("g1", at(12, 12, 2), subject="robot/g1"), 0.0)
    it.hear(report("r1", at(12, 12, 2), subject="robot/g1"), 0.0)
    it.settle(0, 0.0)
    assert not guests.waits("g1")
    it.withdraw("g1", 1, [])
    it.settle(1, 0.2)
    assert guests.waits("g1")
