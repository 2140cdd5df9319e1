"""A board that learns how far its sources may be believed: the laws of the learner, and what the board tells of it."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.dissent import DissentJudge, Standing
from blackboard.board.factors import RIDGE, weights_of
from blackboard.board.fusion import as_advised, fuse_opinions
from blackboard.board.learning import Learner
from blackboard.config import BoardSection
from blackboard.errors import RuleError
from blackboard.opinion import believed
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.believed import PAIR_WINDOW, Verdicts
from blackboard.opinion.bell import bell, escort_moments, width
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.grid import Grid
from blackboard.opinion.pools import fuse
from blackboard.opinion.provenance import Opinion
from blackboard.wire.codec import decode, encode
from blackboard.wire.messages import Consensus, Learned
from tests.board.desk import ANOTHER_WORLD, Desk, clock
from tests.board.desk import report as sent
from tests.board.opinions import CENTRE, opinion, stream
from tests.board.reports import GRID, at, new_board, only, report

LEARN = BoardSection.model_validate({"independence": "learn"})


def taught(ticks: int = 40, **how: Any) -> Learner:
    learner = Learner("consensus")
    for second, opinions in enumerate(stream(5, ticks, **how)):
        learner.compare_opinions("object/ball", float(second), opinions)
    return learner


def exponents(learner: Learner) -> list[float]:
    """What each of five opinions is taken to where all agree: weight / variance."""
    advice = learner.advice([f"s{i}" for i in range(5)], [2.0] * 5)
    return [float(p) * 5 ** (advice.independence - 1.0) for p in advice.powers]


# --- moments -------------------------------------------------------------------------------------------------------------


def test_escort_moments_of_a_gaussian_are_its_own_and_withstand_a_floor() -> None:
    exact = gaussian(GRID, (20.3, 14.1), (2.0, 3.0))
    with_floor = Belief(GRID, 0.99 * exact.p + 0.01 / GRID.size)
    for belief in (exact, with_floor):
        mean, covariance = escort_moments(belief)
        np.testing.assert_allclose(mean, [20.3, 14.1], atol=0.02)
        np.testing.assert_allclose(covariance, np.diag([4.0, 9.0]) + np.eye(2) / 12, atol=0.1)
        assert width(belief) == pytest.approx(math.sqrt(6.0), rel=0.02)


def test_only_beliefs_near_a_gaussian_are_compared() -> None:
    x, y = GRID.mesh()
    ring = np.exp(-0.5 * ((np.hypot(x - 20, y - 15) - 10) / 1.5) ** 2)
    assert bell(at(10, 10, 2)) is not None
    assert bell(at(10, 10, (1, 6))) is not None
    assert bell(uniform(GRID)) is None
    assert bell(Belief(GRID, ring / ring.sum())) is None


# --- before any evidence --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12])
def test_without_evidence_a_board_that_learns_is_cautious(n: int) -> None:
    opinions = [opinion(f"s{i}", (15 + i, 15), 1.0 + i) for i in range(n)]
    learned = fuse_opinions(opinions, GRID, LEARN, "object/ball", Learner("consensus"), 0.0)
    default = fuse_opinions(opinions, GRID, BoardSection.model_validate({"independence": 0.2}), "object/ball")
    assert np.array_equal(learned.belief.p, default.belief.p)
    assert [share.weight for share in learned.shares] == [share.weight for share in default.shares]
    assert learned.rule == default.rule
    assert learned.conflict == default.conflict


def test_a_rule_that_learns_is_cautious_without_a_learner() -> None:
    opinions = np.stack([at(10, 10, 2).p, at(12, 10, 3).p])
    assert np.array_equal(
        fuse(Coalition(independence="learn"), opinions, GRID).p, fuse(Coalition(independence=0.2), opinions, GRID).p
    )
    assert Coalition(independence="learn").in_force()["independence"] == "learn"
    with pytest.raises(RuleError, match='or "learn"'):
        Coalition(independence="lern")  # type: ignore[arg-type]


# --- what is learned -------------------------------------------------------------------------------------------------------


def test_independent_sources_come_to_be_multiplied() -> None:
    assert sum(exponents(Learner("consensus"))) == pytest.approx(5**0.2)  # the default: five count as 1.4
    assert sum(exponents(taught())) > 2.2


def test_the_weight_of_one_liar_falls() -> None:
    powers = exponents(taught(liar=12.0))
    assert powers[0] < 0.15
    assert min(powers[1:]) > 0.5
    (learned,) = taught(liar=12.0).learned(["s0"])
    assert learned.variance > 5
    assert learned.since is not None
    assert learned.echo is None


def test_echoes_of_one_source_count_about_once() -> None:
    learner = taught(echoes=3)
    powers = exponents(learner)
    assert powers[0] + powers[1] + powers[2] + powers[4] == pytest.approx(1.0, abs=0.25)  # s4 and who repeats it
    assert powers[3] > 0.6
    learned = {entry.source: entry for entry in learner.learned()}
    assert learned["s0"].echo in ("s1", "s2", "s4")
    assert learned["s0"].since is not None
    assert learned["s3"].echo is None
    assert learned["s3"].since is None


def test_sources_that_claim_half_their_sigma_are_found_out_together() -> None:
    learner = taught(50, factor=2.0)
    assert all(2.0 < entry.variance < 6.0 for entry in learner.learned())
    assert max(exponents(learner)) < 0.5


def test_samples_that_follow_each_other_count_less() -> None:
    fresh, lasting = taught(50), taught(50, memory=0.9)
    assert fresh.learned()[0].samples > 40
    assert lasting.learned()[0].samples < 12


def test_a_source_that_mends_is_believed_again() -> None:
    learner = taught(40, liar=12.0)
    for second, opinions in enumerate(stream(5, 60, seed=2), start=40):
        learner.compare_opinions("object/ball", float(second), opinions)
    assert exponents(learner)[0] > 0.5
    assert learner.learned(["s0"])[0].since is None


def test_with_correlated_errors_the_sharp_opinion_gets_more() -> None:
    advice = taught(echoes=4).advice([f"s{i}" for i in range(5)], [1.0, 4.0, 4.0, 4.0, 4.0])
    assert advice.weights[0] == 1.0
    assert max(advice.weights[1:]) < 0.3


# --- laws -----------------------------------------------------------------------------------------------------------------


def test_the_order_of_arrival_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    in_order, shuffled = Learner("consensus"), Learner("consensus")
    for second, opinions in enumerate(stream(5, 20, liar=8.0)):
        in_order.compare_opinions("object/ball", float(second), opinions)
        shuffled.compare_opinions("object/ball", float(second), [opinions[i] for i in rng.permutation(5)])
    assert exponents(in_order) == exponents(shuffled)
    assert in_order.learned() == shuffled.learned()


def test_what_shares_ancestors_is_not_compared() -> None:
    learner = Learner("consensus")
    for second, (first, other, *_) in enumerate(stream(5, 20)):
        shared = Opinion(other.source, other.belief, {"s0": 0.0, "s1": 0.0})
        learner.compare_opinions("object/ball", float(second), [first, shared])
    assert learner.learned() == []


def test_what_follows_too_soon_or_is_old_is_not_compared() -> None:
    learner = Learner("consensus")
    for second, opinions in enumerate(stream(5, 20)):
        learner.compare_opinions("object/ball", float(second), opinions)
        learner.compare_opinions("object/ball", second + 0.5, opinions)  # within a second of the one before
        learner.compare_opinions(
            "object/can", float(second), [*opinions[:1], *(opinion(o.source, CENTRE, age=2.0) for o in opinions[1:])]
        )
    assert exponents(learner) == exponents(taught(20))


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of sources and subjects, with smaller bounds, so that few opinions are needed; of samples with the real one."""
    monkeypatch.setattr(believed, "MAX_SOURCES", 6)
    monkeypatch.setattr("blackboard.board.learning.MAX_SUBJECTS", 4)
    learner = Learner("consensus")
    for second in range(12):
        names = [f"n{(second * 3 + i) % 11}" for i in range(4)]
        learner.compare_opinions(f"object/o{second}", float(second), [opinion(name, CENTRE) for name in names])
    learner.compare_opinions("object/all", 20.0, [opinion(f"n{i}", CENTRE) for i in range(9)])
    assert len(learner.heard) == 6
    assert len(learner.last) == 4
    assert len(learner.samples) <= 6 * 5 // 2
    assert learner.samples.keys() == learner._pairings.keys()
    assert all(len(means) <= 6 for _, means in learner.last.values())
    assert all(len(window) <= PAIR_WINDOW for window in taught(PAIR_WINDOW + 5).samples.values())


