"""A belief that claims to hold everybody's information is one opinion, and passes a gate as any other."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from blackboard.board.fusion import Fusion, fuse_opinions
from blackboard.config import BoardSection
from blackboard.opinion.belief import gaussian
from blackboard.opinion.provenance import Opinion
from tests.board.opinions import CENTRE, opinion
from tests.board.reports import GRID

NAMES = ("r1", "r2", "r3", "r4")
RULES = ("linear", "logarithmic", "geometric", "hoelder", "cooperative", "coalition", "median-log")


def informed(source: str, mean: tuple[float, float], sigma: float) -> Opinion:
    return Opinion(source, gaussian(GRID, mean, sigma), dict.fromkeys(NAMES, 0.0))


def off(by: float, angle: float) -> tuple[float, float]:
    return CENTRE[0] + by * math.cos(angle), CENTRE[1] + by * math.sin(angle)


def fused(opinions: list[Opinion], rule: str = "coalition") -> Fusion:
    return fuse_opinions(opinions, GRID, BoardSection(rule=rule), "object/ball")


@settings(deadline=None, max_examples=15)
@given(st.sampled_from(RULES), st.integers(1, 3), st.floats(7.0, 12.0), st.floats(0, 6.28), st.floats(0.05, 1.0))
def test_a_sharp_one_that_contradicts_what_others_saw_moves_nothing(
    rule: str, honest: int, by: float, angle: float, sigma: float
) -> None:
    """By more than 99 % of honest distances: their sigma is 2. One that saw it is enough."""
    said = [opinion(name, CENTRE) for name in NAMES[:honest]]
    lie = informed("r4", off(by, angle), sigma)
    calm, pooled = fused(said, rule), fused([*said, lie], rule)
    assert pooled.belief.p.tobytes() == calm.belief.p.tobytes()
    assert pooled.conflict
    assert [(share.opinion.source, share.weight) for share in pooled.shares if share.how == "overlapping"] == [
        ("r4", 0.0)
    ]
    assert pooled.ancestors == calm.ancestors


def test_one_that_agrees_is_pooled_as_before() -> None:
    said = [opinion(name, CENTRE) for name in NAMES[:3]]
    pooled = fused([*said, informed("r4", off(1.0, 0.0), 0.5)])
    assert not pooled.conflict
    assert [share.weight > 0 for share in pooled.shares if share.how == "overlapping"] == [True]


def test_what_several_are_informed_of_is_believed_against_one_that_is_lost() -> None:
    claims = [informed(name, CENTRE, 1.0) for name in NAMES[1:]]
    pooled = fused([opinion("r1", off(12.0, 0.0), 0.5), *claims])
    assert sum(share.weight for share in pooled.shares if share.how == "overlapping") > 0.3
