"""When a board without a world has reason to settle early: held against robots that step at any times."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from blackboard.board.steps import Steps
from blackboard.process.roll_call import MAX_SOURCES

ROBOTS = [f"r{n}" for n in range(5)]
NOW = 1_000_000.0
PERIOD = 0.1  # seconds between two steps of a robot


def ends(steps: Steps, said: list[tuple[float, str]], early: bool = False) -> list[tuple[float, str]]:
    """At whose steps, and when, a board settles that does so whenever it has reason; `early`: once in the midst of them."""
    settlements, ticks = [], Counter[str]()
    for number, (at, robot) in enumerate(sorted(said)):
        ticks[robot] += 1
        steps.on_step(robot, ticks[robot], NOW + at)
        steps.check()
        if steps.are_told or (early and number == 1):
            settlements.append((at, robot))
            steps.begin_tick()
            steps.check()
            assert not steps.are_told
    return settlements


def steady(phases: list[float], rounds: int) -> list[tuple[float, str]]:
    """Steps of robots that all step once in a period, each so many periods late."""
    return [((n + phase) * PERIOD, ROBOTS[i]) for n in range(rounds) for i, phase in enumerate(phases)]


@given(st.lists(st.floats(0.0, 0.99), min_size=1, max_size=5), st.booleans())
def test_robots_that_step_equally_often_are_settled_once_in_each_of_their_steps(
    phases: list[float], early: bool
) -> None:
    settlements = ends(Steps(), steady(phases, 30), early)
    for n in range(5, 28):
        assert len([at for at, _ in settlements if n * PERIOD <= at < (n + 1) * PERIOD - 1e-9]) == 1


@given(st.lists(st.floats(0.0, 0.2), min_size=1, max_size=5), st.booleans())
def test_robots_that_step_shortly_after_each_other_are_settled_after_the_last_one(
    phases: list[float], early: bool
) -> None:
    """Also where a period ended in the midst of their steps."""
    said = steady(phases, 30)
    last = [max((at, robot) for at, robot in said if n <= at / PERIOD + 1e-9 < n + 1) for n in range(30)]
    assert ends(Steps(), said, early)[-20:] == last[-20:]


@given(st.lists(st.tuples(st.sampled_from(ROBOTS), st.integers(0, 3), st.floats(0.0, 1.0)), max_size=60))
def test_nobody_is_waited_for_longer_than_another_one_tells_two_steps(said: list[tuple[str, int, float]]) -> None:
    steps, newest, since, now = Steps(), dict[str, int](), Counter[str](), NOW
    for robot, tick, wait in said:
        now += wait
        since[robot] += newest.get(robot) != tick
        newest[robot] = tick
        steps.on_step(robot, tick, now)
        steps.check()
        assert steps.are_told or max(since.values()) <= 1
        assert not steps.are_told or any(since.values())
        if steps.are_told:
            steps.begin_tick()
            since.clear()


def test_who_falls_silent_delays_one_settlement_by_one_step_of_another() -> None:
    said = steady([0.0, 0.1], 5) + [(n * PERIOD, "r0") for n in range(5, 9)]
    assert [at for at, _ in ends(Steps(), said) if at > 0.42] == [n * PERIOD for n in (6, 7, 8)]


def test_strangers_are_forgotten() -> None:
    steps = Steps()
    for n in range(3 * MAX_SOURCES):
        steps.on_step(f"r{n}", 0, NOW)
        steps.check()
    assert steps.are_told
