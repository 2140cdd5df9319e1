"""Who reports a uniform belief knows nothing: what the others believe is not made wider by it."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.board.fusion import Fusion, as_advised, fuse_opinions
from blackboard.board.learning import Advice, Learner
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief, gaussian, uniform
from blackboard.opinion.cooperative import Coalition
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion

GRID = Grid((12, 9), cell=0.5)
PLACES = st.tuples(st.floats(0.5, 5.5), st.floats(0.5, 4.0), st.floats(0.3, 2.0))


def opinions(places: list[tuple[float, float, float]]) -> list[Opinion]:
    return [Opinion(f"r{i}", gaussian(GRID, (x, y), s), {f"r{i}": 1.0}) for i, (x, y, s) in enumerate(places)]


def uninformed(name: str, rounding: float = 0.0) -> Opinion:
    p = uniform(GRID).p.copy()
    p[0, 0] *= 1 + rounding
    return Opinion(name, Belief(GRID, p / p.sum()), {name: 1.0})


def fused(some: list[Opinion], independence: float | str = "learn", **settings: object) -> Fusion:
    learner = Learner("consensus") if independence == "learn" else None
    board = BoardSection(independence=independence, **settings)  # type: ignore[arg-type, call-arg]
    return fuse_opinions(some, GRID, board, "object/ball", learner, 1.0)


@given(st.lists(PLACES, min_size=1, max_size=5), st.integers(1, 3), st.sampled_from(["learn", 0.0, 0.5, 1.0]))
def test_uniform_opinions_change_no_belief(
    places: list[tuple[float, float, float]], more: int, independence: float | str
) -> None:
    said = opinions(places)
    without = fused(said, independence)
    beside = fused([*said, *(uninformed(f"u{i}", 1e-12) for i in range(more))], independence)
    assert np.array_equal(beside.belief.p, without.belief.p)
    assert np.array_equal(beside.firsthand.p, without.firsthand.p)
    assert beside.outcome == without.outcome
    assert {share.opinion.source: share.weight for share in beside.shares} == {
        **{share.opinion.source: share.weight for share in without.shares},
        **{f"u{i}": 0.0 for i in range(more)},
    }


def test_their_sources_stay_among_the_ancestors() -> None:
    """That somebody saw nothing is evidence too, so it is not taken for independent of what rests on it."""
    pooled = fused([*opinions([(2.0, 2.0, 1.0)]), uninformed("u")])
    assert pooled.ancestors == pooled.firsthand_ancestors == {"r0": 1.0, "u": 1.0}
    assert pooled.is_firsthand


def test_one_of_another_sub_team_is_no_part_of_what_is_first_hand_here() -> None:
    some = [*opinions([(2.0, 2.0, 1.0)]), uninformed("u")]
    pooled = fuse_opinions(
        some, GRID, BoardSection(), "object/ball", Learner("consensus"), 1.0, counts=lambda robot: robot != "u"
    )
    assert (pooled.firsthand_ancestors, pooled.is_firsthand) == ({"r0": 1.0}, False)
    assert np.array_equal(pooled.firsthand.p, pooled.belief.p)


def test_where_nobody_knows_anything_the_belief_is_uniform() -> None:
    pooled = fused([uninformed("u"), uninformed("v")])
    assert pooled.belief.p == pytest.approx(uniform(GRID).p)
    assert {share.opinion.source for share in pooled.shares if share.weight > 0} == {"u", "v"}


def test_an_informed_belief_beside_a_uniform_first_hand_one_is_not_multiplied() -> None:
    """It may contain what the others said, so it still overlaps with its own source's first-hand belief."""
    informed = Opinion("u", gaussian(GRID, (2.0, 2.0), 1.0), {"u": 1.0, "r0": 1.0})
    pooled = fused([*opinions([(2.0, 2.0, 1.0)]), uninformed("u"), informed])
    assert pooled.belief.p == pytest.approx(informed.belief.p, abs=1e-6)
    assert ("u", "overlapping") in {(share.opinion.source, share.how) for share in pooled.shares}


@pytest.mark.parametrize("rule", ["cooperative", "linear", "logarithmic", "median-log", "clique"])
def test_under_every_rule_of_a_board(rule: str) -> None:
    said = opinions([(2.0, 2.0, 1.0), (2.2, 2.1, 0.8)])
    settings = BoardSection(rule=rule)
    without = fuse_opinions(said, GRID, settings, "object/ball").belief.p
    beside = fuse_opinions([*said, uninformed("u")], GRID, settings, "object/ball").belief.p
    assert np.array_equal(beside, without)


def test_nearly_uniform_ones_and_those_of_the_paper_count() -> None:
    said = opinions([(2.0, 2.0, 1.0)])
    without = fused(said).belief.p
    assert fused([*said, uninformed("u", 0.01)]).belief.p.max() < 0.9 * without.max()
    assert fused([*said, uninformed("u")], feedback="paper").belief.p.max() < 0.9 * without.max()


def test_a_rule_with_a_parameter_that_cannot_be_hashed() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Own(Coalition):
        notes: list[str]

    said = opinions([(2.0, 2.0, 1.0), (2.2, 2.1, 0.8)])
    advice = Advice(independence=0.5, powers=np.ones(2), weights=np.ones(2))
    rule, _ = as_advised(Own(notes=["a"]), np.stack([opinion.belief.p for opinion in said]), advice)
    assert rule.independence == 0.5
