"""How likely a robot is lost: by evidence of two ends, of which either may be the one."""

import numpy as np

from blackboard.opinion.gaussian.evidence import Verdict
from blackboard.opinion.gaussian.lost import Lost

ROBOTS = ("robot/r1", "robot/r2", "robot/r3")


def verdict(source: str, subject: str, squared: float) -> Verdict:
    return Verdict(f"robot/{source}", subject, "relative", squared, 2, taken=True)


def heard(lost: Lost, seconds: range, verdicts: list[Verdict], own: dict[str, float] | None = None) -> Lost:
    for second in seconds:
        lost.on_verdicts(float(second), ROBOTS, verdicts, own or {})
    return lost


def probabilities(lost: Lost) -> list[float]:
    return [lost.probability(robot) for robot in ROBOTS]


def test_who_is_seen_far_off_by_two_is_lost_and_they_are_not() -> None:
    verdicts = [verdict("r1", "robot/r2", 60.0), verdict("r3", "robot/r2", 60.0), verdict("r1", "robot/r3", 1.4)]
    r1, r2, r3 = probabilities(heard(Lost(), range(30), verdicts))
    assert max(r1, r3) < 0.25
    assert r2 > 0.4


def test_who_is_seen_where_it_is_believed_to_be_is_hardly_lost() -> None:
    verdicts = [verdict("r1", "robot/r2", 1.4), verdict("r2", "robot/r3", 1.4), verdict("r3", "robot/r1", 1.4)]
    assert max(probabilities(heard(Lost(), range(60), verdicts))) < 0.05


def test_one_sighting_says_less_than_many_and_who_is_found_is_placed_again() -> None:
    far, near = [verdict("r1", "robot/r2", 60.0), verdict("r3", "robot/r2", 60.0)], [verdict("r1", "robot/r2", 1.0)]
    lost = Lost()
    once = heard(lost, range(1), far).probability("robot/r2")
    often = heard(lost, range(1, 30), far).probability("robot/r2")
    probability = heard(lost, range(30, 120), near + [verdict("r3", "robot/r2", 1.0)]).probability("robot/r2")
    assert probability < once < often


def test_what_is_said_many_times_in_a_second_counts_once() -> None:
    verdicts = [verdict("r1", "robot/r2", 60.0)]
    slow, fast = heard(Lost(), range(10), verdicts), Lost()
    for tick in range(100):
        fast.on_verdicts(tick / 10, ROBOTS, verdicts, {})
    assert abs(slow.probability("robot/r2") - fast.probability("robot/r2")) < 0.15


def test_who_says_of_itself_what_the_team_does_not_believe_may_be_lost() -> None:
    lost = heard(Lost(), range(30), [], {"robot/r2": 60.0, "robot/r1": 1.0})
    assert lost.probability("robot/r2") > 0.4
    assert lost.probability("robot/r1") < 0.1


def test_whatever_is_heard_it_is_a_probability() -> None:
    rng, lost = np.random.default_rng(1), Lost()
    for _ in range(500):
        squared = float(10.0 ** rng.uniform(-12, 12))
        names = rng.choice(["robot/r1", "robot/r2", "robot/new", "object/ball"], 2)
        kind = "relative" if names[0] != names[1] else "increment"
        drawn = Verdict(str(names[0]), str(names[1]), kind, squared, int(rng.integers(1, 10)), taken=False)
        lost.on_verdicts(float(rng.uniform(0, 1e6)), ROBOTS, [drawn], {"robot/r1": squared})
        assert all(0.0 < probability < 1.0 for probability in probabilities(lost))
