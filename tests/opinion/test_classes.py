"""What belongs to a class of things."""

from blackboard.opinion.classes import could_be, is_class, kind_of, stem


def test_a_class_is_a_kind_or_a_kind_with_the_beginning_of_a_name() -> None:
    assert [is_class(name) for name in ("robot/?", "object/ball?", "object/ball1")] == [True, True, False]
    assert could_be("object/?", "object/ball1")
    assert could_be("object/ball?", "object/ball1")
    assert not could_be("object/ball?", "object/can")
    assert not could_be("person/?", "robot/r1")
    assert not could_be("robot/?", "robot/?"), "a class is nothing that is somewhere"
    assert not could_be("robot/r1", "robot/r1"), "and a name is no class"


def test_a_track_of_a_class_belongs_to_it_and_a_robot_of_no_team_is_no_member() -> None:
    assert [stem(kind) for kind in ("person/?", "robot/?", "object/ball?")] == [
        "person/",
        "object/robot-",
        "object/ball-",
    ]
    for kind in ("person/?", "robot/?", "object/ball?", "object/?"):
        assert could_be(kind, f"{stem(kind)}7")
    assert not could_be("person/?", "object/robot-7")
    assert stem("robot/r?") == "object/robot-r-", "also where a class has a part of a name"
    assert len(stem(f"object/{'x' * 63}?")) < 64
    assert [kind_of(s) for s in ("object/robot-7", "object/ball-7", "robot/r1")] == ["robot", "object", "robot"]
