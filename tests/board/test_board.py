"""The board of one sub-team: the reports it takes, the consensuses it settles, and what it does not count twice."""

import numpy as np
import pytest

from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, blur, gaussian
from blackboard.opinion.believed import MAX_SOURCES, MAX_SUBJECTS
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import POOLS
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Report
from tests.board.reports import FINE, GRID, at, fine, new_board, only, report, said_by, same

BOTH = {"r1": 0.0, "r2": 0.0}


def test_arrival_order_changes_nothing() -> None:
    said = [
        report(f"r{i}", at(5 + 3 * i, 9 + i, 1 + i), informed=(at(8, 9, 2), {"r1": 0.0, f"r{i}": 0.0}))
        for i in range(4)
    ]
    first, second = new_board(), new_board()
    for r in said:
        first.hear(r, 0.0)
    for r in reversed(said):
        second.hear(r, 0.0)
    assert first.settle(0, 0.0) == second.settle(0, 0.0)


@pytest.mark.parametrize("rule", sorted(POOLS))
def test_members_that_rule_each_other_out_do_not_end_the_board(rule: str) -> None:
    """One-hot beliefs in different cells: a rule with a veto leaves no cell, and both hypotheses stay."""
    board = new_board(rule=rule)
    for source, cell in (("r1", (3, 4)), ("r2", (30, 20))):
        p = np.zeros(GRID.shape)
        p[cell] = 1.0
        board.hear(report(source, Belief(GRID, p)), 0.0)
    assert unpack(only(board.settle(0, 0.0)).belief).p.sum() == pytest.approx(1.0)


def test_an_echo_gains_nothing() -> None:
    """The same information told again through a team-mate (ancestor r1) leaves the consensus as it was."""
    board = new_board()
    board.hear(report("r1", at(10, 10, 2)), 0.0)
    alone = only(board.settle(0, 0.0))
    echo = unpack(alone.belief)
    board.hear(report("r2", gaussian(GRID, (20, 15), 500), informed=(echo, {"r1": 0.0, "r2": 0.0})), 0.0)
    again = only(board.settle(0, 0.0))
    assert again.entropy == pytest.approx(alone.entropy, abs=0.02)


def test_feeding_the_consensus_back_sharpens_only_where_the_paper_is_taken_literally() -> None:
    """The echo loop of theory.md: adopt the consensus, report it, no new data. Guarded: nothing is gained."""
    gained = {}
    for feedback in ("guarded", "paper", "off"):
        board, informed = new_board(feedback=feedback, independence=1.0), None
        entropies = []
        for tick in range(4):
            for source, x in (("r1", 10), ("r2", 12)):
                board.hear(report(source, at(x, 10, 2), tick=tick, time=float(tick), informed=informed), float(tick))
            consensus = only(board.settle(tick, float(tick)))
            informed = unpack(consensus.belief), consensus.ancestors
            entropies.append(consensus.entropy)
        gained[feedback] = entropies[0] - entropies[-1]
    assert abs(gained["guarded"]) < 0.05
    assert abs(gained["off"]) < 1e-9
    assert gained["paper"] > 1.0


def test_an_older_word_does_not_replace_a_newer_one() -> None:
    board = new_board()
    board.hear(report("r1", at(10, 10, 1), time=2.0, tick=2), 2.0)
    before = board.settle(2, 2.0)
    board.hear(report("r1", at(30, 20, 1), time=1.0, tick=1), 2.0)
    assert board.settle(2, 2.0) == before


def test_beliefs_on_another_grid_are_refused() -> None:
    board = new_board()
    with pytest.raises(Refused, match="^grid:"):
        board.hear(report("r1", gaussian(Grid((40, 31)), (1, 1), 1)), 0.0)
    assert board.settle(0, 0.0) == []


# --- ages, limits, weights and stamps, exactly ---------------------------------------------------------------------------


