"""A joint that began later, as of a board that was started again, calls tracks as the one that began earlier."""

import math
from collections.abc import Sequence

import pytest

from blackboard.board.joint.desk import JointDesk
from blackboard.board.joint.evidence import names
from blackboard.wire.evidence import Forward, PackedTrack
from tests.board.joint.desks import at, means, new_desk, settled, sighting


def watched(desk: JointDesk, tick: int, people: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Two robots that stand see some of two people who stand: where the joint has which track."""
    stand = {"first": (0.0, 20.0), "second": (math.pi / 2, 10.0)}
    sees = [
        sighting("person/?", stand[person][1]).model_copy(update={"mark": mark, "bearing": stand[person][0]})
        for mark, person in enumerate(people)
    ]
    evidence = at(5, 10).model_copy(update={"relatives": sees})
    places = means(settled(desk, tick, r1=evidence, r2=at(10, 10)).values())
    return {name: place for name, place in places.items() if name.startswith("person/")}


def said(desk: JointDesk, tick: int, **more: object) -> Forward:
    """What a board of another sub-team passes on beside evidence."""
    return Forward(
        board="b", sub_team="b", tick=tick, time=0.2 * tick, since=desk.since, tracks=desk.tracks()
    ).model_copy(update=more)


def test_a_joint_that_began_later_calls_tracks_as_the_one_that_began_earlier() -> None:
    elder, alone, young = new_desk(), new_desk(), new_desk()
    for tick in range(16):
        people = ["first"] if tick < 4 else ["first", "second"]
        tracks = watched(elder, tick, people)
        if tick >= 8:
            other = watched(alone, tick, ["second"] if tick < 12 else people)
            young.hear_forward(said(elder, tick - 1))
            followed = watched(young, tick, ["second"] if tick < 12 else people)
    assert set(tracks) == set(other) == set(followed) == {"person/1", "person/2"}
    assert other["person/1"] == pytest.approx(tracks["person/2"], abs=1.0)
    for name, place in tracks.items():
        assert followed[name] == pytest.approx(place, abs=1.0)


def test_a_joint_that_began_earlier_keeps_its_names_whatever_another_one_says() -> None:
    calm, lied_to = new_desk(), new_desk()
    for tick in range(10):
        here = watched(calm, tick, ["first"])
        lied = [track.model_copy(update={"name": "person/99"}) for track in lied_to.tracks()]
        lied_to.hear_forward(said(lied_to, tick, since=0.4, tracks=lied))
        assert watched(lied_to, tick, ["first"]) == here
    assert set(here) == {"person/1"}


@pytest.mark.parametrize(
    "track",
    [
        {"name": "robot/r9"},
        {"name": "object/person-1"},
        {"name": "person/99", "mean": (5.0, 25.0)},
        {"name": "person/99", "covariance": (1.0, 2.0, 1.0)},
        {"name": "person/99", "covariance": (0.0, 0.0, 0.0), "mean": (1e12, -1e12)},
    ],
    ids=str,
)
def test_a_name_that_is_of_something_else_is_not_taken(track: dict[str, object]) -> None:
    desk = new_desk()
    place = {"name": "person/99", "mean": (25.0, 10.0), "covariance": (0.5, 0.0, 0.5), **track}
    for tick in range(8):
        desk.hear_forward(said(desk, tick, since=-1.0, tracks=[PackedTrack.model_validate(place)]))
        tracks = watched(desk, tick, ["first"])
    assert len(tracks) == 1
    assert not {"person/99", str(track["name"])} & tracks.keys()


@pytest.mark.parametrize(("given", "following"), [("41", "42"), *[("9" * digits, "1") for digits in (10, 63, 64)]])
def test_a_number_that_the_other_board_has_given_is_not_given_again_if_there_is_room_for_the_next(
    given: str, following: str
) -> None:
    """Before, the name of the next track had more characters than a subject may have, and the board died of it."""
    desk, there = new_desk(), PackedTrack(name=f"person/{given}", mean=(5.0, 25.0), covariance=(0.1, 0.0, 0.1))
    for tick in range(8):
        desk.hear_forward(said(desk, tick, since=-1e12, tracks=[there]))
        tracks = watched(desk, tick, ["first"])
    assert set(tracks) == {f"person/{following}"}


def test_the_prediction_among_those_who_contradict_is_no_robot_of_that_name() -> None:
    assert names({"robot/r3", "prediction"}) == "the prediction, r3"
