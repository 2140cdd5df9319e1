"""Who disagrees with the others: named after some seconds, counted less, back slowly; and camps of which nobody is named."""

import logging
from collections.abc import Mapping
from functools import partial

import numpy as np
import pytest

from blackboard.board.dissent import DissentJudge
from blackboard.board.fusion import Fusion, fuse_opinions
from blackboard.config import BoardSection
from blackboard.opinion.belief import Belief, gaussian
from blackboard.opinion.believed import FIRM, LEAST_WEIGHT
from blackboard.opinion.gaussian.evidence import Verdict
from blackboard.opinion.gaussian.trust import Trust
from blackboard.opinion.grid import Grid
from blackboard.opinion.provenance import Opinion

GRID = Grid((40, 40))
SETTINGS = BoardSection()
SUBJECT = "object/ball"


def said(places: Mapping[str, tuple[float, float]], sigma: float = 1.5, seed: int = 0) -> list[Opinion]:
    """Opinions of some sources, each with errors of its own sigma around the place that it means."""
    rng = np.random.default_rng(seed)
    return [
        Opinion(name, gaussian(GRID, (np.array(place) + rng.normal(0, sigma, 2)).tolist(), sigma), {name: 0.0})
        for name, place in sorted(places.items())
    ]


def fused(
    dissent: DissentJudge | None, opinions: list[Opinion], time: float, settings: BoardSection = SETTINGS
) -> Fusion:
    return fuse_opinions(opinions, GRID, settings, SUBJECT, None, time, dissent)


def lived(
    dissent: DissentJudge, places: Mapping[str, tuple[float, float]], seconds: int, start: int = 0, sigma: float = 1.5
) -> float:
    """Seconds of fusions, one each; the team time after them."""
    for second in range(start, start + seconds):
        fused(dissent, said(places, sigma, second), float(second))
    return float(start + seconds)


TRUTH = (20.0, 20.0)
HONEST = dict.fromkeys(("r1", "r2", "r3", "r4"), TRUTH)
LIAR = {**HONEST, "r5": (30.0, 20.0)}


def test_as_long_as_nobody_disagrees_nothing_is_changed_to_the_bit() -> None:
    dissent = DissentJudge("consensus")
    for second in range(60):
        opinions = said(HONEST, seed=second)
        judged, plain = fused(dissent, opinions, float(second)), fused(None, opinions, float(second))
        assert np.array_equal(judged.belief.p, plain.belief.p)
        assert [share.weight for share in judged.shares] == [share.weight for share in plain.shares]
    assert dissent.named() == []
    assert {dissent.weight(source) for source in HONEST} == {1.0}


def test_one_liar_of_five_is_named_after_some_seconds_and_the_others_are_not() -> None:
    dissent = DissentJudge("consensus")
    lived(dissent, LIAR, FIRM)
    assert dissent.named() == []
    lived(dissent, LIAR, 20, FIRM)
    (liar,) = dissent.named()
    assert (liar.level, liar.source, liar.weight) == ("consensus", "r5", LEAST_WEIGHT)
    assert liar.since == FIRM
    assert liar.sigmas == pytest.approx(10 / np.hypot(1.5, 1.5 / 4**0.2), rel=0.35)  # the others multiply a little
    assert dissent.named({"r1", "r2"}) == []


def test_who_is_named_counts_for_less() -> None:
    dissent = DissentJudge("consensus")
    now = lived(dissent, LIAR, 20)
    two = said({"r1": TRUTH, "r5": (24.0, 20.0)}, sigma=1.5, seed=99)
    judged, plain = fused(dissent, two, now), fused(None, two, now)
    assert abs(judged.belief.mean()[0] - two[0].belief.mean()[0]) < 0.1 * abs(
        plain.belief.mean()[0] - two[0].belief.mean()[0]
    )


def test_who_agrees_again_returns_slowly() -> None:
    dissent = DissentJudge("consensus")
    lived(dissent, LIAR, 30)
    weights = []
    for second in range(30, 80):
        lived(dissent, {**HONEST, "r5": TRUTH}, 1, second)
        weights.append(dissent.weight("r5"))
    assert weights == sorted(weights)
    assert weights[5] < 0.4
    assert weights[-1] == 1.0
    assert 15 < sum(weight < 1.0 for weight in weights) < 40
    assert dissent.named() == []


def test_it_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    dissent = DissentJudge("consensus")
    with caplog.at_level(logging.WARNING):
        lived(dissent, LIAR, 40)
    assert len(caplog.records) == 1
    assert caplog.records[0].getMessage().startswith("r5 disagrees with what the others believe (consensus), by ")


def test_two_that_collude_against_three_are_named() -> None:
    dissent = DissentJudge("consensus")
    lived(dissent, {"r1": TRUTH, "r2": TRUTH, "r3": TRUTH, "r4": (30.0, 20.0), "r5": (30.0, 20.0)}, 20)
    assert [named.source for named in dissent.named()] == ["r4", "r5"]


@pytest.mark.parametrize("size", [2, 3])
def test_of_two_camps_nobody_is_named_and_both_are_told_with_their_weights(size: int) -> None:
    dissent, names = DissentJudge("consensus"), [f"r{k}" for k in range(2 * size)]
    places = {name: TRUTH if k < size else (30.0, 20.0) for k, name in enumerate(names)}
    lived(dissent, places, 20, sigma=0.7)
    assert dissent.named() == []
    pooled = fused(dissent, said(places, 0.7, 20), 20.0)
    camps = dissent.told_camps(SUBJECT, {share.opinion.source: share.weight for share in pooled.shares})
    assert sorted(camp.sources for camp in camps) == [names[:size], names[size:]]
    assert sum(camp.weight for camp in camps) == pytest.approx(1.0)
    lived(dissent, dict.fromkeys(names, TRUTH), 2, 21, sigma=0.7)
    assert dissent.told_camps(SUBJECT, {}) == []