def test_an_old_opinion_has_spread_by_the_drift_per_square_root_of_a_second() -> None:
    board = new_board(grid=FINE, drift=0.8, max_age=10.0)
    said = fine(10, 6, 0.9)
    board.hear(report("r1", said, 3.0), 3.0)
    consensus = only(board.settle(7, 5.25))
    same(consensus, blur(said.p, 0.8 * 1.5 / 0.5), abs=1e-9)  # 2.25 s of age, cells of 0.5 m
    used = consensus.used[0]
    assert used.age == pytest.approx(2.25)
    assert used.entropy == pytest.approx(entropy(blur(said.p, 2.4)), abs=1e-6)


@pytest.mark.parametrize(("drift", "time", "settled", "age"), [(0.0, 3.0, 5.25, 2.25), (0.8, 3.5, 3.0, 0.0)])
def test_without_a_drift_an_opinion_is_old_and_from_a_clock_that_is_ahead_it_is_new(
    drift: float, time: float, settled: float, age: float
) -> None:
    board = new_board(grid=FINE, drift=drift, max_age=10.0, future=1.0)
    said = fine(10, 6, 0.9)
    board.hear(report("r1", said, time), 3.0)
    consensus = only(board.settle(7, settled))
    same(consensus, said.p)
    assert consensus.used[0].age == pytest.approx(age)


def test_stamps_are_taken_up_to_the_limits_and_refused_beyond() -> None:
    board = new_board(grid=FINE, max_age=4.0, future=0.5)
    for time in (6.0, 10.5):
        board.hear(report("r1", fine(10, 6, 1), time), 10.0)
        board.hear_consensus(said_by("b", fine(10, 6, 1), time=time), 10.0)
    for time, reason, words in (
        (5.9, "past", "stamped 4.1 s ago, older"),
        (10.6, "future", "stamped 0.6 s ahead of team time 10.0 s"),
    ):
        for hear in (
            lambda time=time: board.hear(report("r1", fine(10, 6, 1), time), 10.0),
            lambda time=time: board.hear_consensus(said_by("b", fine(10, 6, 1), time=time), 10.0),
        ):
            with pytest.raises(Refused, match=words) as refusal:
                hear()
            assert refusal.value.reason == reason


def test_a_silent_source_is_left_out_once_with_its_age() -> None:
    board = new_board(grid=FINE, max_age=4.0)
    board.hear(report("r1", fine(10, 6, 1), 1.0), 1.0)
    board.hear(report("r2", fine(10, 6, 1), 4.0), 4.0)
    assert only(board.settle(0, 5.0)).left_out == []  # as old as is taken
    consensuses = [only(board.settle(tick, 5.5)) for tick in (1, 2)]
    assert [(left.source, left.reason) for left in consensuses[0].left_out] == [("r1", "silent for 4.5 s")]
    assert consensuses[1].left_out == []
    assert [used.source for used in consensuses[1].used] == ["r2"]


def test_a_later_report_of_the_same_time_replaces_the_earlier() -> None:
    board = new_board(grid=FINE)
    board.hear(report("r1", fine(10, 6, 1)), 0.0)
    second = fine(14, 8, 1)
    board.hear(report("r1", second), 0.0)
    same(only(board.settle(0, 0.0)), second.p)


def test_only_what_was_said_before_the_tick_is_withdrawn() -> None:
    board = new_board(grid=FINE)
    for tick, subject in ((1, "object/a"), (2, "object/b"), (3, "object/c")):
        board.hear(report("r1", fine(10, 6, 1), tick=tick, subject=subject), 0.0)
    board.hear(report("r2", fine(10, 6, 1), tick=1, subject="object/a"), 0.0)
    board.withdraw("r1", 2, [])
    assert [(c.subject, [u.source for u in c.used]) for c in board.settle(3, 0.0)] == [
        ("object/a", ["r2"]),
        ("object/b", ["r1"]),
        ("object/c", ["r1"]),
    ]
    board.withdraw("r1", 9, ["object/c"])
    assert [c.subject for c in board.settle(3, 0.0)] == ["object/a", "object/c"]


