"""Robots that the scenario does not name: whom a board hears, and how much many of them count."""

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
from tests.board.desk import report as sent
from tests.board.reports import GRID, at, report

THING = "object/ball"


def team(guests: str) -> TeamSection:
    return TeamSection.model_validate({"sub_teams": {"a": ["r1", "r2"]}, "guests": guests})


def new_board(**settings: object) -> Board:
    return Board("a", "board-a", GRID, BoardSection.model_validate(settings), guests=Guests(team("vote")))


def about(subject: str, consensuses: list[Consensus]) -> Consensus:
    return next(consensus for consensus in consensuses if consensus.subject == subject)


def test_a_guest_that_may_only_listen_is_refused_is_told_the_cure_and_is_not_waited_for() -> None:
    desk = Desk("r1", "zoe", members=team("watch"))
    said = desk.tell(clock(0, "r1", "zoe"), sent("zoe", 0), sent("r1", 0), reported("r1", 0, THING))
    assert any("/consensus/" in envelope.key for envelope in said)  # r1 has reported, and that is all there is to come
    assert desk.service.refused["guest"] == 1
    (refusal,) = [decode(Refusal, envelope.payload) for envelope in desk.said if keys.REFUSED.match(envelope.key)]
    assert (refusal.robot, refusal.reason) == ("zoe", "guest")
    assert (
        refusal.text == 'zoe is not named in the scenario: name it in [team] sub_teams, or set [team] guests = "vote"'
    )


def test_a_guest_that_is_heard_is_waited_for() -> None:
    desk = Desk("r1", "zoe", members=team("vote"))
    assert not [
        envelope
        for envelope in desk.tell(clock(0, "r1", "zoe"), sent("r1", 0), reported("r1", 0, THING))
        if "/consensus/" in envelope.key
    ]
    assert [
        envelope for envelope in desk.tell(sent("zoe", 0), reported("zoe", 0, THING)) if "/consensus/" in envelope.key
    ]


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
    crowd, single = new_board(**chosen), new_board(**chosen)
    names = [f"g{number}" for number in range(guests)]
    for board in (crowd, single):
        for robot in ("r1", "r2"):
            board.hear(report(robot, at(10, 10, 1)), 0.0)
    for name in names:
        crowd.hear(report(name, at(30, 20, 1)), 0.0)
    single.hear(report("g0", at(30, 20, 1)), 0.0)
    (crowded,), (expected,) = crowd.settle(0, 0.0), single.settle(0, 0.0)
    assert np.array_equal(unpack(crowded.belief).p, unpack(expected.belief).p)
    assert [guest.source for guest in crowded.left_out] == names[1:]
    assert [guest.source for guest in crowded.used] == ["g0", "r1", "r2"]


def test_they_take_turns_and_all_of_them_count_where_nobody_else_speaks() -> None:
    def counted(time: float, *robots: str) -> list[str]:
        board = new_board()
        for robot in robots:
            board.hear(report(robot, at(10, 10, 1), time), time)
        return [opinion.source for opinion in board.settle(0, time)[0].used]

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
    board = new_board()
    for time in (0.0, 0.2):
        for robot in ("g1", "g2"):
            board.hear(report(robot, at(12, 12, 2), time, subject=f"robot/{robot}"), time)
        board.hear(report(seer, at(x, 12, 1), time, subject="robot/g2"), time)
        for robot in ("r1", "g1", "g2"):
            board.hear(report(robot, at(10, 10, 1), time), time)
        consensus = about(THING, board.settle(0, time))
    assert ("g2" in [opinion.source for opinion in consensus.used]) == counts


def test_what_an_echo_says_of_a_guest_confirms_nothing() -> None:
    board, everybody = new_board(feedback="guarded"), {"g2": 0.0, "r1": 0.0}
    for time in (0.0, 0.2):
        board.hear(report("g2", at(12, 12, 2), time, subject="robot/g2"), time)
        vague = at(20, 15, 40)
        board.hear(report("r1", vague, time, subject="robot/g2", informed=(at(12, 12, 1), everybody)), time)
        for robot in ("r1", "g1", "g2"):
            board.hear(report(robot, at(10, 10, 1), time), time)
        consensus = about(THING, board.settle(0, time))
    assert [opinion.source for opinion in consensus.left_out] == ["g2"]


def test_who_comes_under_the_name_of_one_that_left_is_another_guest() -> None:
    guests = Guests(team("vote"))
    board = Board("a", "board-a", GRID, BoardSection(), guests=guests)
    board.hear(report("g1", at(12, 12, 2), subject="robot/g1"), 0.0)
    board.hear(report("r1", at(12, 12, 2), subject="robot/g1"), 0.0)
    board.settle(0, 0.0)
    assert not guests.waits("g1")
    board.withdraw("g1", 1, [])
    board.settle(1, 0.2)
    assert guests.waits("g1")
