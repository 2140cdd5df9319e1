"""Who is believed where sightings contradict each other."""

from collections.abc import Callable, Sequence
from itertools import permutations

from blackboard.opinion.believed import FIRM
from blackboard.opinion.gaussian.trust import Trust

TEAM = tuple(f"robot/r{k}" for k in range(1, 6))


def judge(trust: Trust, ticks: int, agrees: Callable[[str, str], bool], robots: Sequence[str] = TEAM) -> Trust:
    """Let each robot see each other one for some ticks."""
    for _ in range(ticks):
        for observer, subject in permutations(robots, 2):
            trust.judge(observer, subject, agrees=agrees(observer, subject))
    return trust


def judged(liars: set[str], ticks: int = 2 * FIRM) -> Trust:
    return judge(Trust(), ticks, lambda observer, subject: not {observer, subject} & liars)


def all_agree(observer: str, subject: str) -> bool:
    return True


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
    trust = judge(judged({"robot/r2"}), 20, all_agree)
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


def opposed(size: int, lonely: int = 0) -> Trust:
    """Two camps of some size, each of one mind, and robots that contradict everybody."""
    names = [f"robot/r{k}" for k in range(2 * size + lonely)]
    mind = {name: min(k // size, 2) + 10 * k * (k >= 2 * size) for k, name in enumerate(names)}
    return judge(Trust(), 2 * FIRM, lambda observer, subject: mind[observer] == mind[subject], names)


def test_of_two_equal_camps_nobody_is_left_out() -> None:
    for size in (2, 3):
        trust = opposed(size)
        assert trust.left_out() == frozenset()
        assert [len(camp) for camp in trust.camps()] == [size, size]


def test_beside_two_equal_camps_who_contradicts_all_is_left_out_all_the_same() -> None:
    trust = opposed(2, lonely=1)
    assert trust.left_out() == {"robot/r4"}
    assert len(trust.camps()) == 2


def test_the_larger_camp_is_believed() -> None:
    trust = judged({"robot/r2"})
    for _ in range(2 * FIRM):
        judge(trust, 1, all_agree, ("robot/r4", "robot/r5"))
        judge(trust, 1, lambda *pair: ("robot/r2" in pair) == ("robot/r3" in pair))
    assert trust.camps() == []


def test_who_contradicted_is_taken_back_slowly() -> None:
    trust = judged({"robot/r2"}, ticks=100)
    rounds = 0
    while trust.left_out():
        rounds += 1
        judge(trust, 1, all_agree)
    assert 15 <= rounds <= 20


def test_camps_that_never_met_are_no_camps() -> None:
    trust = Trust()
    for _ in range(2 * FIRM):
        for observer, subject in (("robot/r1", "robot/r2"), ("robot/r3", "robot/r4")):
            trust.judge(observer, subject, agrees=True)
    assert (trust.left_out(), trust.camps()) == (frozenset(), [])
