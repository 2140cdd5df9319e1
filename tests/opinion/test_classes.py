"""What belongs to a class of things."""

from __future__ import annotations

from blackboard.opinion.classes import could_be, is_class


def test_a_class_is_a_kind_or_a_kind_with_the_beginning_of_a_name() -> None:
    assert [is_class(name) for name in ("robot/?", "object/ball?", "object/ball1")] == [True, True, False]
    assert could_be("object/?", "object/ball1")
    assert could_be("object/ball?", "object/ball1")
    assert not could_be("object/ball?", "object/can")
    assert not could_be("person/?", "robot/r1")
    assert not could_be("robot/?", "robot/?"), "a class is nothing that is somewhere"
    assert not could_be("robot/r1", "robot/r1"), "and a name is no class"
