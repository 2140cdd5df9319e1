"""Who was waited for in vain: for how many answered ticks it is not waited for, and that a tick counts once."""

from blackboard.process.in_vain import MAX_NAMES, MOST, InVain


def test_who_was_waited_for_in_vain_must_answer_more_ticks_each_time() -> None:
    in_vain = InVain()
    assert "r1" not in in_vain
    tick = 0
    for owed in (1, 4, 16, 64, MOST, MOST):
        assert in_vain.add("r1", tick) == owed
        for _ in range(owed):
            assert in_vain.names == {"r1"}
            in_vain.answered("r1", tick)
            tick += 1
        assert "r1" not in in_vain
        in_vain.check()


def test_a_tick_counts_once_and_not_one_from_before_it_was_late() -> None:
    in_vain = InVain()
    in_vain.add("r1", 3)
    in_vain.answered("r1", 3)
    in_vain.add("r1", 5)
    for tick in (4, 5, 5, 4, 6, 7):
        in_vain.answered("r1", tick)
    assert "r1" in in_vain
    in_vain.answered("r1", 9)
    assert "r1" not in in_vain


def test_an_answer_of_another_one_changes_nothing_and_names_are_bounded() -> None:
    in_vain = InVain()
    in_vain.answered("r2", 3)
    for number in range(MAX_NAMES + 10):
        in_vain.add(f"r{number}", 3)
    in_vain.check()
    assert len(in_vain.names) == MAX_NAMES
    in_vain.answered("r20", 3)
    assert "r20" not in in_vain
    assert "r21" in in_vain
