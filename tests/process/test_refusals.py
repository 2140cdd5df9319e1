"""What a board tells of what it refused: the newest of each robot, once a second, and nothing that was taken after all."""

from blackboard.errors import Refused
from blackboard.process.refusals import MAX_SOURCES, PERIOD, Refusals
from blackboard.wire.types import MAX_NAME


def key(robot: str, subject: str = "object/ball", sub_team: str = "a") -> str:
    return f"cop/t/{sub_team}/report/{robot}/{subject}"


def early(refusals: Refusals) -> None:
    """Refuse a report of r1 whose token may still come."""
    refusals.record(key("r1"), Refused("unregistered", ""), early=True)


def test_the_newest_of_each_robot_is_told_with_how_many_there_were() -> None:
    refusals = Refusals()
    for subject in ("object/ball", "robot/r1"):
        refusals.record(key("r1", subject), Refused("grid", f"not {subject}"))
    refusals.record("cop/t/a/status/r2", Refused("fields", "x" * 999))
    (_, first), (sub_team, second) = refusals.due(10.0)
    assert (first.robot, first.subject, first.reason, first.text, first.count) == (
        "r1", "robot/r1", "grid", "not robot/r1", 2,
    )  # fmt: skip
    assert (sub_team, second.robot, second.subject, second.text) == ("a", "r2", None, "x" * MAX_NAME)


def test_it_is_told_once_and_at_most_once_in_a_period() -> None:
    refusals = Refusals()
    refusals.record(key("r1"), Refused("grid", ""))
    assert len(refusals.due(10.0)) == 1
    refusals.record(key("r1"), Refused("grid", ""))
    assert refusals.due(10.0 + 0.9 * PERIOD) == []
    assert [refusal.count for _, refusal in refusals.due(10.0 + PERIOD)] == [2]
    assert refusals.due(99.0) == []


def test_what_came_early_is_told_after_a_period_in_which_it_was_not_taken() -> None:
    refusals = Refusals()
    for at in (10.0, 10.5):
        early(refusals)
        assert refusals.due(at) == []
    assert [refusal.reason for _, refusal in refusals.due(10.0 + PERIOD)] == ["unregistered"]


def test_what_was_taken_after_all_is_not_told_and_a_later_one_waits_again() -> None:
    refusals = Refusals()
    early(refusals)
    assert refusals.due(10.0) == []
    refusals.handled(key("r1", "robot/r1"))
    assert refusals.due(20.0) == []
    early(refusals)
    assert refusals.due(30.0) == []


def test_a_status_that_is_taken_does_not_hide_that_reports_are_refused() -> None:
    """Where no world is, reports that were stamped long ago were refused in silence."""
    refusals = Refusals()
    for at in (10.0, 10.5):
        early(refusals)
        assert refusals.due(at) == []
        refusals.handled("cop/t/a/status/r1")
    assert [refusal.reason for _, refusal in refusals.due(10.0 + PERIOD)] == ["unregistered"]


def test_a_robot_that_was_told_and_then_taken_may_come_early_again() -> None:
    refusals = Refusals()
    refusals.record(key("r1"), Refused("grid", ""))
    assert len(refusals.due(10.0)) == 1
    refusals.due(11.5)
    refusals.handled(key("r1"))
    early(refusals)
    assert refusals.due(20.0) == []


def test_names_are_bounded_and_keys_that_name_nobody_are_left_out() -> None:
    refusals = Refusals()
    for name in ("cop/**", "cop/t/a/agreed/robot/r1", "x", key("r1", "board-a/ball"), key("r1", "r1/r2")):
        refusals.record(name, Refused("wild-key", ""))
    assert refusals.due(1.0) == []
    for i in range(3 * MAX_SOURCES):
        refusals.record(key(f"x{i}"), Refused("unregistered", ""))
    robots = [refusal.robot for _, refusal in refusals.due(2.0)]
    assert robots == [f"x{i}" for i in range(2 * MAX_SOURCES, 3 * MAX_SOURCES)]
