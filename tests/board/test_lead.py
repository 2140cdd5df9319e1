"""Which of a sub-team's boards leads: at the start, when one dies, freezes or comes back, and what is never lost or said twice."""

import math

from blackboard.board.lead import HOLD, MAX_KEPT, BoardRole
from blackboard.wire.codec import decode
from blackboard.wire.envelope import Kind
from blackboard.wire.messages import Consensus, Status
from tests.board.desk import Desk, board_of, clock, leading, levels, report, reported
from tests.board.seat import SILENT, Seat


def test_a_board_alone_leads_at_once_and_tells_nobody() -> None:
    seat = Seat()
    assert not seat.here()
    assert (seat.lead.leads, seat.lead.leader, seat.lead.changes_at()) == (True, "x", math.inf)


def test_a_board_that_starts_waits_for_the_others_and_follows_who_leads() -> None:
    seat = Seat(since=8.0)
    assert seat.here("w", "z")
    assert seat.lead.role is BoardRole.UNKNOWN
    assert seat.lead.changes_at() == seat.now + HOLD
    seat.hear("z", follows=True)
    assert seat.lead.role is BoardRole.UNKNOWN
    assert seat.hear("w")
    assert (seat.lead.role, seat.lead.leader) == (BoardRole.FOLLOWS, "w")
    assert not seat.hear("w", tick=1)


def test_where_nobody_leads_the_one_that_settles_for_longest_does_then_the_first_name() -> None:
    for others, leads in (
        ({"w": 0.0}, False),
        ({"y": 0.0}, True),
        ({"y": -1.0}, False),
        ({"w": 1.0}, True),
        ({"w": None}, True),
    ):
        seat = Seat()
        seat.here(*others)
        for board, since in others.items():
            seat.hear(board, follows=True, since=since, phase="idle")
        assert seat.lead.leads is leads, others


def test_who_says_nothing_at_all_is_not_waited_for_longer_than_its_first_status_may_take() -> None:
    seat = Seat()
    seat.here("w")
    seat.wait(HOLD - 0.25)
    assert seat.lead.role is BoardRole.UNKNOWN
    assert seat.wait(0.5)
    assert seat.lead.leads


def test_a_board_that_waits_for_two_is_due_once_the_second_wait_is_over() -> None:
    """Once the first wait was over, a look was always due, and the process span until the second was."""
    seat = Seat()
    seat.here("w")
    seat.wait(1.0)
    seat.here("y")
    until = seat.now + HOLD
    seat.wait(0.75)
    assert seat.lead.role is BoardRole.UNKNOWN
    assert seat.lead.changes_at() == until


def test_the_one_that_leads_goes_on_whoever_comes() -> None:
    seat = Seat()
    seat.here()
    assert seat.here("w"), "it is told at once"
    assert seat.hear("w", follows=True, since=None)
    assert seat.lead.leads


def test_of_two_that_lead_the_one_that_took_over_stays_then_the_older_then_the_first_name() -> None:
    for part, leads in (
        ({"term": 1, "since": 9.0}, False),
        ({"since": -1.0}, False),
        ({"since": 1.0}, True),
        ({}, False),
    ):
        seat = Seat()
        seat.here()
        seat.here("w")
        seat.hear("w", **part)
        assert seat.lead.leads is leads, part


def test_the_death_of_the_leader_is_followed_by_what_it_did_not_say() -> None:
    seat = Seat()
    seat.here("w")
    seat.hear("w")
    for tick in (1, 2):
        seat.settle(tick, "consensus")
        seat.settle(tick)
    seat.hear("w", tick=2, phase="consensus")
    seat.here("w", kind=Kind.GONE)
    assert seat.lead.role is BoardRole.FOLLOWS
    assert seat.wait(0.75)
    assert (seat.lead.leads, seat.lead.term) == (True, 1)
    assert seat.kept() == [(2, "agreed")]
    assert seat.kept() == []


