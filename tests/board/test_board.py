"""The board of one sub-team: the reports it takes, the consensuses it settles, and what it does not count twice."""

from __future__ import annotations

import numpy as np
import pytest

from blackboard.board.board import Board
from blackboard.board.entries import MAX_SOURCES, MAX_SUBJECTS
from blackboard.config import BoardSection
from blackboard.errors import Refused
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import POOLS, chernoff, fuse
from blackboard.opinion.rules import read_rule
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Report
from tests.board.reports import GRID, at, board, only, report


def test_first_hand_reports_are_pooled_with_the_rule() -> None:
    it = board(rule="cooperative", gamma=0.5)
    said = {"r1": at(10, 10, 3), "r2": at(12, 11, 2), "r3": at(11, 9, 4)}
    for source, belief in said.items():
        it.hear(report(source, belief), 0.0)
    consensus = only(it.settle(0, 0.0))
    stack = np.stack([unpack(pack(b)).p for b in said.values()])
    pooled = fuse(read_rule({"rule": "cooperative", "k": 2, "gamma": 0.5}), stack, GRID)
    expected = Belief(GRID, pooled.p)
    assert np.array_equal(unpack(consensus.belief).p, unpack(pack(expected)).p)
    assert consensus.ancestors == {"r1": 0.0, "r2": 0.0, "r3": 0.0}
    assert [u.source for u in consensus.used] == ["r1", "r2", "r3"]
    assert [u.weight for u in consensus.used] == pytest.approx(pooled.weights)
    assert consensus.components == pytest.approx(pooled.components)
    assert consensus.outcome == "pooled"
    assert not consensus.conflict


def test_arrival_order_changes_nothing() -> None:
    said = [
        report(f"r{i}", at(5 + 3 * i, 9 + i, 1 + i), informed=(at(8, 9, 2), {"r1": 0.0, f"r{i}": 0.0}))
        for i in range(4)
    ]
    first, second = board(), board()
    for r in said:
        first.hear(r, 0.0)
    for r in reversed(said):
        second.hear(r, 0.0)
    assert first.settle(0, 0.0) == second.settle(0, 0.0)


@pytest.mark.parametrize("rule", sorted(POOLS))
def test_members_that_rule_each_other_out_do_not_end_the_board(rule: str) -> None:
    """One-hot beliefs in different cells: a rule with a veto leaves no cell, and both hypotheses stay."""
    it = board(rule=rule)
    for source, cell in (("r1", (3, 4)), ("r2", (30, 20))):
        p = np.zeros(GRID.shape)
        p[cell] = 1.0
        it.hear(report(source, Belief(GRID, p)), 0.0)
    assert unpack(only(it.settle(0, 0.0)).belief).p.sum() == pytest.approx(1.0)


def test_an_echo_gains_nothing() -> None:
    """The same information told again through a team-mate (ancestor r1) leaves the consensus as it was."""
    it = board()
    it.hear(report("r1", at(10, 10, 2)), 0.0)
    alone = only(it.settle(0, 0.0))
    echo = unpack(alone.belief)
    it.hear(report("r2", gaussian(GRID, (20, 15), 500), informed=(echo, {"r1": 0.0, "r2": 0.0})), 0.0)
    again = only(it.settle(0, 0.0))
    assert again.entropy == pytest.approx(alone.entropy, abs=0.02)


def test_feeding_the_consensus_back_sharpens_only_where_the_paper_is_taken_literally() -> None:
    """The echo loop of theory.md: adopt the consensus, report it, no new data. Guarded: nothing is gained."""
    gained = {}
    for feedback in ("guarded", "paper", "off"):
        it, informed = board(feedback=feedback, independence=1.0), None
        entropies = []
        for tick in range(4):
            for source, x in (("r1", 10), ("r2", 12)):
                it.hear(report(source, at(x, 10, 2), tick=tick, time=float(tick), informed=informed), float(tick))
            consensus = only(it.settle(tick, float(tick)))
            informed = unpack(consensus.belief), consensus.ancestors
            entropies.append(consensus.entropy)
        gained[feedback] = entropies[0] - entropies[-1]
    assert abs(gained["guarded"]) < 0.05
    assert abs(gained["off"]) < 1e-9
    assert gained["paper"] > 1.0