SMALL = Grid((6, 4))
masses = st.one_of(
    st.just([1.0] * SMALL.size),
    st.integers(0, SMALL.size - 1).map(lambda cell: [float(i == cell) for i in range(SMALL.size)]),
    st.lists(st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 7.0]), min_size=SMALL.size, max_size=SMALL.size).filter(
        lambda p: sum(p) > 1e-9
    ),
)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.lists(masses, min_size=3, max_size=3), min_size=1, max_size=8))
def test_no_belief_makes_it_fail(ticks: list[list[list[float]]]) -> None:
    learner = Learner("consensus")
    for second in range(12):
        ps = [np.reshape(p, SMALL.shape) / sum(p) for p in ticks[second % len(ticks)]]
        opinions = [Opinion(f"s{i}", Belief(SMALL, p), {f"s{i}": 0.0}) for i, p in enumerate(ps)]
        learner.compare_opinions("object/ball", float(second), opinions)
        advice = learner.advice([o.source for o in opinions], [width(o.belief) for o in opinions])
        assert 0 <= advice.independence <= 1
        assert np.all((advice.powers > 0) & (advice.powers <= 1))
        assert np.all((advice.weights > 0) & (advice.weights <= 1))
        rule, stack = as_advised(Coalition(), np.stack(ps), advice)
        assert np.isfinite(fuse(rule, stack, SMALL).p).all()
        for learned in learner.learned():
            assert math.isfinite(learned.variance)
            assert 0 <= learned.correlation <= 1
            assert learned.variance >= 1


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 8), st.floats(0, 1), st.randoms(use_true_random=False))
def test_weights_of_equally_wide_opinions_are_those_of_the_formula(n: int, correlation: float, random: Any) -> None:
    """(1 + l) (R + l I)^-1 1 with equal correlations is (1 + l) / (1 + l + (n - 1) rho) for each."""
    matrix = np.full((n, n), correlation)
    np.fill_diagonal(matrix, 1.0)
    weight = (1 + RIDGE) / (1 + RIDGE + (n - 1) * correlation)
    np.testing.assert_allclose(weights_of(matrix, np.full(n, 3.0)), weight, atol=1e-9)


