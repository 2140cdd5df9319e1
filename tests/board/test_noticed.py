"""The board's numbers against exact expectations: ages, limits, weights and stamps, on a grid whose cell is not 1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from blackboard.board.board import Board
from blackboard.board.entries import MAX_SOURCES, MAX_SUBJECTS
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, blur, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, Report

GRID = Grid((40, 30), 0.5, (2.0, -1.0), "m")
BALL = "object/ball"
BOTH = {"r1": 0.0, "r2": 0.0}


def at(x: float, y: float, sigma: float) -> Belief:
    """As it is read from the wire."""
    return unpack(pack(gaussian(GRID, (x, y), sigma)))


def report(
    source: str, belief: Belief, time: float = 0.0, *, tick: int = 0, subject: str = BALL,
    informed: tuple[Belief, Mapping[str, float]] | None = None,
) -> Report:  # fmt: skip
    second = None if informed is None else Informed(belief=pack(informed[0]), ancestors=dict(informed[1]))
    return Report(source=source, subject=subject, tick=tick, time=time, belief=pack(belief), informed=second)


def board(sub_team: str = "a", **settings: object) -> Board:
    return Board(sub_team, f"board-{sub_team}", GRID, BoardSection.model_validate(settings))


def only(consensuses: list[Consensus]) -> Consensus:
    (consensus,) = consensuses
    return consensus


def same(consensus: Consensus, p: object, abs: float = 1e-12) -> None:
    assert unpack(consensus.belief).p == pytest.approx(unpack(pack(Belief(GRID, np.asarray(p)))).p, abs=abs)


def test_an_old_opinion_has_spread_by_the_drift_per_square_root_of_a_second() -> None:
    it = board(drift=0.8, max_age=10.0)
    said = at(10, 6, 0.9)
    it.hear(report("r1", said, 3.0), 3.0)
    consensus = only(it.settle(7, 5.25))
    same(consensus, blur(said.p, 0.8 * 1.5 / 0.5), abs=1e-9)  # 2.25 s of age, cells of 0.5 m
    used = consensus.used[0]
    assert used.age == pytest.approx(2.25)
    assert used.entropy == pytest.approx(entropy(blur(said.p, 2.4)), abs=1e-6)


def test_an_opinion_that_does_not_spread_is_old_all_the_same() -> None:
    it = board(drift=0.0, max_age=10.0)
    said = at(10, 6, 0.9)
    it.hear(report("r1", said, 3.0), 3.0)
    consensus = only(it.settle(7, 5.25))
    same(consensus, said.p)
    assert consensus.used[0].age == pytest.approx(2.25)


def test_an_opinion_from_a_clock_that_is_ahead_is_new() -> None:
    it = board(drift=0.8, future=1.0)
    said = at(10, 6, 0.9)
    it.hear(report("r1", said, 3.5), 3.0)
    consensus = only(it.settle(7, 3.0))
    same(consensus, said.p)
    assert consensus.used[0].age == 0.0


def test_stamps_are_taken_up_to_the_limits_and_refused_beyond() -> None:
    it = board(max_age=4.0, future=0.5)
    for time in (6.0, 10.5):
        it.hear(report("r1", at(10, 6, 1), time), 10.0)
        it.hear_consensus(said_by("b", time=time), 10.0)
    for time, reason, words in ((5.9, "past", "stamped 4.1 s ago"), (10.6, "future", "stamped 0.6 s ahead")):
        for hear in (
            lambda time=time: it.hear(report("r1", at(10, 6, 1), time), 10.0),
            lambda time=time: it.hear_consensus(said_by("b", time=time), 10.0),
        ):
            with pytest.raises(Refused, match=words) as refusal:
                hear()
            assert refusal.value.reason == reason


def test_a_silent_source_is_left_out_once_with_its_age() -> None:
    it = board(max_age=4.0)
    it.hear(report("r1", at(10, 6, 1), 1.0), 1.0)
    it.hear(report("r2", at(10, 6, 1), 4.0), 4.0)
    assert only(it.settle(0, 5.0)).left_out == []  # as old as is taken
    found = [only(it.settle(tick, 5.5)) for tick in (1, 2)]
    assert [(one.source, one.reason) for one in found[0].left_out] == [("r1", "silent for 4.5 s")]
    assert found[1].left_out == []
    assert [used.source for used in found[1].used] == ["r2"]


def test_a_later_report_of_the_same_time_replaces_the_earlier() -> None:
    it = board()
    it.hear(report("r1", at(10, 6, 1)), 0.0)
    second = at(14, 8, 1)
    it.hear(report("r1", second), 0.0)
    same(only(it.settle(0, 0.0)), second.p)


def test_only_what_was_said_before_the_tick_is_withdrawn() -> None:
    it = board()
    for tick, subject in ((1, "object/a"), (2, "object/b"), (3, "object/c")):
        it.hear(report("r1", at(10, 6, 1), tick=tick, subject=subject), 0.0)
    it.hear(report("r2", at(10, 6, 1), tick=1, subject="object/a"), 0.0)
    it.withdraw("r1", 2, [])
    assert [(c.subject, [u.source for u in c.used]) for c in it.settle(3, 0.0)] == [
        ("object/a", ["r2"]),
        ("object/b", ["r1"]),
        ("object/c", ["r1"]),
    ]
    it.withdraw("r1", 9, ["object/c"])
    assert [c.subject for c in it.settle(3, 0.0)] == ["object/a", "object/c"]


def tiny(source: str, cell: int, subject: str, time: float = 0.0) -> Report:
    """A one-hot belief on a small grid: only how many there are matters."""
    p = np.zeros(TINY.shape)
    p[cell] = 1.0
    return Report(source=source, subject=subject, tick=0, time=time, belief=pack(Belief(TINY, p)))


TINY = Grid((3,))


def test_as_many_subjects_and_sources_as_fit_may_go_on() -> None:
    it = Board("a", "a", TINY, BoardSection())
    for i in range(MAX_SUBJECTS):
        it.hear(tiny("r1", 0, f"object/o{i}"), 0.0)
    it.hear(tiny("r1", 1, "object/o0"), 0.0)
    for i in range(2, MAX_SOURCES + 1):
        it.hear(tiny(f"r{i}", 1, "object/o0"), 0.0)
    it.hear(tiny("r1", 2, "object/o1"), 0.0)
    it.hear(tiny("r1", 1, "object/o0"), 0.0)
    first, second, *_ = it.settle(0, 0.0)
    assert len(first.used) == MAX_SOURCES
    assert [unpack(c.belief).p.argmax() for c in (first, second)] == [1, 2]


def test_a_subject_that_nobody_speaks_of_any_more_makes_room() -> None:
    it = Board("a", "a", TINY, BoardSection(max_age=4.0))
    for i in range(MAX_SUBJECTS):
        it.hear(tiny("r1", 0, f"object/o{i}"), 0.0)
    assert it.settle(0, 4.5) == []
    it.hear(tiny("r1", 0, "object/new", 4.5), 4.5)
    assert only(it.settle(0, 4.5)).subject == "object/new"


@pytest.mark.parametrize(("feedback", "sources"), [("guarded", 2), ("paper", 1), ("off", 1)])
def test_feedback_says_which_opinions_of_a_report_count(feedback: str, sources: int) -> None:
    first, informed = at(10, 6, 2), at(10.5, 6, 1)
    it = board(feedback=feedback)
    it.hear(report("r1", first, informed=(informed, BOTH)), 0.0)
    consensus = only(it.settle(0, 0.0))
    assert len(consensus.used) == sources
    assert consensus.ancestors == ({"r1": 0.0} if feedback == "off" else BOTH)
    if sources == 1:
        same(consensus, (first if feedback == "off" else informed).p)


def test_a_consensus_carries_its_stamps_and_its_story() -> None:
    it = board("b", k=1.5)
    first, second = at(10, 6, 2), at(10.5, 6, 1)
    it.hear(report("r1", first, 2.0), 2.0)
    it.hear(report("r2", second, 2.0), 2.0)
    consensus = only(it.settle(4, 2.0))
    assert (consensus.board, consensus.sub_team, consensus.level) == ("board-b", "b", "consensus")
    assert (consensus.subject, consensus.tick, consensus.time) == (BALL, 4, 2.0)
    assert consensus.firsthand is None  # it is the belief itself
    assert [u.how for u in consensus.used] == ["independent"] * 2
    assert [u.entropy for u in consensus.used] == pytest.approx([entropy(first.p), entropy(second.p)])
    assert consensus.entropy == pytest.approx(entropy(unpack(consensus.belief).p), abs=0.02)


# --- the exchange --------------------------------------------------------------------------------------------------------


def said_by(sub_team: str, belief: Belief | None = None, *, time: float = 0.0, tick: int = 0) -> Consensus:
    it = board(sub_team)
    it.hear(report(f"robot-{sub_team}", belief or at(10, 6, 1), time), time)
    return only(it.settle(tick, time))


def test_an_exchange_ages_names_and_forgets_like_a_settlement() -> None:
    it = board("a", drift=0.8, max_age=4.0)
    theirs = at(10, 6, 0.9)
    it.hear_consensus(said_by("b", theirs, time=1.0, tick=3), 1.0)
    agreed = only(it.exchange(5, 3.25))
    assert (agreed.level, agreed.board, agreed.tick, agreed.time) == ("agreed", "board-a", 5, 3.25)
    same(agreed, blur(theirs.p, 0.8 * 1.5 / 0.5), abs=1e-9)
    assert agreed.ancestors == {"robot-b": 1.0}
    it.hear_consensus(said_by("c", theirs, time=5.5), 5.5)
    later = only(it.exchange(6, 5.5))
    assert [(one.source, one.reason) for one in later.left_out] == [("b", "silent for 4.5 s")]
    assert it.exchange(7, 10.0) == []


def test_one_subject_with_nothing_left_does_not_end_the_others() -> None:
    it = board("a", max_age=4.0)
    for subject, time in (("object/a", 0.0), ("object/b", 3.0)):
        it.hear_consensus(said_by("b", time=time).model_copy(update={"subject": subject}), time)
    assert [c.subject for c in it.exchange(0, 5.0)] == ["object/b"]


def test_the_exchange_multiplies_first_hand_parts_and_not_what_they_were_told() -> None:
    first = board("b")
    own, informed = at(10, 6, 2), at(10.5, 6, 1)
    first.hear(report("r1", own, informed=(informed, BOTH)), 0.0)
    theirs = only(first.settle(0, 0.0))
    it = board("a")
    it.hear_consensus(theirs, 0.0)
    it.hear_consensus(said_by("c", at(10, 7, 2)), 0.0)
    used = only(it.exchange(0, 0.0)).used
    assert [(u.source, u.how) for u in used] == [("b", "independent"), ("c", "independent"), ("b", "overlapping")]
