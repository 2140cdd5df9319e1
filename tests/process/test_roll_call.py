"""Roll call: what is listed must have arrived; held against the obvious version that keeps everything."""

from collections import defaultdict

from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.roll_call import MAX_SOURCES, MAX_SUBJECTS, RollCall

events = st.lists(
    st.tuples(
        st.sampled_from(["heard", "listed"]), st.sampled_from("ab"), st.sets(st.sampled_from("xyz")), st.integers(0, 3)
    ),
    max_size=30,
)


@given(events=events, tick=st.integers(0, 3))
def test_it_is_what_a_log_of_everything_says(events: list[tuple[str, str, set[str], int]], tick: int) -> None:
    """The list of a source that arrived last counts; of what it sent about a subject the newest, and something newer will do."""
    roll: RollCall[str] = RollCall()
    lists: dict[str, tuple[int, set[str]]] = {}
    heard: dict[tuple[str, str], set[int]] = defaultdict(set)
    for what, source, subjects, at in events:
        if what == "listed":
            assert roll.record_list(source, at, subjects) == (at != lists.get(source, (None, ()))[0])
            lists[source] = at, subjects
        for subject in sorted(subjects) if what == "heard" else ():
            assert roll.record(source, subject, at) == (at > max(heard[source, subject], default=-1))
            heard[source, subject].add(at)
    for source in "ab":
        here = {subject for subject in "xyz" if any(at >= tick for at in heard[source, subject])}
        assert all(roll.arrived(source, tick, [subject]) == (subject in here) for subject in "xyz")
        assert roll.list_of(source) == lists.get(source)
        is_complete = source in lists and lists[source][0] == tick and lists[source][1] <= here
        assert roll.complete(source, tick) == is_complete
        assert (roll.answered(source) == tick) == is_complete


def test_it_is_bounded_and_the_oldest_is_forgotten_first() -> None:
    roll: RollCall[int] = RollCall()
    for i in range(MAX_SUBJECTS + 1):
        roll.record(0, f"object/{i}", 1)
    assert not roll.arrived(0, 1, ["object/0"])
    assert roll.arrived(0, 1, ["object/1", f"object/{MAX_SUBJECTS}"])
    for i in range(1, MAX_SOURCES + 1):
        roll.record(i, "object/1", 1)
        roll.record_list(i, 1, ["object/1"])
    assert not roll.arrived(0, 1, ["object/1"])
    assert roll.complete(1, 1)
    roll.record_list(MAX_SOURCES + 1, 1, [])
    assert roll.list_of(1) is None