# --- the board ----------------------------------------------------------------------------------------------------------


def test_the_board_tells_what_it_learned_and_what_it_used() -> None:
    board = new_board(independence="learn")
    for second, opinions in enumerate(stream(5, 40, liar=12.0)):
        for said in opinions:
            board.hear(report(said.source, said.belief, time=float(second), tick=second), float(second))
        consensus = only(board.settle(second, float(second)))
    weights = {used.source: used.weight for used in consensus.used}
    assert weights["s0"] < 0.3 < min(weight for source, weight in weights.items() if source != "s0")
    learned = {entry.source: entry for entry in consensus.learned}
    assert learned["s0"].variance > 3
    assert learned["s0"].level == "consensus"
    assert set(learned) == set(weights)
    assert consensus.parameters["independence"] > 0.5  # type: ignore[operator]
    assert board.believed()["learned"] == consensus.learned
    assert decode(Consensus, encode(consensus)) == consensus


@pytest.mark.parametrize("by", ["learned", "dissent"])
def test_a_fusion_is_done_again_by_what_is_published_of_it(by: str) -> None:
    """The rule with its parameters, and the powers, without learner and dissent; a share of an informed opinion among them."""
    opinions = next(iter(stream(5, 1, seed=9, liar=12.0)))
    informed = Opinion("s0", opinions[1].belief, {"s0": 0.0, "s1": 0.0})
    learner, dissent, settings = None, None, BoardSection.model_validate({"independence": 0.4})
    if by == "learned":
        learner, settings = taught(liar=12.0), LEARN
    else:
        dissent = DissentJudge("consensus", standings={"s0": Standing(Verdicts(0.7, 9), since=0.0)})
    pooled = fuse_opinions([*opinions, informed], GRID, settings, "object/ball", learner, 99.0, dissent)
    powers = {(share.opinion.source, share.how): share.power for share in pooled.shares}
    assert powers["s0", "independent"] < 0.7
    assert (powers["s0", "overlapping"] < 0.7) == (by == "dissent")
    in_force = BoardSection.model_validate(pooled.rule.in_force())
    again = fuse_opinions([*opinions, informed], GRID, in_force, "object/ball", powers=powers)
    np.testing.assert_allclose(again.belief.p, pooled.belief.p, rtol=1e-9)
    forgot = fuse_opinions([*opinions, informed], GRID, in_force, "object/ball")
    assert not np.allclose(forgot.belief.p, pooled.belief.p)


