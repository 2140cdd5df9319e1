"""A joint that began later, as of a board that was started again, calls tracks as the one that began earlier."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from blackboard.board.joint.desk import JointDesk
from blackboard.wire.evidence import Forward, PackedTrack
from tests.board.joint.desks import MAKE, at, desk, means, sighting


def watched(it: JointDesk, tick: int, seen: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Two robots that stand see some of two people who stand: where the joint has which track."""
    places = {"first": (0.0, 20.0), "second": (math.pi / 2, 10.0)}
    sees = [
        sighting("person/?", places[one][1]).model_copy(update={"mark": mark, "bearing": places[one][0]})
        for mark, one in enumerate(seen)
    ]
    evidence = at(5, 10).model_copy(update={"relatives": sees})
    it.take_evidence("r1", tick, 0.2 * tick, evidence, own=True)
    it.take_evidence("r2", tick, 0.2 * tick, at(10, 10), own=True)
    return {name: place for name, place in means(it.settle(0.2 * tick, MAKE)).items() if name.startswith("person/")}


def said(it: JointDesk, tick: int, **more: object) -> Forward:
    """What a board of another sub-team passes on beside evidence."""
    return Forward(board="b", sub_team="b", tick=tick, time=0.2 * tick, since=it.since, tracks=it.tracks()).model_copy(
        update=more
    )


def test_a_joint_that_began_later_calls_tracks_as_the_one_that_began_earlier() -> None:
    elder, alone, young = desk(), desk(), desk()
    for tick in range(16):
        seen = ["first"] if tick < 4 else ["first", "second"]
        told = watched(elder, tick, seen)
        if tick >= 8:
            other = watched(alone, tick, ["second"] if tick < 12 else seen)
            young.hear_forward(said(elder, tick - 1))
            found = watched(young, tick, ["second"] if tick < 12 else seen)
    assert set(told) == set(other) == set(found) == {"person/1", "person/2"}
    assert other["person/1"] == pytest.approx(told["person/2"], abs=1.0)
    for name, place in told.items():
        assert found[name] == pytest.approx(place, abs=1.0)


def test_a_joint_that_began_earlier_keeps_its_names_whatever_another_one_says() -> None:
    calm, told = desk(), desk()
    for tick in range(10):
        here = watched(calm, tick, ["first"])
        lied = [it.model_copy(update={"name": "person/99"}) for it in told.tracks()]
        told.hear_forward(said(told, tick, since=0.4, tracks=lied))
        assert watched(told, tick, ["first"]) == here
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
    it = desk()
    place = {"name": "person/99", "mean": (25.0, 10.0), "covariance": (0.5, 0.0, 0.5), **track}
    for tick in range(8):
        it.hear_forward(said(it, tick, since=-1.0, tracks=[PackedTrack.model_validate(place)]))
        found = watched(it, tick, ["first"])
    assert len(found) == 1
    assert not {"person/99", str(track["name"])} & found.keys()


def test_a_number_that_the_other_board_has_given_is_not_given_again() -> None:
    it, there = desk(), PackedTrack(name="person/41", mean=(5.0, 25.0), covariance=(0.1, 0.0, 0.1))
    for tick in range(8):
        it.hear_forward(said(it, tick, since=-1.0, tracks=[there]))
        found = watched(it, tick, ["first"])
    assert set(found) == {"person/42"}


@pytest.mark.parametrize("digits", [10, 63, 64])
def test_a_number_that_leaves_no_room_for_the_next_one_is_no_number(digits: int) -> None:
    """Before, the name of the next track had more characters than a subject may have, and the board died of it."""
    it, there = desk(), PackedTrack(name="person/" + "9" * digits, mean=(5.0, 25.0), covariance=(0.1, 0.0, 0.1))
    for tick in range(8):
        it.hear_forward(said(it, tick, since=-1e12, tracks=[there]))
        found = watched(it, tick, ["first"])
    assert set(found) == {"person/1"}
