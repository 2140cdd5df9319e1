"""The verdict of the referee: every check of a run, and the reasons for a FAIL."""

from typing import Any

import pytest

from blackboard.config.world import CheckSection
from blackboard.judge.referee import Referee
from blackboard.wire.messages import PackedBelief
from tests.judge.instants import GRID, at, both, cells, new_instant, referee, solo


def verdict(solo_: PackedBelief, agreed: PackedBelief, **check: object) -> tuple[bool, list[str]]:
    judge = Referee(GRID, CheckSection.model_validate(check), ("r1",))
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": solo_})
    both(instant, "a", "robot/r1", solo_, agreed)
    judge.judge_instant(instant, judged=True)
    return judge.verdict()


#: 1.6 cells off, 0.5 nats; the 95 % region holds three quarters of the true cell.
WIDE = cells({(2, 2): 0.2, (2, 4): 0.8})
NEAR = cells({(2, 2): 0.9, (2, 3): 0.1})  # 0.1 cells off, 0.33 nats


def test_better_and_honest_is_a_pass() -> None:
    passed, reasons = verdict(WIDE, NEAR)
    assert passed
    assert reasons == [
        "robots: agreed rmse 0.100 cell, solo 1.600, asked 0.9 of it",
        "robots: agreed entropy 0.325 nats, solo 0.500, asked 1 of it",
        "robots: agreed 95 % regions hold the truth in 100.0 %, asked 80 %",
        "robots: solo rmse 1.600 cell, its beliefs claim 0.781, asked 2 of it",  # of one sample nothing is concluded
    ]


@pytest.mark.parametrize(
    ("solo_", "agreed", "check", "reason"),
    [
        (NEAR, WIDE, {"entropy": 9, "coverage": 0.7}, "robots: agreed rmse 1.600 cell, solo 0.100"),
        (WIDE, NEAR, {"robots": 0.05}, "robots: agreed rmse 0.100 cell, solo 1.600, asked 0.05 of it"),
        (NEAR, WIDE, {"robots": 99, "coverage": 0.7}, "robots: agreed entropy 0.500 nats, solo 0.325"),
        (WIDE, at(2, 3), {}, "robots: agreed 95 % regions hold the truth in 0.0 %, asked 80 %"),
    ],
)
def test_a_failed_check_is_the_reason(
    solo_: PackedBelief, agreed: PackedBelief, check: dict[str, Any], reason: str
) -> None:
    passed, reasons = verdict(solo_, agreed, **check)
    assert not passed
    assert len(reasons) == 1
    assert reasons[0].startswith(reason)


def test_a_robot_that_was_never_judged_is_a_reason() -> None:
    judge = referee()
    passed, reasons = judge.verdict()
    assert not passed
    assert reasons == ["r1 was never judged", "r2 was never judged"]


def test_objects_that_were_never_judged_are_a_reason() -> None:
    judge = Referee(GRID, CheckSection(), ("r1",))
    instant = new_instant({"robot/r1": (2.5, 2.5), "object/ball": (4.5, 4.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": WIDE})
    both(instant, "a", "robot/r1", WIDE, NEAR)
    judge.judge_instant(instant, judged=True)
    assert judge.verdict() == (False, ["no object was ever judged"])


def test_objects_have_a_limit_of_their_own() -> None:
    def judged(objects: float) -> tuple[bool, list[str]]:
        judge = Referee(GRID, CheckSection(robots=2.0, objects=objects, coverage=0.0, entropy=5.0), ("r1",))
        instant = new_instant({"robot/r1": (2.5, 2.5), "object/ball": (4.5, 4.5)}, teams={"a": ["r1"]})
        solo(instant, "r1", {"robot/r1": WIDE, "object/ball": at(4, 6)})
        both(instant, "a", "robot/r1", WIDE, WIDE)
        both(instant, "a", "object/ball", at(4, 5), at(4, 5))
        judge.judge_instant(instant, judged=True)
        return judge.verdict()

    assert judged(0.6)[0]
    passed, reasons = judged(0.4)
    assert not passed
    assert reasons == ["objects: agreed rmse 1.000 cell, solo 2.000, asked 0.4 of it"]


def test_every_limit_is_still_a_pass() -> None:
    """Agreed as good as alone, asked for as good as alone."""
    passed, reasons = verdict(WIDE, WIDE, robots=1.0, entropy=1.0, coverage=0.7499, solo=1.6 + 1e-9)
    assert passed
    assert len(reasons) == 5


@pytest.mark.parametrize(("away", "passes"), [(4.0, False), (6.0, True)])
def test_who_was_gone_for_long_is_compared_once_it_is_settled(away: float, passes: bool) -> None:
    """Its first seconds stay in the scores and in what is held against its claims."""
    judge = Referee(GRID, CheckSection(missing=1.0, claim=99.0), ("r1",))
    back = 5.0 + away
    for tick in range(1, 101):
        instant = new_instant({"robot/r1": (2.5, 2.5)}, tick, teams={"a": ["r1"]})
        time, lost = instant.truth.time, cells({(9, 9): 0.9, (2, 2): 0.1})
        if not 5.0 < time < back:
            is_lost = back <= time < back + 4
            solo(instant, "r1", {"robot/r1": lost if is_lost else WIDE})
            both(instant, "a", "robot/r1", lost if is_lost else WIDE, lost if is_lost else NEAR)
        judge.judge_instant(instant, judged=True)
    assert judge.scores()["robots"]["agreed"]["rmse"] > 3
    passed, reasons = judge.verdict()
    assert passed == passes, reasons
