"""What is named as the likely cause of a FAIL, from scores that are made up, and from a run in which something is wrong."""

from typing import Any

import pytest

from blackboard.judge.calibration import CAUTIOUS, CONFIDENT, CONSISTENT, MIXED, SHORT, word
from blackboard.judge.causes import likely_causes
from blackboard.judge.intervals import Estimate
from tests.judge.instants import at, both, new_instant, referee, solo


def levels(solo: float, agreed: float) -> dict[str, Any]:
    return {level: {"n": 10, "rmse": rmse} for level, rmse in (("solo", solo), ("agreed", agreed))}


def causes(
    robots: dict[str, dict[str, Any]],
    objects: dict[str, dict[str, Any]] | None = None,
    *,
    words: tuple[str, str] = (CONSISTENT, CONSISTENT),
    missing: dict[str, dict[str, int]] | None = None,
    company: dict[str, float] | None = None,
    asked: dict[str, bool] | None = None,
) -> list[str]:
    honesty = {"robots": {level: {"word": verdict} for level, verdict in zip(("solo", "agreed"), words, strict=True)}}
    scores = {"robots": {"by_name": robots}, "objects": {"by_name": objects or {}}}
    return likely_causes(scores, honesty, missing or {}, company or {}, asked or dict.fromkeys(robots, True), "cell")


GOOD = {"r1": levels(1.0, 0.5), "r2": levels(1.2, 0.6)}


def test_nothing_is_named_where_nothing_stands_out() -> None:
    assert causes(GOOD, {"ball": levels(2.0, 1.0)}) == []


@pytest.mark.parametrize(
    ("missing", "took_part", "text"),
    [
        ({"solo": 9}, False, "r3 never took part"),
        ({"solo": 9, "agreed": 2}, True, "r3 takes part and sends no belief of its own"),
        ({"consensus": 9, "agreed": 9}, True, "r3 reports, but its board made no agreed and consensus of it"),
    ],
)
def test_a_robot_that_was_never_judged_is_named_with_what_lacks(
    missing: dict[str, int], took_part: bool, text: str
) -> None:
    (cause,) = causes(GOOD, missing={"robot/r3": missing}, asked={"r1": True, "r2": True, "r3": took_part})
    assert cause.startswith(text)


def test_of_a_robot_that_was_away_for_long_nothing_else_is_said() -> None:
    off = {**GOOD, "r3": levels(9.0, 9.0)}
    (cause,) = causes(off, missing={"robot/r3": {"solo": 40, "agreed": 45}})
    assert cause.startswith("r3 was not heard in 80 % of the run")
    assert causes(off, missing={"robot/r3": {"solo": 2}})[0].startswith("r3 is off")


def test_an_object_that_nobody_saw_is_told_from_one_that_no_board_took() -> None:
    named = causes(GOOD, missing={"object/ball": {"solo": 9, "consensus": 9}, "object/can": {"consensus": 9}})
    assert named[0].startswith("no robot ever saw object/ball")
    assert named[1].startswith("object/can was seen, but no board")


def test_the_robot_that_is_off_is_named_with_the_level() -> None:
    (cause,) = causes({**GOOD, "r3": levels(9.0, 0.5)})
    assert cause.startswith("r3 is off: solo rmse 9.000 cell, the other robots' 1.105; it lost itself")
    (cause,) = causes({**GOOD, "r3": levels(1.1, 5.0)})
    assert cause.startswith("r3 is off: agreed rmse 5.000 cell, the other robots' 0.552; what others say")
    assert "record it (--record run.mcap), and `blackboard why robot/r3 run.mcap` names them" in cause


def test_agreed_that_equals_solo_says_whether_anybody_else_spoke() -> None:
    same = {"r1": levels(1.0, 1.0), "r2": levels(1.2, 1.199)}
    named = causes(same, company={"robot/r1": 0.05, "robot/r2": 0.5})
    assert named[0].startswith("agreed equals solo for robot/r1: nobody else had anything to say")
    assert named[1].startswith("agreed equals solo for robot/r2 although others contributed")
    assert named[1].endswith("`blackboard why robot/r2 run.mcap` shows the weights")


def test_overconfidence_is_laid_at_the_door_it_came_in_by() -> None:
    (cause,) = causes(GOOD, words=(CONFIDENT, CONFIDENT))
    assert "over-confident already alone" in cause
    (cause,) = causes(GOOD, words=(CAUTIOUS, CONFIDENT))
    assert "not over-confident alone, but in what is agreed" in cause


@pytest.mark.parametrize(
    ("spans", "expected"),
    [
        ([], SHORT),
        ([(50, 0.45, 0.55), (95, 0.9, 0.96)], CONSISTENT),
        ([(50, 0.55, 0.65), (95, 0.9, 0.96)], CAUTIOUS),
        ([(50, 0.5, 0.65), (95, 0.8, 0.94)], CONFIDENT),
        ([(50, 0.51, 0.65), (95, 0.8, 0.94)], MIXED),
    ],
)
def test_regions_are_called_by_what_their_intervals_leave_out(
    spans: list[tuple[int, float, float]], expected: str
) -> None:
    assert word({level: Estimate((low + high) / 2, low, high) for level, low, high in spans}) == expected


def test_the_referee_names_the_causes_of_a_fail_and_none_of_a_pass() -> None:
    judge = referee(entropy=9.0, coverage=0.0)
    instant = new_instant({"robot/r1": (2.5, 2.5)}, teams={"a": ["r1"]})
    solo(instant, "r1", {"robot/r1": at(2, 4)})
    both(instant, "a", "robot/r1", at(2, 4), at(2, 4))
    judge.judge_instant(instant, judged=True)
    judgement = judge.judgement()
    assert not judgement.passed
    assert [cause.split(":")[0] for cause in judgement.causes] == [
        "r2 never took part",
        "agreed equals solo for robot/r1",
    ]
    assert judgement.honesty["robots"]["agreed"] == {"word": SHORT, "coverage": {}}
    judge = referee(coverage=0.0)
    instant = new_instant({"robot/r1": (2.5, 2.5), "robot/r2": (5.5, 5.5)})
    for robot, sub_team, (x, y) in (("r1", "a", (2, 2)), ("r2", "b", (5, 5))):
        solo(instant, robot, {f"robot/{robot}": at(x, y + 2)})
        both(instant, sub_team, f"robot/{robot}", at(x, y), at(x, y))
    judge.judge_instant(instant, judged=True)
    assert (judge.judgement().passed, judge.judgement().causes) == (True, [])
