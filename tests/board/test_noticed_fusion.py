"""What overlapping opinions contribute, against exact expectations."""

from __future__ import annotations

import numpy as np
import pytest

from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.chernoff import chernoff
from blackboard.opinion.pools import linear_pool
from blackboard.opinion.weights import entropy, entropy_weights
from blackboard.wire.arrays import pack, unpack
from tests.board.test_noticed import BOTH, GRID, at, board, only, report, same


def test_the_weights_of_overlapping_opinions_are_those_of_the_chain_of_means() -> None:
    """The sharpest first; each takes its share from all before it, so the shares sum to 1."""
    own = gaussian(GRID, (10, 6), (3.0, 0.6))
    second, third = gaussian(GRID, (10.4, 6.2), (0.6, 3.0)), gaussian(GRID, (9.9, 6.1), (6.0, 0.4))
    it = board()
    it.hear(report("r1", own, informed=(second, BOTH)), 0.0)
    it.hear(report("r2", uninformed(), informed=(third, {**BOTH, "r3": 0.0})), 0.0)
    consensus = only(it.settle(0, 0.0))
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


def uninformed() -> Belief:
    return unpack(pack(Belief(GRID, np.full(GRID.shape, 1 / GRID.size))))


def test_one_first_hand_opinion_beside_an_informed_one_has_the_rest_of_the_weight() -> None:
    own, informed = gaussian(GRID, (10, 6), (2.0, 0.8)), gaussian(GRID, (10.4, 6.2), (0.8, 2.0))
    it = board()
    it.hear(report("r1", own, informed=(informed, BOTH)), 0.0)
    first, second = only(it.settle(0, 0.0)).used
    assert (first.how, second.how) == ("independent", "overlapping")
    assert first.weight == pytest.approx(chernoff(unpack(pack(own)).p, unpack(pack(informed)).p)[1])
    assert 0.3 < first.weight < 0.7
    assert first.weight + second.weight == pytest.approx(1.0)


def test_a_contradiction_is_pooled_linearly_by_the_entropy_weights() -> None:
    own, informed = at(5, 2, 0.5), at(16, 10, 1.5)
    it = board()
    it.hear(report("r1", own, informed=(informed, BOTH)), 0.0)
    consensus = only(it.settle(0, 0.0))
    stack = np.stack([own.p, informed.p])
    weights = entropy_weights(stack)
    same(consensus, linear_pool(stack, weights), abs=1e-4)
    assert [u.weight for u in consensus.used] == pytest.approx(list(weights))
    assert consensus.conflict


@pytest.mark.parametrize(("sigmas", "contradicts"), [(5.9, False), (6.2, True)])
def test_equal_gaussians_six_sigma_apart_contradict_each_other(sigmas: float, contradicts: bool) -> None:
    """Their Bhattacharyya coefficient is exp(-d^2 / 8): 0.0111 at 6 sigma, 0.0082 at 6.2."""
    it = board()
    it.hear(report("r1", at(6, 6, 1.0), informed=(at(6 + sigmas, 6, 1.0), BOTH)), 0.0)
    assert only(it.settle(0, 0.0)).conflict == contradicts


def test_an_informed_belief_that_is_dropped_hands_on_no_ancestors() -> None:
    it = board()
    it.hear(report("r1", at(10, 6, 0.5), informed=(at(10, 6, 3.0), BOTH)), 0.0)
    consensus = only(it.settle(0, 0.0))
    assert [u.weight for u in consensus.used] == [1.0, 0.0]
    assert consensus.ancestors == {"r1": 0.0}