def test_a_leader_that_lives_and_says_nothing_new_is_given_up() -> None:
    seat = Seat()
    seat.here("w")
    seat.hear("w")
    seat.wait(10.0)
    assert seat.lead.role is BoardRole.FOLLOWS, "nothing was settled"
    seat.settle(1)
    assert seat.lead.changes_at() == seat.now + SILENT
    for _ in range(4):
        seat.wait(1.0)
        seat.hear("w")  # the same again
    assert seat.lead.role is BoardRole.FOLLOWS
    seat.wait(1.25)
    assert (seat.lead.leads, seat.lead.term) == (True, 1)
    seat.hear("w", tick=1)
    assert seat.lead.leads, "the one before comes back with the older term"


def test_a_board_that_was_frozen_is_as_one_that_starts() -> None:
    seat = Seat()
    seat.here("w")
    seat.hear("w", follows=True)
    seat.hear("w", follows=True, since=3.0)
    assert seat.lead.leads
    seat.now += 3.0
    assert seat.lead.look(seat.now)
    assert (seat.lead.role, seat.lead.since) == (BoardRole.UNKNOWN, None)
    seat.hear("w", follows=True, since=3.0)  # from before it took over
    assert seat.lead.role is BoardRole.FOLLOWS
    seat.hear("w", term=1, since=3.0)
    assert seat.lead.leader == "w"


def test_a_status_of_another_run_drops_nothing() -> None:
    seat = Seat()
    seat.here("w")
    seat.settle(1)
    status = Status(process="w", kind="board", tick=9, time=50.0, phase="agreed")
    seat.lead.hear_status(status, seat.now, 1.2, any_tick=False)
    assert seat.kept() == [(1, "agreed")]


def test_what_is_kept_is_bounded() -> None:
    seat = Seat()
    for tick in range(2 * MAX_KEPT):
        seat.settle(tick)
    assert len(seat.kept()) == MAX_KEPT


def test_nothing_older_is_said_than_what_the_leader_said() -> None:
    """Where ticks are each board's own count, a leader whose clock is ahead was ahead in what it published."""
    seat = Seat()
    seat.here("w")
    seat.hear("w", tick=10)
    seat.here("w", kind=Kind.GONE)
    seat.wait(0.75)
    assert (seat.lead.may_say(1.9), seat.lead.may_say(2.0)) == (False, True)


# --- in a board process -------------------------------------------------------------------------------------------------


def test_without_a_world_a_follower_publishes_its_status_alone_until_the_leader_is_gone() -> None:
    desk = Desk("r1", world=False)
    desk.tell(board_of("a"), board_of("a", name="0a"), leading("0a", time=desk.now - 60.0))
    desk.tell(report("r1", 0, time=desk.now))
    assert levels(desk.wait(0.2)) == []
    assert desk.status().follows
    desk.tell(report("r1", 1, time=desk.now), board_of("a", Kind.GONE, name="0a"))
    assert levels(desk.wait(0.4)) == []
    said = desk.wait(0.2)
    assert "agreed" in levels(said)
    times = [decode(Consensus, e.payload).time for e in said if "/agreed/" in e.key]
    assert times == sorted(times)
    assert not desk.status().follows
    assert desk.service.counters["late"] == 0


def test_a_follower_answers_a_repeated_clock_with_its_statuses() -> None:
    desk = Desk("r1")
    desk.tell(board_of("a", name="0a"), clock(0, "r1"), leading("0a", phase="idle"))
    said = desk.tell(report("r1", 0), reported("r1", 0, "object/ball"))
    assert [decode(Status, e.payload).phase for e in said] == ["consensus", "agreed"]
    assert [decode(Status, e.payload).subjects for e in said] == [[], []]
    again = desk.tell(clock(0, "r1"))
    assert [decode(Status, e.payload).phase for e in again] == ["consensus", "agreed"]
