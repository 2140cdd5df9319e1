"""Records of unnamed things: what frames say for and against them, how much room and how many votes one observer has."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.tracks import FLEETING, HIDDEN, KEPT, LOST, MAX_TRACKS, NAMED, ROOM, STAYS, Tracks
from tests.present import present

KIND = "person/?"
HERE = (3.0, 0.1, 0.5)  # where a track is from all observers: in the view of those that have seen as far
DT = 0.2

OBSERVERS = st.sampled_from(["robot/r1", "robot/r2", "robot/r3"])
FRAMES = st.lists(st.tuples(OBSERVERS, st.floats(0, 1), st.floats(0, 10), st.floats(0, 3)), max_size=30)


def looking(*observers: str) -> Tracks:
    """Records in which some observers have seen things far and wide."""
    tracks = Tracks()
    for observer in observers:
        tracks.look(observer, KIND, 10.0, 1.5)
    return tracks


def begun(tracks: Tracks, observer: str) -> str:
    return present(tracks.begin(observer, KIND))


def existing(tracks: Tracks, block: str) -> float:
    return present(tracks.existence(block))


def shown(tracks: Tracks, block: str, shares: dict[str, float], seconds: float) -> None:
    """Frames of some observers, each with a probability that they show a track, for some time."""
    for _ in range(round(seconds / DT)):
        tracks.pass_time(DT)
        for observer, share in sorted(shares.items()):
            tracks.judge(observer, {block: HERE}, {block: share})


@given(FRAMES)
def test_existence_is_a_probability_whatever_is_seen(frames: list[tuple[str, float, float, float]]) -> None:
    tracks = looking("robot/r1", "robot/r2")
    block = begun(tracks, "robot/r1")
    for observer, share, distance, dt in frames:
        tracks.pass_time(dt)
        tracks.judge(observer, {block: (distance, 0.0, 0.5)}, {block: share})
        assert 0.0 <= existing(tracks, block) <= 1.0
        assert 0.0 <= tracks.expected(observer, block) < 1.0


@given(FRAMES)
def test_a_frame_that_shows_it_makes_it_surer_and_one_that_does_not_less_sure(
    frames: list[tuple[str, float, float, float]],
) -> None:
    tracks = looking("robot/r1", "robot/r2")
    block = begun(tracks, "robot/r1")
    for observer, share, _, dt in frames:
        tracks.pass_time(dt)
        before = existing(tracks, block)
        sure, unsure = tracks.copy(), tracks.copy()
        sure.judge(observer, {block: HERE}, {block: 1.0})
        unsure.judge(observer, {block: HERE}, {})
        assert existing(tracks, block) == before, "a copy was changed"
        assert existing(unsure, block) <= before <= existing(sure, block)
        tracks.judge(observer, {block: HERE}, {block: share})


def test_what_one_observer_keeps_seeing_becomes_sure_and_has_a_name() -> None:
    tracks = looking("robot/r1")
    block = begun(tracks, "robot/r1")
    assert tracks.to_be_named() == []
    shown(tracks, block, {"robot/r1": 0.99}, 1.0)
    assert tracks.to_be_named() == [block]
    name = tracks.name(block, lambda taken: False)
    assert name == "person/1"
    assert tracks.is_told(name)
    assert list(tracks) == [name]


def test_a_ghost_of_one_does_not_outlast_two_that_look_there() -> None:
    tracks = looking("robot/liar", "robot/r1", "robot/r2")
    block = begun(tracks, "robot/liar")
    alone = tracks.copy()
    shown(alone, block, {"robot/liar": 0.999}, 20.0)
    shown(tracks, block, {"robot/liar": 0.999, "robot/r1": 0.0, "robot/r2": 0.0}, 20.0)
    assert existing(alone, block) > NAMED
    assert existing(tracks, block) < 0.5


def test_a_thing_that_is_hidden_from_one_that_looks_there_lives_on_by_the_other() -> None:
    tracks = looking("robot/r1", "robot/r2")
    block = begun(tracks, "robot/r1")
    shown(tracks, block, {"robot/r1": 0.99, "robot/r2": 0.99}, 3.0)
    shown(tracks, block, {"robot/r1": 0.99, "robot/r2": 0.0}, 20.0)
    assert existing(tracks, block) > 0.5


def test_what_crosses_the_way_of_all_does_not_end_a_track() -> None:
    tracks = looking("robot/r1")
    name = begun(tracks, "robot/r1")
    shown(tracks, name, {"robot/r1": 0.99}, 3.0)
    name = tracks.name(name, lambda taken: False)
    sure = existing(tracks, name)
    shown(tracks, name, {"robot/r1": 0.0}, HIDDEN / 2)
    assert 0.5 < existing(tracks, name) < sure
    shown(tracks, name, {"robot/r1": 0.0}, 2 * HIDDEN)
    assert not tracks.is_told(name)


def test_a_pause_of_any_length_ends_all() -> None:
    tracks = looking("robot/r1")
    block = begun(tracks, "robot/r1")
    shown(tracks, block, {"robot/r1": 0.99}, 1.0)
    block = tracks.name(block, lambda taken: False)
    tracks.pass_time(1e6)
    assert existing(tracks, block) < 0.05
    assert tracks.ended() == [block]


def test_what_is_seen_straight_ahead_alone_or_at_no_distance_leaves_a_view_with_an_area() -> None:
    tracks = Tracks()
    assert tracks.area("robot/r1", KIND) > 0
    for distance in (0.0, 5.0):
        tracks.look("robot/r1", KIND, distance, 0.0)
        assert tracks.area("robot/r1", KIND) > 0


def test_where_nobody_looks_nothing_is_held_against_a_track() -> None:
    tracks = looking("robot/r1")
    block = begun(tracks, "robot/r1")
    before = existing(tracks, block)
    for place in ((20.0, 0.0, 0.5), (3.0, 2.5, 0.5)):
        tracks.judge("robot/r1", {block: place}, {})
        tracks.judge("robot/new", {block: place}, {})
    assert existing(tracks, block) == before


def test_a_track_at_the_edge_of_a_view_has_less_held_against_it_than_one_within() -> None:
    after = []
    for place in (HERE, (9.9, 0.0, 0.5), (20.0, 0.0, 0.5)):
        tracks = looking("robot/r1")
        block = begun(tracks, "robot/r1")
        tracks.judge("robot/r1", {block: place}, {})
        after.append(existing(tracks, block))
    within, edge, beyond = after
    assert within < edge < beyond


def test_the_few_sightings_that_err_most_leave_a_view_as_large_as_it_is() -> None:
    tracks = Tracks()
    for number in range(3000):
        distance, bearing = (17.0, 2.9) if number % 40 == 0 else (10.0 * math.sqrt(number % 97 / 96), 1.5)
        tracks.look("robot/r1", KIND, distance, bearing)
    assert tracks.area("robot/r1", KIND) == pytest.approx(1.5 * 10.0**2, rel=0.1)
    block = begun(tracks, "robot/r1")
    before = existing(tracks, block)
    for beyond in ((13.0, 0.1, 0.5), (3.0, 2.2, 0.5)):
        tracks.judge("robot/r1", {block: beyond}, {})
        assert existing(tracks, block) == before
    tracks.judge("robot/r1", {block: HERE}, {})
    assert existing(tracks, block) < before


@given(st.lists(st.sampled_from(["robot/r1", "robot/r2"]), max_size=5 * ROOM))
def test_nobody_has_more_room_than_its_own(asking: list[str]) -> None:
    tracks = Tracks()
    given_room = [robot for robot in asking if tracks.begin(robot, KIND) is not None]
    for observer in ("robot/r1", "robot/r2"):
        assert given_room.count(observer) == min(asking.count(observer), ROOM)


def test_there_is_an_end_of_room_for_all_together() -> None:
    tracks = Tracks()
    blocks = [tracks.begin(f"robot/r{k}", KIND) for k in range(2 * MAX_TRACKS)]
    assert len([block for block in blocks if block is not None]) == MAX_TRACKS


def test_what_was_lost_is_told_of_again_from_the_second_sighting_on() -> None:
    tracks = looking("robot/r1")
    name = begun(tracks, "robot/r1")
    shown(tracks, name, {"robot/r1": 0.99}, 3.0)
    name = tracks.name(name, lambda taken: False)
    tracks.lose(name, LOST * 10.0 * 0.99)
    assert tracks.is_told(name)
    tracks.lose(name, LOST * 10.0 * 1.01)
    assert not tracks.is_told(name)
    assert name in tracks
    shown(tracks, name, {"robot/r1": 0.99}, DT)
    assert not tracks.is_told(name)
    shown(tracks, name, {"robot/r1": 0.99}, DT)
    assert tracks.is_told(name)


def test_who_stays_out_of_sight_may_be_gone() -> None:
    """Two states, there or gone, with a constant rate of going: the odds after a time that nobody looks."""
    tracks = looking("robot/r1")
    name = begun(tracks, "robot/r1")
    shown(tracks, name, {"robot/r1": 0.99}, 3.0)
    before = existing(tracks, name)
    for _ in range(10):
        tracks.pass_time(1.0)
    assert existing(tracks, name) == pytest.approx(before * math.exp(-10.0 / STAYS))


def test_a_number_is_given_once_also_after_all_began_anew() -> None:
    tracks, names = Tracks(), []
    for _ in range(3):
        names.append(tracks.name(begun(tracks, "robot/r1"), lambda taken: taken == "person/2"))
        tracks.drop(names[-1])
        tracks = tracks.anew()
    assert names == ["person/1", "person/3", "person/4"]


def test_the_first_number_is_behind_all_that_anybody_has_heard_of() -> None:
    tracks = Tracks(label="a-")
    for numbers in ({"person/a-": 7, "person/b-": 40}, {"person/a-": 3, "object/ball-a-": 50}):
        tracks.remember(numbers)
    tracks = tracks.anew().copy()
    assert tracks.name(begun(tracks, "robot/r1"), lambda taken: False) == "person/a-8"


@pytest.mark.parametrize("numbers", [{"person/": 10**9}, {"person/": 0}, {"person/1": 5}, {"": 3}], ids=str)
def test_what_is_no_number_of_a_track_changes_no_name(numbers: dict[str, int]) -> None:
    tracks = Tracks()
    tracks.remember(numbers)
    assert tracks.name(begun(tracks, "robot/r1"), lambda taken: False) == "person/1"


@pytest.mark.parametrize(
    ("kind", "name"), [("robot/?", "object/robot-1"), ("object/ball?", "object/ball-1"), ("object/?", "object/1")]
)
def test_the_name_of_a_track_says_its_class_and_is_no_members(kind: str, name: str) -> None:
    tracks = Tracks()
    block = present(tracks.begin("robot/r1", kind))
    assert tracks.name(block, lambda taken: False) == name


def test_what_nobody_sees_any_more_is_over_and_what_has_a_name_stays_longer() -> None:
    tracks = Tracks()
    brief, named = begun(tracks, "robot/r1"), begun(tracks, "robot/r1")
    shown(tracks, named, {"robot/r1": 0.99}, 1.0)
    named = tracks.name(named, lambda taken: False)
    assert tracks.ended() == []
    tracks.pass_time(FLEETING)
    assert tracks.ended() == [brief]
    tracks.pass_time(KEPT)
    assert set(tracks.ended()) == {brief, named}


def test_who_has_no_vote_any_more_leaves_no_track_of_its_own() -> None:
    tracks = looking("robot/liar", "robot/r1")
    alone, both = begun(tracks, "robot/liar"), begun(tracks, "robot/liar")
    tracks.judge("robot/r1", {both: HERE}, {both: 0.99})
    tracks.without({"robot/liar"})
    assert tracks.ended() == [alone]


def test_of_an_observer_whose_tracks_came_to_nothing_the_next_is_worth_less() -> None:
    tracks = Tracks()
    first = existing(tracks, begun(tracks, "robot/r1"))
    for block in list(tracks):
        tracks.drop(block)
    assert existing(tracks, begun(tracks, "robot/r1")) < first
    assert existing(tracks, begun(tracks, "robot/r2")) == first