TINY = Grid((3,))


def tiny(source: str, cell: int, subject: str, time: float = 0.0) -> Report:
    """A one-hot belief on a small grid: only how many there are matters."""
    p = np.zeros(TINY.shape)
    p[cell] = 1.0
    return Report(source=source, subject=subject, tick=0, time=time, belief=pack(Belief(TINY, p)))


def test_as_many_subjects_and_sources_as_fit_may_go_on() -> None:
    board = new_board(grid=TINY)
    for i in range(MAX_SUBJECTS):
        board.hear(tiny("r1", 0, f"object/o{i}"), 0.0)
    with pytest.raises(Refused, match="too-many"):
        board.hear(tiny("r1", 0, "object/one-more"), 0.0)
    board.hear(tiny("r1", 1, "object/o0"), 0.0)
    for i in range(2, MAX_SOURCES + 1):
        board.hear(tiny(f"r{i}", 1, "object/o0"), 0.0)
    board.hear(tiny("r1", 2, "object/o1"), 0.0)
    board.hear(tiny("r1", 1, "object/o0"), 0.0)
    first, second, *_ = board.settle(0, 0.0)
    assert len(first.used) == MAX_SOURCES
    assert [unpack(c.belief).p.argmax() for c in (first, second)] == [1, 2]


def test_a_source_too_many_is_refused_where_all_say_equally_much() -> None:
    board = new_board(grid=TINY)
    for i in range(MAX_SOURCES):
        board.hear(tiny(f"r{i}", 1, "object/o0"), 0.0)
    with pytest.raises(Refused, match="too-many"):
        board.hear(tiny("one-more", 1, "object/o0"), 0.0)


def test_a_subject_that_nobody_speaks_of_any_more_makes_room() -> None:
    board = new_board(grid=TINY, max_age=4.0)
    for i in range(MAX_SUBJECTS):
        board.hear(tiny("r1", 0, f"object/o{i}"), 0.0)
    assert board.settle(0, 4.5) == []
    board.hear(tiny("r1", 0, "object/new", 4.5), 4.5)
    assert only(board.settle(0, 4.5)).subject == "object/new"


@pytest.mark.parametrize(("feedback", "sources"), [("guarded", 2), ("paper", 1), ("off", 1)])
def test_feedback_says_which_opinions_of_a_report_count(feedback: str, sources: int) -> None:
    first, informed = fine(10, 6, 2), fine(10.5, 6, 1)
    board = new_board(grid=FINE, feedback=feedback)
    board.hear(report("r1", first, informed=(informed, BOTH)), 0.0)
    consensus = only(board.settle(0, 0.0))
    assert len(consensus.used) == sources
    assert consensus.ancestors == ({"r1": 0.0} if feedback == "off" else BOTH)
    if sources == 1:
        same(consensus, (first if feedback == "off" else informed).p)


def test_a_consensus_carries_its_stamps_and_its_story() -> None:
    board = new_board("b", grid=FINE, k=1.5)
    first, second = fine(10, 6, 2), fine(10.5, 6, 1)
    board.hear(report("r1", first, 2.0), 2.0)
    board.hear(report("r2", second, 2.0), 2.0)
    consensus = only(board.settle(4, 2.0))
    assert (consensus.board, consensus.sub_team, consensus.level) == ("board-b", "b", "consensus")
    assert (consensus.subject, consensus.tick, consensus.time) == ("object/ball", 4, 2.0)
    assert consensus.firsthand is None  # it is the belief itself
    assert [u.how for u in consensus.used] == ["independent"] * 2
    assert [u.entropy for u in consensus.used] == pytest.approx([entropy(first.p), entropy(second.p)])
    assert consensus.entropy == pytest.approx(entropy(unpack(consensus.belief).p), abs=0.02)
