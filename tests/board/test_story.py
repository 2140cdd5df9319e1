"""What a consensus says about how it was made: rule, outcome, weights, components, ancestors and conflict."""

import numpy as np
import pytest

from blackboard.board.fusion import fuse_opinions
from blackboard.config import BoardSection
from blackboard.opinion import components
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.pools import fuse, linear_pool
from blackboard.opinion.provenance import Opinion
from blackboard.opinion.rules import read_rule
from blackboard.opinion.weights import entropy, entropy_weights
from blackboard.wire.arrays import pack, unpack
from tests.board.reports import FINE, GRID, at, fine, new_board, only, report, same

BOTH = {"r1": 0.0, "r2": 0.0}


def test_a_subject_has_its_own_rule_and_its_story_says_so() -> None:
    board = new_board(
        k=1.0, subjects={"object/*": {"rule": "clique", "inner": "cooperative"}, "object/ball": {"gamma": 0.25}}
    )
    said = at(10, 10, 3), at(12, 11, 2)
    for subject in ("object/ball", "object/can", "robot/r1"):
        for source, belief in zip(("r1", "r2"), said, strict=True):
            board.hear(report(source, belief, subject=subject), 0.0)
    ball, can, robot = board.settle(0, 0.0)
    assert (ball.rule, can.rule, robot.rule) == ("clique", "clique", "coalition")
    # k = 1 is the coalition rule's
    assert ball.parameters == {"k": 2.0, "gamma": 0.25, "inner": "cooperative", "xi": 2.0}
    assert can.parameters == {"k": 2.0, "gamma": 0.5, "inner": "cooperative", "xi": 2.0}
    assert robot.parameters == {"k": 1.0, "gate": 4.0, "independence": 0.2}
    stack = np.stack([unpack(pack(b)).p for b in said])
    for consensus in (ball, can, robot):
        expected = fuse(read_rule({"rule": consensus.rule, **consensus.parameters}), stack, GRID).p
        assert np.array_equal(unpack(consensus.belief).p, unpack(pack(Belief(GRID, expected))).p)


def test_a_veto_is_published_with_what_was_done_instead() -> None:
    """Fault 2: the consensus named the rule that had not pooled, and the fallback nowhere."""
    board = new_board(rule="logarithmic")
    for source, cell in (("r1", (3, 4)), ("r2", (30, 20))):
        p = np.zeros(GRID.shape)
        p[cell] = 1.0
        board.hear(report(source, Belief(GRID, p)), 0.0)
    consensus = only(board.settle(0, 0.0))
    assert (consensus.rule, consensus.outcome) == ("logarithmic", "veto: linear")
    assert [u.weight for u in consensus.used] == pytest.approx([0.5, 0.5])
    board.hear(report("r2", at(4, 5, 2), time=1.0), 1.0)
    board.hear(report("r1", at(5, 5, 2), time=1.0), 1.0)
    assert only(board.settle(1, 1.0)).outcome == "pooled"


@pytest.mark.parametrize("rule", ["linear", "logarithmic", "median-log", "chernoff", "cooperative"])
def test_first_hand_reports_are_pooled_with_the_rule_which_gives_their_weights(rule: str) -> None:
    """Fault 1: the weights were 1 / H^k of the opinions, whatever the rule."""
    board, said = new_board(rule=rule), {"r1": at(10, 10, 3), "r2": at(12, 11, 2), "r3": at(11, 9, 4)}
    for source, belief in said.items():
        board.hear(report(source, belief), 0.0)
    consensus = only(board.settle(0, 0.0))
    pooled = fuse(read_rule({"rule": rule}), np.stack([unpack(pack(b)).p for b in said.values()]), GRID)
    assert np.array_equal(unpack(consensus.belief).p, unpack(pack(Belief(GRID, pooled.p))).p)
    assert {u.source: u.weight for u in consensus.used} == pytest.approx(dict(zip(said, pooled.weights, strict=True)))
    assert consensus.components == pytest.approx(pooled.components)
    assert bool(consensus.components) == (rule == "cooperative")
    assert consensus.ancestors == dict.fromkeys(said, 0.0)
    assert consensus.outcome == "pooled"
    assert consensus.conflict is False or rule != "cooperative"


@pytest.mark.parametrize("settings", [{}, {"rule": "cooperative"}, {"rule": "clique", "inner": "coalition"}])
def test_the_components_are_made_once_for_a_fusion(
    monkeypatch: pytest.MonkeyPatch, settings: dict[str, object]
) -> None:
    """Fault 3: they were made for the belief, again for the story and again for the test for a conflict."""
    calls, original = [], components.log_components

    def counted(*arguments: object) -> object:
        calls.append(arguments)
        return original(*arguments)  # type: ignore[arg-type]

    for module in ("components", "considered"):
        monkeypatch.setattr(f"blackboard.opinion.{module}.log_components", counted)
    said = [Opinion(f"r{i}", at(10 + i, 10, 2), {f"r{i}": 0.0}) for i in range(3)]
    fuse_opinions(said, GRID, BoardSection.model_validate(settings), "object/ball")
    assert len(calls) == 1


