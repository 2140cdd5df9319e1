"""The board: what it hears, what it settles, and what it does not count twice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from blackboard.board import MAX_SOURCES, MAX_SUBJECTS, Board
from blackboard.config import BoardSection, RuleSection
from blackboard.errors import Refused
from blackboard.fusion import in_force
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import ENTROPY_WEIGHTED, POOLS, chernoff, fuse, parameters
from blackboard.opinion.weights import entropy
from blackboard.wire.arrays import pack, unpack
from blackboard.wire.messages import Consensus, Informed, Report

GRID = Grid((40, 30))


def report(
    source: str,
    belief: Belief,
    *,
    subject: str = "object/ball",
    time: float = 0.0,
    tick: int = 0,
    informed: tuple[Belief, Mapping[str, float]] | None = None,
) -> Report:
    packed = None if informed is None else Informed(belief=pack(informed[0]), ancestors=dict(informed[1]))
    return Report(source=source, subject=subject, tick=tick, time=time, belief=pack(belief), informed=packed)


def at(x: float, y: float, sigma: float) -> Belief:
    return gaussian(GRID, (x, y), sigma)


def board(**settings: object) -> Board:
    return Board("a", "a", GRID, BoardSection.model_validate(settings))


def only(consensuses: list[Consensus]) -> Consensus:
    (consensus,) = consensuses
    return consensus


def test_first_hand_reports_are_pooled_with_the_rule() -> None:
    it = board(rule="cooperative", gamma=0.5)
    said = {"r1": at(10, 10, 3), "r2": at(12, 11, 2), "r3": at(11, 9, 4)}
    for source, belief in said.items():
        it.hear(report(source, belief), 0.0)
    consensus = only(it.settle(0, 0.0))
    stack = np.stack([unpack(pack(b)).p for b in said.values()])
    expected = Belief(GRID, fuse("cooperative", stack, k=2.0, gamma=0.5))
    assert np.array_equal(unpack(consensus.belief).p, unpack(pack(expected)).p)
    assert consensus.ancestors == {"r1": 0.0, "r2": 0.0, "r3": 0.0}
    assert [u.source for u in consensus.used] == ["r1", "r2", "r3"]
    assert sum(u.weight for u in consensus.used) == pytest.approx(1.0)
    assert sum(consensus.components) == pytest.approx(1.0)
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
    assert it.heard("r1", 2, ["robot/r1"])
    assert not it.heard("r1", 2, ["robot/r1", "object/ball"])


def test_stamps_out_of_bounds_and_other_grids_are_refused() -> None:
    it = board(max_age=10.0, future=1.0)
    for time, reason in ((1.5, "future"), (-11.0, "past")):
        with pytest.raises(Refused) as refusal:
            it.hear(report("r1", at(1, 1, 1), time=time), 0.0)
        assert refusal.value.reason == reason
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


def exchanged(*sub_teams: Board, tick: int = 0, now: float = 0.0) -> dict[str, Consensus]:
    """Settle and exchange between boards that know one subject; the agreed belief of each."""
    said = [c for b in sub_teams for c in b.settle(tick, now)]
    for b in sub_teams:
        for consensus in said:
            b.hear_consensus(consensus, now)
    return {b.sub_team: only(b.exchange(tick, now)) for b in sub_teams}


def test_after_the_exchange_all_sub_teams_hold_the_same_belief() -> None:
    settings = BoardSection(independence=1.0)
    a, b = Board("a", "a", GRID, settings), Board("b", "b", GRID, settings)
    a.hear(report("r1", at(10, 10, 3)), 0.0)
    a.hear(report("r2", at(12, 10, 3)), 0.0)
    b.hear(report("r4", at(11, 12, 2)), 0.0)
    agreed = exchanged(a, b)
    assert agreed["a"].belief == agreed["b"].belief
    assert agreed["a"].ancestors == {"r1": 0.0, "r2": 0.0, "r4": 0.0}
    assert agreed["a"].entropy < min(c.entropy for c in a.settle(0, 0.0) + b.settle(0, 0.0))


def test_a_robot_in_two_sub_teams_is_not_counted_twice() -> None:
    """Both consensuses rest on r1 alone: the exchange must not multiply them."""
    a, b = Board("a", "a", GRID, BoardSection()), Board("b", "b", GRID, BoardSection())
    for it in (a, b):
        it.hear(report("r1", at(10, 10, 2)), 0.0)
    alone = only(a.settle(0, 0.0)).entropy
    assert exchanged(a, b)["a"].entropy == pytest.approx(alone, abs=0.02)


def test_without_another_opinion_the_consensus_stands_after_the_exchange() -> None:
    a = Board("a", "a", GRID, BoardSection())
    a.hear(report("r1", at(10, 10, 2), informed=(at(10, 11, 1), {"r1": 0.0, "r2": 0.0})), 0.0)
    consensus = only(a.settle(0, 0.0))
    a.hear_consensus(consensus, 0.0)
    assert only(a.exchange(0, 0.0)).belief == consensus.belief


def test_a_subject_has_its_own_rule_and_its_story_says_so() -> None:
    it = board(k=1.0, subjects={"object/*": {"rule": "clique", "inner": "cooperative"}, "object/ball": {"gamma": 0.25}})
    said = at(10, 10, 3), at(12, 11, 2)
    for subject in ("object/ball", "object/can", "robot/r1"):
        for source, belief in zip(("r1", "r2"), said, strict=True):
            it.hear(report(source, belief, subject=subject), 0.0)
    ball, can, robot = it.settle(0, 0.0)
    assert (ball.rule, can.rule, robot.rule) == ("clique", "clique", "coalition")
    gate = {"inner": "cooperative", "xi": 2.0}
    assert ball.parameters == {"k": 1.0, "gamma": 0.25, **gate}
    assert can.parameters == {"k": 1.0, "gamma": 0.5, **gate}
    assert robot.parameters == {"k": 1.0, "gate": 4.0, "independence": 0.2}
    stack = np.stack([unpack(pack(b)).p for b in said])
    for consensus, gamma in ((ball, 0.25), (can, 0.5)):
        expected = fuse("clique", stack, inner="cooperative", k=1.0, gamma=gamma)
        assert np.array_equal(unpack(consensus.belief).p, unpack(pack(Belief(GRID, expected))).p)


@pytest.mark.parametrize("rule", sorted(POOLS))
def test_what_is_in_force_is_what_the_rule_has(rule: str) -> None:
    named = set(in_force(RuleSection(rule=rule, reference_cell=2.0, power=0.5, gamma=0.3)))
    takes = parameters(rule, "logarithmic")
    assert named - {"k", "reference_cell"} == takes - {"cell_ratio", "common", "gate"}
    assert ("k" in named) == (rule in ENTROPY_WEIGHTED)
    assert ("reference_cell" in named) == (rule in ENTROPY_WEIGHTED)


@pytest.mark.parametrize("independence", [0.0, 0.2, 1.0])
@pytest.mark.parametrize(("x", "sigma", "disagrees"), [(12, 2, False), (12, 9, False), (20, 1.2, True), (20, 9, False)])
def test_a_conflict_is_a_matter_of_opinions_and_not_of_the_rules_caution(
    independence: float, x: float, sigma: float, disagrees: bool
) -> None:
    """(20, 9) knows little, and r1 is within what it holds possible: that is no conflict, as (20, 1.2) is."""
    it = board(independence=independence)
    it.hear(report("r1", at(10, 10, 2)), 0.0)
    it.hear(report("r2", at(x, 10, sigma)), 0.0)
    assert only(it.settle(0, 0.0)).conflict == disagrees


def test_an_informed_belief_that_contradicts_is_a_conflict() -> None:
    it = board()
    it.hear(report("r1", at(5, 5, 1), informed=(at(30, 20, 1), {"r1": 0.0, "r2": 0.0})), 0.0)
    assert only(it.settle(0, 0.0)).conflict
