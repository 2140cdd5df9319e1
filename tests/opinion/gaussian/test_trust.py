"""Who is believed where sightings contradict each other."""

from __future__ import annotations

from itertools import permutations

from blackboard.opinion.gaussian.trust import FIRM, Trust

TEAM = tuple(f"robot/r{k}" for k in range(1, 6))


def judged(liars: set[str], ticks: int = 2 * FIRM) -> Trust:
    trust = Trust()
    for _ in range(ticks):
        for observer, subject in permutations(TEAM, 2):
            trust.judge(observer, subject, agrees=not {observer, subject} & liars)
    return trust


def test_where_all_agree_nobody_is_left_out() -> None:
    assert judged(set()).left_out() == frozenset()


def test_who_contradicts_everybody_is_left_out_and_the_others_are_not() -> None:
    assert judged({"robot/r2"}).left_out() == {"robot/r2"}


def test_a_contradiction_between_two_robots_alone_accuses_neither() -> None:
    trust = Trust()
    for _ in range(2 * FIRM):
        trust.judge("robot/r1", "robot/r2", agrees=False)
    assert trust.left_out() == frozenset()


def test_who_agrees_again_is_taken_back() -> None:
    trust = judged({"robot/r2"})
    for _ in range(20):
        for observer, subject in permutations(TEAM, 2):
            trust.judge(observer, subject, agrees=True)
    assert trust.left_out() == frozenset()


def test_an_object_that_most_observers_see_elsewhere_is_misplaced() -> None:
    trust = judged({"robot/r2"})
    for _ in range(FIRM):
        trust.judge("robot/r2", "object/ball", agrees=True)  # it entered the object, and is left out
        trust.judge("robot/r1", "object/ball", agrees=False)
    assert trust.misplaced("object/ball")
    trust.forget("object/ball")
    assert not trust.misplaced("object/ball")
    for observer in ("robot/r1", "robot/r3", "robot/r4"):
        for _ in range(FIRM):
            trust.judge(observer, "object/ball", agrees=observer != "robot/r1")
    assert not trust.misplaced("object/ball")