def test_what_an_overlapping_opinion_contributed_is_taken_from_the_others() -> None:
    """Shares after the geometric mean: 1 - w of the informed belief, w times the weight in the rule of the first-hand ones."""
    own, mate, informed = (gaussian(GRID, (x, 10), s) for x, s in ((10, (2, 5)), (11, (2, 4)), (10, (6, 1.5))))
    first = [Opinion("r1", own, {"r1": 0.0}), Opinion("r2", mate, {"r2": 0.0})]
    overlapping = Opinion("r1", informed, {"r1": 0.0, "r2": 0.0})
    settings = BoardSection.model_validate({"rule": "linear"})
    fusion = fuse_opinions([*first, overlapping], GRID, settings, "object/ball")
    weights = entropy_weights(np.stack([own.p, mate.p]), 2.0)
    expected, kept = chernoff(fusion.firsthand.p, informed.p)
    assert 0.05 < kept < 0.95
    assert np.array_equal(fusion.belief.p, expected)
    assert [s.weight for s in fusion.shares] == pytest.approx([kept * weights[0], kept * weights[1], 1 - kept])
    assert [s.how for s in fusion.shares] == ["independent", "independent", "overlapping"]
    third = Opinion("r2", gaussian(GRID, (11, 10), (1.5, 6)), {"r1": 0.0, "r2": 0.0})
    both = fuse_opinions([*first, overlapping, third], GRID, settings, "object/ball")
    assert sum(s.weight for s in both.shares) == pytest.approx(1.0)
    assert all(s.weight >= 0 for s in both.shares)


def test_an_overlapping_opinion_that_adds_nothing_is_no_ancestor() -> None:
    opinions = Opinion("r1", at(10, 10, 2), {"r1": 0.0}), Opinion("r1", at(10, 10, 9), {"r1": 0.0, "r2": 0.0})
    fusion = fuse_opinions(opinions, GRID, BoardSection(), "object/ball")
    assert [s.weight for s in fusion.shares] == [pytest.approx(1.0), 0.0]
    assert fusion.ancestors == {"r1": 0.0}
    sharper = Opinion("r2", at(10, 10, 1), {"r1": 0.0, "r2": 0.0})
    replaced = fuse_opinions([opinions[0], sharper], GRID, BoardSection(), "object/ball")
    assert [s.weight for s in replaced.shares] == [0.0, 1.0]
    assert replaced.ancestors == {"r1": 0.0, "r2": 0.0}


@pytest.mark.parametrize("independence", [0.0, 0.2, 1.0])
@pytest.mark.parametrize(("x", "sigma", "disagrees"), [(12, 2, False), (12, 9, False), (20, 1.2, True), (20, 9, False)])
def test_a_conflict_is_a_matter_of_opinions_and_not_of_the_rules_caution(
    independence: float, x: float, sigma: float, disagrees: bool
) -> None:
    """(20, 9) knows little, and r1 is within what it holds possible: that is no conflict, as (20, 1.2) is."""
    board = new_board(independence=independence)
    board.hear(report("r1", at(10, 10, 2)), 0.0)
    board.hear(report("r2", at(x, 10, sigma)), 0.0)
    assert only(board.settle(0, 0.0)).conflict == disagrees


# --- overlapping opinions, exactly ---------------------------------------------------------------------------------------


def test_the_weights_of_overlapping_opinions_are_those_of_the_chain_of_means() -> None:
    """The sharpest first; each takes its share from all before it, so the shares sum to 1."""
    own = gaussian(FINE, (10, 6), (3.0, 0.6))
    second, third = gaussian(FINE, (10.4, 6.2), (0.6, 3.0)), gaussian(FINE, (9.9, 6.1), (6.0, 0.4))
    board = new_board(grid=FINE)
    board.hear(report("r1", own, informed=(second, BOTH)), 0.0)
    board.hear(report("r2", unpack(pack(uniform(FINE))), informed=(third, {**BOTH, "r3": 0.0})), 0.0)
    consensus = only(board.settle(0, 0.0))
    own, second, third = (unpack(pack(b)) for b in (own, second, third))
    firsthand = unpack(consensus.firsthand.belief).p if consensus.firsthand else own.p
    sharp, vague = sorted((second.p, third.p), key=entropy)
    pooled, kept = chernoff(firsthand, sharp)
    assert 0.05 < kept < 0.95
    pooled, kept_again = chernoff(pooled, vague)
    assert 0.05 < kept_again < 0.95
    same(consensus, pooled, abs=1e-3)
    weights = {(u.source, u.how): u.weight for u in consensus.used}
    names = ["r1", "r2"] if sharp is second.p else ["r2", "r1"]
    assert weights[names[0], "overlapping"] == pytest.approx((1 - kept) * kept_again, abs=0.02)
    assert weights[names[1], "overlapping"] == pytest.approx(1 - kept_again, abs=0.02)
    assert consensus.firsthand is not None
    assert consensus.firsthand.ancestors == BOTH


def test_a_contradiction_is_pooled_linearly_by_the_entropy_weights() -> None:
    own, informed = fine(5, 2, 0.5), fine(16, 10, 1.5)
    board = new_board(grid=FINE)
    board.hear(report("r1", own, informed=(informed, BOTH)), 0.0)
    consensus = only(board.settle(0, 0.0))
    stack = np.stack([own.p, informed.p])
    weights = entropy_weights(stack)
    same(consensus, linear_pool(stack, weights), abs=1e-4)
    assert [u.weight for u in consensus.used] == pytest.approx(list(weights))
    assert consensus.conflict


@pytest.mark.parametrize(("sigmas", "contradicts"), [(5.9, False), (6.2, True)])
def test_equal_gaussians_six_sigma_apart_contradict_each_other(sigmas: float, contradicts: bool) -> None:
    """Their Bhattacharyya coefficient is exp(-d^2 / 8): 0.0111 at 6 sigma, 0.0082 at 6.2."""
    board = new_board(grid=FINE)
    board.hear(report("r1", fine(6, 6, 1.0), informed=(fine(6 + sigmas, 6, 1.0), BOTH)), 0.0)
    assert only(board.settle(0, 0.0)).conflict == contradicts