def test_older_messages_without_the_field_are_taken() -> None:
    board = new_board()
    board.hear(report("s1", at(10, 10, 2)), 0.0)
    consensus = only(board.settle(0, 0.0))
    assert consensus.learned == []
    older = Consensus.model_validate({k: v for k, v in consensus.model_dump().items() if k != "learned"})
    assert older == consensus


def test_the_exchange_learns_of_sub_teams() -> None:
    board = new_board(independence="learn")
    for second, opinions in enumerate(stream(3, 20)):
        for said in opinions:
            other = new_board()
            other.hear(report(said.source, said.belief, time=float(second)), float(second))
            theirs = only(other.settle(second, float(second))).model_copy(update={"sub_team": said.source})
            board.hear_consensus(theirs, float(second))
        board.exchange(second, float(second))
    assert {entry.source: entry.level for entry in board.believed()["learned"]} == dict.fromkeys(
        ("s0", "s1", "s2"), "agreed"
    )


def test_the_status_of_a_board_shows_what_it_learned_until_a_new_run_begins() -> None:
    desk = Desk("r1", "r2", independence="learn")
    for tick in range(0, 60, 5):
        desk.tell(clock(tick, mode="realtime"), sent("r1", tick), sent("r2", tick))
        desk.wait(0.3)
    status = desk.status()
    assert status.settings["independence"] == "learn"
    assert {entry.source for entry in status.learned} == {"r1", "r2"}
    assert all(isinstance(entry, Learned) for entry in status.learned)
    desk.tell(*ANOTHER_WORLD, clock(0, mode="realtime", run="two"))
    desk.wait(0.3)
    assert desk.status().learned == []


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("mine", [True, False])
def test_a_single_opinion_is_fused_as_by_the_rule_with_the_independence_that_is_in_force(
    known: bool, mine: bool
) -> None:
    only = opinion("s1" if known else "stranger", (12.5, 9.0), 3.0)
    fused = fuse_opinions([only], GRID, LEARN, "robot/r1", taught(), 41.0, DissentJudge("consensus"), lambda _: mine)
    cautious = BoardSection.model_validate({"independence": 0.2})
    plain = fuse_opinions([only], GRID, cautious, "robot/r1", counts=lambda _: mine)
    for fused_belief, plain_belief in ((fused.belief, plain.belief), (fused.firsthand, plain.firsthand)):
        assert np.array_equal(fused_belief.p, plain_belief.p)
    for name in (
        "ancestors",
        "firsthand_ancestors",
        "is_firsthand",
        "shares",
        "components",
        "conflict",
        "outcome",
        "rule",
    ):
        assert getattr(fused, name) == getattr(plain, name), name
    assert [entry.source for entry in fused.learned] == (["s1"] if known else [])
