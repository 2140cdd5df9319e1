"""How far a clock is off: by round trips, by what is certain without any, in steps, and bounded."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.offsets import LONGEST, MAX_SOURCES, OLD, TOLERANCE, WINDOW, ClockOffsets, StampEchoes

seconds = st.floats(0.0, 0.4)


def trip(
    offsets: ClockOffsets, ahead: float, *, there: float = 0.0, held: float = 0.0, back: float = 0.0, now: float = 100.0
) -> float:
    """A stamp goes to r1, is held and comes back, from `now` on; when it is back."""
    end = now + there + held + back
    offsets.round_trip("r1", now + there + held + ahead, now, held, end)
    return end


@given(st.floats(-20, 20), seconds, st.floats(0, 5), seconds)
def test_a_round_trip_finds_a_clock_to_within_half_of_it(ahead: float, there: float, held: float, back: float) -> None:
    offsets = ClockOffsets()
    trip(offsets, ahead, there=there, held=held, back=back)
    error = max(TOLERANCE, there + back)
    assert abs(offsets.ahead("r1") - ahead) <= error * 1.5 + 1e-6
    if abs(ahead) > 2 * error:
        assert abs(offsets.ahead("r1") - ahead) <= (there + back) / 2 + 1e-6


def test_the_shortest_of_the_last_round_trips_counts() -> None:
    offsets = ClockOffsets()
    trip(offsets, 3.0, back=1.5)
    assert offsets.ahead("r1") == pytest.approx(3.0 - 0.75)
    trip(offsets, 3.0)
    assert offsets.ahead("r1") == pytest.approx(3.0)
    for _ in range(WINDOW - 1):
        trip(offsets, 3.0, there=1.0)
    assert offsets.ahead("r1") == pytest.approx(3.0)


@given(st.floats(-20, 20), st.floats(-20, 20), st.lists(st.tuples(seconds, seconds), min_size=1), seconds)
def test_a_clock_that_is_set_is_known_by_the_next_round_trip(
    before: float, after: float, trips: list[tuple[float, float]], back: float
) -> None:
    """It once took until the last of the trips before was forgotten, and what a robot said meanwhile was refused as of the future."""
    offsets, now = ClockOffsets(), 100.0
    for there, here in trips:
        now = trip(offsets, before, there=there, back=here, now=now + 1.0)
    trip(offsets, after, back=back, now=now + 1.0)
    error = max(there + here for there, here in [*trips, (0.0, back)])
    assert abs(offsets.ahead("r1") - after) <= 1.5 * max(TOLERANCE, error) + 0.01


@pytest.mark.parametrize(("stamp", "held"), [(100.0 - LONGEST - 0.1, 0.0), (100.5, 0.0), (99.0, 1.5)])
def test_what_is_no_round_trip_tells_nothing(stamp: float, held: float) -> None:
    """As a status that somebody repeats long after it was sent."""
    offsets = ClockOffsets()
    offsets.round_trip("r1", 103.0, stamp, held, 100.0)
    assert offsets.ahead("r1") == 0.0


def test_without_a_round_trip_only_a_stamp_of_the_future_is_certain() -> None:
    offsets = ClockOffsets()
    offsets.stamped("r1", 95.0, 100.0)
    assert offsets.ahead("r1") == 0.0, "slow, or behind"
    offsets.stamped("r1", 103.0, 100.0)
    offsets.stamped("r1", 102.5, 100.1)
    assert offsets.ahead("r1") == pytest.approx(3.0)
    trip(offsets, 3.4)
    assert offsets.ahead("r1") == pytest.approx(3.4)


def test_small_changes_move_no_stamp() -> None:
    """Else a report could be stamped earlier than the one before it."""
    offsets = ClockOffsets()
    trip(offsets, 3.0)
    for number in range(2 * WINDOW):
        trip(offsets, 3.0 + 0.01 * (number % 3), now=101.0 + number)
    assert offsets.ahead("r1") == 3.0


def test_what_another_board_found_counts_until_there_is_a_round_trip() -> None:
    offsets = ClockOffsets()
    offsets.hear_offsets({"r1": -3.0}, 100.0)
    assert offsets.ahead("r1") == -3.0
    trip(offsets, -4.0)
    offsets.hear_offsets({"r1": -3.0}, 100.0)
    assert offsets.ahead("r1") == pytest.approx(-4.0)


def test_a_round_trip_with_an_earlier_clock_does_not_outlast_what_another_board_finds() -> None:
    """As on a board that no longer leads, whose stamps no robot sends back, while a robot is started again."""
    offsets = ClockOffsets()
    end = trip(offsets, 0.0)
    offsets.hear_offsets({"r1": -2.5}, end + OLD)
    assert offsets.ahead("r1") == 0.0
    offsets.hear_offsets({"r1": -2.5}, end + OLD + 0.1)
    assert offsets.ahead("r1") == -2.5
    trip(offsets, 5.0, now=end)
    offsets.hear_offsets({}, end + OLD + 0.1)
    assert offsets.corrections() == {}


def test_what_another_board_finds_no_more_is_forgotten() -> None:
    offsets = ClockOffsets()
    offsets.hear_offsets({"r1": 2.0}, 100.0)
    offsets.hear_offsets({}, 100.0)
    assert offsets.corrections() == {}


def test_memory_is_bounded() -> None:
    offsets, echoes = ClockOffsets(), StampEchoes()
    for number in range(2 * MAX_SOURCES):
        offsets.stamped(f"r{number}", 103.0, 100.0)
        offsets.round_trip(f"q{number}", 103.0, 100.0, 0.0, 100.0)
        echoes.hear_stamp(f"b{number}", 1.0, 100.0)
    offsets.hear_offsets({f"p{number}": 9.0 for number in range(2 * MAX_SOURCES)}, 100.0)
    assert len(offsets.corrections()) <= MAX_SOURCES
    assert len(echoes.held(100.0)) == MAX_SOURCES


def test_the_newest_stamp_of_each_peer_is_held_since_it_came_first() -> None:
    echoes = StampEchoes()
    echoes.hear_stamp("b", 7.0, 100.0)
    echoes.hear_stamp("b", 7.0, 100.5)
    echoes.hear_stamp("a", 8.0, 100.5)
    assert echoes.held(101.0) == {"a": (8.0, 0.5), "b": (7.0, 1.0)}
    echoes.hear_stamp("b", 7.2, 101.0)
    assert echoes.held(101.0)["b"] == (7.2, 0.0)