def test_two_that_contradict_each_other_accuse_nobody() -> None:
    dissent = DissentJudge("consensus")
    lived(dissent, {"r1": TRUTH, "r2": (30.0, 20.0)}, 20)
    assert dissent.named() == []


def test_an_over_confident_source_is_named_too() -> None:
    dissent = DissentJudge("consensus")
    for second in range(30):
        rng = np.random.default_rng(second)
        place = (20 + rng.normal(0, 6.0), 20 + rng.normal(0, 6.0))
        sharp = Opinion("r5", gaussian(GRID, place, 0.7), {"r5": 0.0})
        fused(dissent, [*said(HONEST, seed=second), sharp], float(second))
    assert [named.source for named in dissent.named()] == ["r5"]


def test_with_the_paper_s_feedback_everything_is_as_printed() -> None:
    dissent, printed = DissentJudge("consensus"), SETTINGS.model_copy(update={"feedback": "paper"})
    for second in range(20):
        fused(dissent, said(LIAR, seed=second), float(second), printed)
    assert dissent.named() == []


def test_opinions_that_are_no_bells_are_not_judged() -> None:
    dissent, flat = DissentJudge("consensus"), Belief(GRID, np.full(GRID.shape, 1 / GRID.size))
    for second in range(20):
        fused(dissent, [*said(HONEST, seed=second), Opinion("r5", flat, {"r5": 0.0})], float(second))
    assert dissent.named() == []


def test_memory_is_bounded() -> None:
    dissent = DissentJudge("consensus")
    for second in range(40):
        names = {f"r{second}-{k}": TRUTH for k in range(4)}
        fuse_opinions(said(names), GRID, SETTINGS, f"object/o{second}", None, float(second), dissent)
    assert len(dissent.standings) <= 64
    assert len(dissent.heard) <= 68


# --- a joint ----------------------------------------------------------------------------------------------------------


def moments(x: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([x, 0.0]), np.eye(2)


def judge(
    dissent: DissentJudge, seconds: int, places: Mapping[str, float], trust: Trust, taken: bool = True, start: int = 0
) -> None:
    believed = {name: moments(0.0) for name in places}
    hear = partial(
        dissent.judge_robots, told={name: moments(x) for name, x in places.items()}, believed=believed, trust=trust
    )
    for tick in range(5 * start, 5 * (start + seconds)):
        hear(tick / 5, verdicts=[Verdict("robot/r3", "robot/r3", "increment", 99.0, 3, taken)])


def test_in_a_joint_who_says_that_it_is_elsewhere_is_named_with_the_share_that_was_taken() -> None:
    dissent = DissentJudge("agreed", joint=True)
    judge(dissent, 20, {"r1": 0.3, "r2": 0.1, "r3": 9.0}, Trust(), taken=False)
    (named,) = dissent.named()
    assert (named.level, named.source, named.since) == ("agreed", "r3", FIRM)
    assert named.sigmas == pytest.approx(9 / np.sqrt(2))
    assert named.weight < 0.01


def test_in_a_joint_where_half_the_robots_are_elsewhere_nobody_is_named() -> None:
    dissent = DissentJudge("agreed", joint=True)
    judge(dissent, 20, {"r1": 0.3, "r2": 9.0}, Trust())
    assert dissent.named() == []


def test_who_is_left_out_of_a_joint_is_named_at_once_and_until_it_is_taken_back() -> None:
    dissent, trust = DissentJudge("agreed", joint=True), Trust()
    names = ("robot/r1", "robot/r2", "robot/r3")

    def see(agrees: bool, times: int) -> None:
        for _ in range(times):
            for observer in names:
                for observed in names:
                    if observer < observed:
                        trust.judge(observer, observed, agrees=agrees or "robot/r3" not in (observer, observed))

    see(False, 10)
    judge(dissent, 2, dict.fromkeys(("r1", "r2", "r3"), 0.0), trust)
    assert [(named.source, named.weight, named.since) for named in dissent.named()] == [("r3", 0.0, 0.0)]
    see(True, 30)
    judge(dissent, 3, dict.fromkeys(("r1", "r2", "r3"), 0.0), trust, start=2)
    assert dissent.named() == []


def test_opposed_camps_of_a_joint_are_told_about_their_members() -> None:
    dissent, trust = DissentJudge("agreed", joint=True), Trust()
    camps = ({"robot/r1", "robot/r2"}, {"robot/r3", "robot/r4"})
    for _ in range(10):
        for observer in sorted(set.union(*camps)):
            for observed in sorted(set.union(*camps)):
                if observer < observed:
                    trust.judge(observer, observed, agrees=any({observer, observed} <= camp for camp in camps))
    judge(dissent, 1, {}, trust)
    assert dissent.named() == []
    shown = dissent.camps_about("robot/r1", ["robot/r1", "robot/r2", "robot/r3"])
    assert [(camp.sources, round(camp.weight, 3)) for camp in shown] == [(["r1", "r2"], 0.667), (["r3", "r4"], 0.333)]
    assert dissent.camps_about("robot/r9", []) == []
