"""A soak's verdict: each line is true of a good run, and fails of one that is not."""

import pytest

from blackboard.chaos.gauges import Gauge, read
from blackboard.chaos.sight import Look
from blackboard.chaos.verdict import AGAIN, BEHIND, GROWTH, LIFE, MORE, Sent, growth, lives, longest, text, verdict

SECONDS = 200


def gauges(
    name: str = "world", rate: float = 0.0, threads: int = 0, descriptors: int = 0, until: int = SECONDS
) -> list[Gauge]:
    """A process that grows by so many MB a minute, and has more threads or descriptors from its middle on."""
    late = until / 2 + 40
    return [
        Gauge(t, name, 1, 50 + rate * t / 60, 9 + threads * (t > late), 20 + descriptors * (t > late))
        for t in range(until)
    ]


def looks(gap: float = 0.0) -> list[Look]:
    pair = ("a", "robot/r1")
    return [Look(0.1 * i, 0.1 * i, (pair,) if 50 <= 0.1 * i <= 50 + gap else (), 9) for i in range(10 * SECONDS)]


SENT = {"r1, 7, after 0 troubles": [Sent(10, 10, 0), Sent(900, 890, 0)]}


def failed(**changes: object) -> list[str]:
    """What does not hold of a good run with these changes."""
    run = {"gauges": gauges(), "looks": looks(), "sent": SENT, "seconds": SECONDS} | changes
    return [line.what.split(":")[0].split(",")[0] for line in verdict(**run) if not line.holds]  # type: ignore[arg-type]


def test_a_good_run_holds_every_line() -> None:
    assert failed() == []


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"gauges": gauges(rate=2 * GROWTH)}, "memory flat"),
        ({"gauges": gauges() + gauges("r1", rate=2 * GROWTH)}, "memory flat"),
        ({"gauges": gauges(threads=MORE + 1)}, "threads flat"),
        ({"gauges": gauges(descriptors=MORE + 1)}, "descriptors flat"),
        ({"looks": looks(AGAIN + 0.2)}, "every surviving subject settled again within 5 s"),
        ({"looks": looks()[: 10 * SECONDS // 2]}, "every surviving subject settled again within 5 s"),
        ({"sent": {"r1": [Sent(0, 0, 0), Sent(900, 899 - BEHIND, 0)]}}, "counters add up"),
        ({"sent": {"r1": [Sent(0, 0, 0), Sent(900, 901 + BEHIND, 0)]}}, "counters add up"),
        ({"sent": {"r1": [Sent(0, 0, 0), Sent(900, 900, 1)]}}, "no inbox overflowed"),
    ],
)
def test_each_line_fails_where_it_is_not_true(changes: dict[str, object], line: str) -> None:
    assert failed(**changes) == [line]


def test_a_run_in_which_nobody_lives_long_enough_says_so() -> None:
    assert failed(gauges=gauges(until=int(LIFE) - 1))[0] == f"some process lives for {LIFE:g} s"


def test_the_world_s_lists_would_have_failed() -> None:
    """They took 8.5 MB in 4 minutes."""
    assert failed(gauges=gauges(rate=8.5 / 4)) == ["memory flat"]


def test_growth_is_of_one_life_without_its_beginning() -> None:
    warming = [Gauge(t, "r1", 2, 30.0 + 0.5 * min(t, 60), 9, 20) for t in range(150)]
    judged = lives(warming)
    assert growth(judged["r1", 2]) == pytest.approx((0.0, 0.75))
    assert growth(gauges(rate=3.0)) == pytest.approx((5.0, 5 / 3))


def test_a_long_life_may_grow_by_no_more_than_a_short_one() -> None:
    assert failed(gauges=gauges(rate=0.5)) == []  # too short a life to show it
    assert failed(gauges=gauges(rate=0.5, until=600)) == ["memory flat"]


def test_the_longest_time_without_a_belief_is_of_one_belief() -> None:
    ones, twos = (("a", "robot/r1"),), (("b", "robot/r1"),)
    history = [Look(float(t), float(t), ones if t < 3 else twos, 9) for t in range(7)]
    assert longest(history) == (3.0, "robot/r1 in b at 6 s")


def test_a_table_says_yes_or_no_in_each_line() -> None:
    lines = verdict(gauges(), looks(AGAIN + 1), SENT, SECONDS)
    assert [row.split()[0] for row in text(lines).splitlines()] == ["yes", "yes", "yes", "NO", "yes", "yes"]


def test_the_gauges_of_a_process() -> None:
    import os

    usage = read(1.0, "me", os.getpid())
    assert usage is not None
    assert usage.memory > 1
    assert usage.threads >= 1
    assert usage.descriptors >= 3
    assert read(1.0, "nobody", 1 << 30) is None
