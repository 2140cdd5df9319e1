"""Roll call: what is listed must have arrived; held against the obvious version that keeps everything."""

from hypothesis import given
from hypothesis import strategies as st

from blackboard.process.roll_call import MAX_SOURCES, MAX_SUBJECTS, RollCall


def test_all_that_is_listed_must_have_arrived() -> None:
    roll: RollCall[str] = RollCall()
    assert not roll.complete("r1", 3)
    assert roll.record_list("r1", 3, ["robot/r1", "object/ball"])
    assert not roll.complete("r1", 3)
    assert roll.record("r1", "robot/r1", 3)
    assert not roll.complete("r1", 3)
    assert roll.record("r1", "object/ball", 3)
    assert roll.complete("r1", 3)
    assert not roll.complete("r1", 2)  # a list of another tick
    assert not roll.complete("r2", 3)
    assert roll.list_of("r1") == (3, {"robot/r1", "object/ball"})


def test_an_older_one_does_not_do_and_a_newer_one_does() -> None:
    roll: RollCall[str] = RollCall()
    roll.record_list("r1", 3, ["robot/r1"])
    roll.record("r1", "robot/r1", 2)
    assert not roll.complete("r1", 3)
    assert roll.record("r1", "robot/r1", 4)
    assert not roll.record("r1", "robot/r1", 4)
    assert not roll.record("r1", "robot/r1", 1)
    assert roll.complete("r1", 3)
    assert roll.arrived("r1", 4, ["robot/r1"])
    assert not roll.arrived("r1", 5, ["robot/r1"])


def test_an_empty_list_is_complete() -> None:
    roll: RollCall[str] = RollCall()
    roll.record_list("r1", 0, [])
    assert roll.complete("r1", 0)
    assert not roll.record_list("r1", 0, [])


def test_a_source_that_was_started_again_may_count_anew() -> None:
    roll: RollCall[str] = RollCall()
    roll.record_list("r1", 900, [])
    assert roll.record_list("r1", 1, [])
    assert roll.complete("r1", 1)


events = st.lists(
    st.tuples(
        st.sampled_from(["heard", "listed"]), st.sampled_from("ab"), st.sets(st.sampled_from("xyz")), st.integers(0, 3)
    ),
    max_size=30,
)


@given(events=events, tick=st.integers(0, 3))
def test_it_is_what_a_log_of_everything_says(events: list[tuple[str, str, set[str], int]], tick: int) -> None:
    roll: RollCall[str] = RollCall()
    for what, source, subjects, at in events:
        if what == "listed":
            roll.record_list(source, at, subjects)
        else:
            for subject in sorted(subjects):
                roll.record(source, subject, at)
    for source in "ab":
        lists = [(at, subjects) for what, who, subjects, at in events if (what, who) == ("listed", source)]
        heard = [(s, at) for what, who, subjects, at in events if (what, who) == ("heard", source) for s in subjects]
        slow = (
            bool(lists)
            and lists[-1][0] == tick
            and all(any(s == t and at >= tick for t, at in heard) for s in lists[-1][1])
        )
        assert roll.complete(source, tick) == slow


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