def test_overlapping_beliefs_that_contradict_each_other_both_stay() -> None:
    it = board()
    it.hear(report("r1", at(5, 5, 1), informed=(at(30, 20, 1), {"r1": 0.0, "r2": 0.0})), 0.0)
    belief = unpack(only(it.settle(0, 0.0)).belief)
    assert belief.p[:15].sum() > 0.2
    assert belief.p[20:].sum() > 0.2


def test_overlapping_beliefs_that_agree_are_pooled_by_chernoff() -> None:
    it = board()
    sharp = at(11, 10, 1.5)
    it.hear(report("r1", at(10, 10, 4), informed=(sharp, {"r1": 0.0, "r2": 0.0})), 0.0)
    consensus = only(it.settle(0, 0.0))
    expected, _ = chernoff(unpack(pack(at(10, 10, 4))).p, unpack(pack(sharp)).p)
    assert entropy(unpack(consensus.belief).p) == pytest.approx(entropy(expected), abs=0.05)
    assert consensus.firsthand is not None
    assert consensus.firsthand.ancestors == {"r1": 0.0}
    assert {u.how for u in consensus.used} == {"independent", "overlapping"}


def test_silence_lowers_the_claim_and_then_ends_it() -> None:
    it = board(max_age=5.0, drift=0.5)
    it.hear(report("r1", at(10, 10, 1), subject="robot/r1"), 0.0)
    entropies = [only(it.settle(t, float(t))).entropy for t in range(5)]
    assert entropies == sorted(entropies)
    assert entropies[-1] > entropies[0] + 0.3
    assert it.settle(9, 9.0) == []


def test_what_a_source_no_longer_lists_is_withdrawn() -> None:
    it = board()
    it.hear(report("r1", at(10, 10, 1), tick=1), 0.0)
    it.hear(report("r1", at(10, 10, 1), tick=2, subject="robot/r1"), 0.0)
    it.withdraw("r1", 2, ["robot/r1"])
    assert [c.subject for c in it.settle(2, 0.0)] == ["robot/r1"]


def test_stamps_out_of_bounds_and_other_grids_are_refused() -> None:
    it = board(max_age=10.0, future=1.0)
    for time, text in (
        (5.5, "future: stamped 1.5 s ahead of team time 4.0 s"),
        (-7.0, "past: stamped 11.0 s ago, older"),
    ):
        with pytest.raises(Refused, match=f"^{text}"):
            it.hear(report("r1", at(1, 1, 1), time=time), 4.0)
    with pytest.raises(Refused) as refusal:
        it.hear(report("r1", gaussian(Grid((40, 31)), (1, 1), 1)), 0.0)
    assert refusal.value.reason == "grid"
    assert it.settle(0, 0.0) == []


def test_an_older_word_does_not_replace_a_newer_one() -> None:
    it = board()
    it.hear(report("r1", at(10, 10, 1), time=2.0, tick=2), 2.0)
    before = it.settle(2, 2.0)
    it.hear(report("r1", at(30, 20, 1), time=1.0, tick=1), 2.0)
    assert it.settle(2, 2.0) == before


def test_memory_is_bounded_whatever_a_member_invents() -> None:
    it = board()
    for i in range(MAX_SUBJECTS):
        it.hear(report("r1", at(1, 1, 1), subject=f"object/o{i}"), 0.0)
    with pytest.raises(Refused, match="too-many"):
        it.hear(report("r1", at(1, 1, 1), subject="object/one-more"), 0.0)
    other = board()
    for i in range(MAX_SOURCES):
        other.hear(report(f"r{i}", at(1, 1, 1)), 0.0)
    with pytest.raises(Refused, match="too-many"):
        other.hear(report("one-more", at(1, 1, 1)), 0.0)


def test_an_old_report_spreads_by_the_drift_in_the_grid_s_unit() -> None:
    """4 s at 0.5 m per square root of a second add 1 m^2 to each variance, on cells of 0.25 m."""
    grid = Grid((80, 80), 0.25, (0.0, 0.0), "m")
    it = Board("a", "a", grid, BoardSection(drift=0.5))
    said = gaussian(grid, (10, 10), 1.0)
    it.hear(Report(source="r1", subject="object/ball", tick=0, time=0.0, belief=pack(said)), 0.0)
    spread = unpack(only(it.settle(20, 4.0)).belief)
    assert spread.covariance() == pytest.approx(np.diag([2.0, 2.0]), abs=0.05)
