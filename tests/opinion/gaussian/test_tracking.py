"""A team that drives past people whom nobody names: tracks in its joint."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.identifying import MOST_SEEN
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.naming import Naming
from blackboard.opinion.gaussian.relation import Relative
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.grid import Array
from tests.opinion.gaussian.driving import Own, reports_of, team

SIGMA = 0.2


def sight_of(robot: Own, place: Array, kind: str = "person/?") -> Relative:
    """What a robot, which looks along x, sees of something at a place."""
    dx, dy = place - robot.place + robot.chance.normal(0, SIGMA, 2)
    distance = math.hypot(dx, dy)
    return Relative(robot.name, kind, distance, math.atan2(dy, dx), SIGMA**2, SIGMA**2 / distance**2)


def with_people(robots: Sequence[Own], tick: int, people: Mapping[str, Sequence[Array]]) -> list[Evidence]:
    """What all robots report of a tick; `people` are those that each sees, by robot."""
    reports = []
    for own, report in zip(robots, reports_of(robots, tick), strict=True):
        unnamed = [replace(sight_of(own, place), mark=mark) for mark, place in enumerate(people.get(own.name, ()))]
        reports.append(replace(report, relatives=(*report.relatives, *unnamed)))
    return reports


def walked(joint: TeamJoint, robots: Sequence[Own], ticks: range, *offsets: Sequence[float]) -> None:
    """Everybody sees people that walk in front of the first robot."""
    for tick in ticks:
        places = [robots[0].place + [1.0, 0.0] + np.array(offset) for offset in offsets]
        joint.settle(tick, 1.0, with_people(robots, tick, {robot.name: places for robot in robots}))


def tracks(joint: TeamJoint) -> list[str]:
    return [subject for subject in joint.subjects() if subject.startswith("person/")]


def a_team(number: int = 3, seed: int = 1) -> tuple[TeamJoint, list[Own]]:
    return TeamJoint(naming=Naming(400.0)), team(number, seed)


@pytest.mark.parametrize("seed", range(3))
def test_who_is_seen_by_several_is_told_of_soon_and_where_it_is(seed: int) -> None:
    joint, robots = a_team(seed=seed)
    walked(joint, robots, range(3), [4.0, -2.0], [6.0, 3.0])
    assert tracks(joint) == ["person/1", "person/2"]
    walked(joint, robots, range(3, 12), [4.0, -2.0], [6.0, 3.0])
    assert tracks(joint) == ["person/1", "person/2"]
    places = sorted(joint.marginal(track).mean.tolist() for track in tracks(joint))
    for place, offset in zip(places, ([4.0, -2.0], [6.0, 3.0]), strict=True):
        assert place == pytest.approx(robots[0].place + offset, abs=1.0)
        assert joint.tracks.existence("person/1") == pytest.approx(1.0, abs=0.01)


def test_unnamed_landmarks_are_for_the_robot_that_has_a_map_and_begin_no_tracks() -> None:
    joint, robots = a_team()
    for tick in range(10):
        post = replace(sight_of(robots[0], robots[0].place + [4.0, 1.0], "landmark/?"), mark=0)
        reports = reports_of(robots, tick)
        joint.settle(tick, 1.0, [replace(reports[0], relatives=(*reports[0].relatives, post)), *reports[1:]])
    assert not [subject for subject in joint.subjects() if subject.startswith("landmark/")]
    assert not list(joint.tracks)


def test_tracks_tell_no_robot_where_it_stands() -> None:
    joint, robots = a_team()
    alone, others = a_team()
    for tick in range(10):
        places = [own.place + [5.0, -1.0] for own in robots[:1]]
        reports = with_people(robots, tick, {own.name: places for own in robots})
        joint.settle(tick, 1.0, reports)
        alone.settle(tick, 1.0, [report.named() for report in reports])
    assert tracks(joint)
    for robot in others:
        assert joint.marginal(robot.name).mean == pytest.approx(alone.marginal(robot.name).mean, abs=1e-9)
        assert joint.marginal(robot.name).covariance == pytest.approx(alone.marginal(robot.name).covariance, abs=1e-9)


def test_one_sighting_alone_is_nobody() -> None:
    joint, robots = a_team()
    for tick in range(8):
        there = {"robot/r0": [robots[0].place + [5.0, 0.0]]} if tick == 3 else {}
        joint.settle(tick, 1.0, with_people(robots, tick, there))
        assert tracks(joint) == []


def test_who_is_gone_is_told_of_no_more_and_its_number_is_given_to_nobody() -> None:
    joint, robots = a_team()
    walked(joint, robots, range(5), [4.0, -2.0])
    assert tracks(joint) == ["person/1"]
    walked(joint, robots, range(5, 30))
    assert tracks(joint) == []
    assert list(joint.tracks) == []
    walked(joint, robots, range(30, 35), [4.0, -2.0])
    assert tracks(joint) == ["person/2"]


def test_who_is_in_each_frame_of_a_camera_that_is_slower_than_the_ticks_is_sure() -> None:
    """A tick without a camera frame is no evidence that nobody is there."""
    joint, robots = a_team()
    places = [robots[0].place + [45.0, aside] for aside in (-9.0, 0.0, 9.0)]
    for tick in range(42):
        people = {} if tick % 6 else {robots[0].name: places}
        joint.settle(tick, 0.1, with_people(robots, tick, people))
        if tick >= 18:
            assert tracks(joint) == ["person/1", "person/2", "person/3"], tick
            assert all(joint.tracks.existence(name) == pytest.approx(1.0, abs=0.02) for name in tracks(joint))


def test_detectors_of_a_robot_with_other_delays_do_not_speak_against_each_other() -> None:
    """Each shows things of its own class alone, in a frame of its own age."""
    joint, robots = a_team()
    place = robots[0].place + [45.0, -2.0]
    for tick in range(30):
        reports = with_people(robots, tick, {})
        ball = replace(sight_of(robots[0], place + [0.0, 4.0], "object/ball?"), mark=0)
        person = replace(sight_of(robots[0], place), mark=1, age=0.1)
        reports[0] = replace(reports[0], relatives=(*reports[0].relatives, ball, person))
        joint.settle(tick, 0.1, reports)
        for name in ("object/ball-1", "person/1") if tick >= 5 else ():
            assert name in joint.subjects(), tick
            assert joint.tracks.existence(name) == pytest.approx(1.0, abs=0.02)


def test_whom_a_robot_sees_beyond_as_many_as_are_looked_at_lives_by_another_one() -> None:
    """A robot's sightings beyond 16 are dropped. A track that is not among the others may be among those."""
    joint, robots = a_team()
    places = [robots[0].place + [x, y] for x in (45, 50, 60, 65, 55) for y in (-6.0, -2.0, 2.0, 6.0)]
    first, second, third = (robot.name for robot in robots)
    for tick in range(40):
        seen = {first: places, second: places, third: places[MOST_SEEN:]}
        joint.settle(tick, 0.2, with_people(robots, tick, seen))
    assert len(tracks(joint)) == len(places) > MOST_SEEN


def test_who_was_hidden_for_a_while_is_the_same_afterwards() -> None:
    joint, robots = a_team()
    walked(joint, robots, range(8), [4.0, -2.0])
    walked(joint, robots, range(8, 10))
    walked(joint, robots, range(10, 14), [4.0, -2.0])
    assert tracks(joint) == ["person/1"]


def test_who_goes_on_where_nobody_looks_is_told_of_no_more_and_found_again_by_the_same_name() -> None:
    joint, robots = a_team()
    for tick in range(19):
        place = robots[0].place + [5.0, -0.5 * tick]  # out of what was ever in view, from tick to tick
        hidden = 10 <= tick < 16
        people = {} if hidden else {robot.name: [place] for robot in robots}
        joint.settle(tick, 1.0, with_people(robots, tick, people))
        assert list(joint.tracks) == ["person/1"]
        if tick < 10 or tick > 16:  # the first sightings after a while are not clear yet
            assert tracks(joint) == ["person/1"], tick
        elif tick > 13:
            assert tracks(joint) == [], tick
    assert joint.marginal("person/1").mean == pytest.approx(place, abs=1.0)


@pytest.mark.parametrize("seed", range(1, 5))
def test_who_turns_while_nobody_sees_it_leaves_no_track_that_goes_straight_on(seed: int) -> None:
    joint, robots = a_team(seed=seed)
    start = robots[0].place + [20.0, -2.0]
    for tick in range(35):
        place = start + [0.0, 0.32 * min(tick, 40 - tick)]
        seen = {} if 20 <= tick < 25 else {robot.name: [place] for robot in robots}
        joint.settle(tick, 0.2, with_people(robots, tick, seen))
    assert tracks(joint) == ["person/1"]
    assert joint.marginal("person/1").mean == pytest.approx(place, abs=1.0)


@pytest.mark.parametrize("seed", range(1, 3))
def test_who_comes_back_after_its_track_is_over_because_nobody_knew_its_place_has_its_name(seed: int) -> None:
    joint, robots = a_team(seed=seed)
    over = False
    for tick in range(24):
        place = robots[0].place + [5.0, -0.5 * tick]
        hidden = 10 <= tick < 20
        joint.settle(tick, 1.0, with_people(robots, tick, {} if hidden else {it.name: [place] for it in robots}))
        over |= not list(joint.tracks)
    assert over
    assert tracks(joint) == ["person/1"]
    assert joint.marginal("person/1").mean == pytest.approx(place, abs=1.5)


def test_a_name_that_was_exchanged_for_that_of_an_elder_board_is_nobodys() -> None:
    joint, robots = a_team()
    walked(joint, robots, range(5), [4.0, -2.0])
    joint.called = {"person/9": Moments(joint.marginal("person/1").mean + [1.0, 0.0], np.eye(2) * 0.1)}
    walked(joint, robots, range(5, 6), [4.0, -2.0])
    assert tracks(joint) == ["person/9"]
    joint.called = {}
    walked(joint, robots, range(6, 10), [4.0, -2.0], [4.0, 0.5])
    assert tracks(joint) == ["person/2", "person/9"]


def test_who_may_be_anywhere_is_no_track_any_more() -> None:
    joint, robots = a_team()
    walked(joint, robots, range(5), [4.0, -2.0])
    kept = joint.copy()
    joint.objects = replace(joint.objects, drifts={"1": 30.0}, models={"1": "walk"})
    for each in (joint, kept):
        each.settle(5, 1.0, [replace(report, relatives=()) for report in reports_of(robots, 5)])
    assert list(kept.tracks) == ["person/1"]
    assert list(joint.tracks) == []


def test_two_whose_ways_cross_keep_their_names() -> None:
    joint, robots = a_team()
    for tick in range(21):
        side = 0.3 * (10 - tick)
        places = [robots[0].place + [5.0, side], robots[0].place + [6.0, -side]]
        joint.settle(tick, 1.0, with_people(robots, tick, {robot.name: places for robot in robots}))
        if tick == 5:
            first = {track: joint.marginal(track).mean[1] - robots[0].place[1] > 0 for track in tracks(joint)}
    assert len(first) == 2
    assert tracks(joint) == sorted(first)
    assert {track: joint.marginal(track).mean[1] - robots[0].place[1] < 0 for track in tracks(joint)} == first


def test_a_flood_of_one_finds_its_own_room_and_no_more() -> None:
    joint, robots = a_team()
    left_out = 0
    for tick in range(6):
        ghosts = [robots[0].place + [10.0 * math.cos(k), 10.0 * math.sin(k)] for k in range(64)]
        mine = [robots[1].place + [4.0, 2.0]]
        joint.settle(tick, 1.0, with_people(robots, tick, {"robot/r0": ghosts, "robot/r1": mine, "robot/r2": mine}))
        left_out += joint.tally.tracks["unnamed_left_out"]
    assert left_out >= 6 * (64 - MOST_SEEN)
    places = [joint.marginal(track).mean for track in tracks(joint)]
    assert min(float(np.hypot(*(place - mine[0]))) for place in places) < 1.5, "an honest track finds room beside it"


def test_who_is_contradicted_by_the_team_begins_nobody() -> None:
    joint, robots = a_team(4)
    for tick in range(12):
        reports = with_people(robots, tick, {"robot/r0": [robots[0].place + [4.0, -2.0]]})
        away = tuple(
            relative if relative.subject == "person/?" else replace(relative, range=relative.range + 8.0)
            for relative in reports[0].relatives
        )
        joint.settle(tick, 1.0, [replace(reports[0], relatives=away), *reports[1:]])
    assert "robot/r0" in joint.left_out
    assert tracks(joint) == []


def test_an_unnamed_robot_of_no_team_is_a_track_and_mates_are_none() -> None:
    joint, robots = a_team()
    for tick in range(8):
        stranger = robots[0].place + [5.0, -2.0]
        reports = []
        for own, report in zip(robots, reports_of(robots, tick), strict=True):
            mates = [replace(relative, subject="robot/?") for relative in report.relatives]
            frame = [
                replace(relative, mark=mark)
                for mark, relative in enumerate((*mates, sight_of(own, stranger, "robot/?")))
            ]
            reports.append(replace(report, relatives=tuple(frame)))
        joint.settle(tick, 1.0, reports)
    assert joint.subjects() == ["object/robot-1", *(robot.name for robot in robots)]
    assert joint.marginal("object/robot-1").mean == pytest.approx(stranger, abs=1.0)


def test_a_class_that_is_none_of_things_that_move_or_part_of_a_members_name_harms_nobody() -> None:
    joint, robots = a_team()
    for tick in range(6):
        places = [robots[0].place + [4.0, -2.0], robots[0].place + [5.0, 3.0]]
        reports = []
        for own, report in zip(robots, reports_of(robots, tick), strict=True):
            unnamed = [
                sight_of(own, place, kind) for place, kind in zip(places, ("landmark/?", "robot/x?"), strict=True)
            ]
            reports.append(replace(report, relatives=(*report.relatives, *unnamed)))
        joint.settle(tick, 1.0, reports)
    assert joint.subjects() == ["object/robot-x-1", *(robot.name for robot in robots)]


def test_the_order_of_arrival_changes_nothing() -> None:
    in_order, robots = a_team(4, 5)
    shuffled = in_order.copy()
    for tick in range(10):
        people = [robots[0].place + [4.0, -2.0], robots[0].place + [4.5, -1.5], robots[0].place + [5.0, 4.0]]
        reports = with_people(robots, tick, {robot.name: people for robot in robots})
        in_order.settle(tick, 1.0, reports)
        shuffled.settle(tick, 1.0, [replace(report, relatives=report.relatives[::-1]) for report in reports[::-1]])
        assert in_order.subjects() == shuffled.subjects()
        assert [in_order.tracks.existence(track) for track in in_order.tracks] == [
            shuffled.tracks.existence(track) for track in shuffled.tracks
        ]
    assert len(tracks(in_order)) == 3
    assert (in_order.joint.mean == shuffled.joint.mean).all()
    assert (in_order.joint.covariance == shuffled.joint.covariance).all()


def told_of_two(seed: int, between: float) -> tuple[Array, Array]:
    """Two people walk towards each other until `between` is left: sigmas and errors of their estimated places, along one axis."""
    joint, robots = a_team(seed=seed)
    for tick in range(14):
        half = max(between, 4.0 - 0.5 * tick) / 2
        walked(joint, robots, range(tick, tick + 1), [5.0, -half], [5.0, half])
    told, places = tracks(joint), [robots[0].place + [5.0, -half], robots[0].place + [5.0, half]]
    assert told == ["person/1", "person/2"]
    sigmas = [math.sqrt(joint.marginal(track).covariance.trace() / 2) for track in told]
    errors = [min(math.dist(joint.marginal(track).mean, place) for place in places) / math.sqrt(2) for track in told]
    return np.array(sigmas), np.array(errors)


@pytest.mark.long
def test_where_two_that_meet_are_is_told_as_much_less_exactly_as_it_is_known() -> None:
    apart, met = (np.array([told_of_two(seed, between) for seed in range(12)]) for between in (4.0, 0.1))
    assert (met[:, 0].min(axis=1) > apart[:, 0].max(axis=1)).all()
    less_exactly, farther_off = np.sqrt(np.square(met).mean(axis=(0, 2)) / np.square(apart).mean(axis=(0, 2)))
    assert less_exactly > max(1.15, farther_off)
    assert (met[:, 1] < 2.45 * met[:, 0]).mean() > 0.95  # the region of 95 %


@pytest.mark.parametrize("seed", range(2, 6))
def test_a_detector_that_shows_somebody_twice_makes_nobody_of_that(seed: int) -> None:
    joint, robots = a_team(seed=seed)
    chance, told = np.random.default_rng(seed), []
    for tick in range(60):
        places = [robots[0].place + [5.0, -2.0], robots[0].place + [7.0, 3.0]]
        shown = {
            robot.name: [p for p in places for _ in range(1 + (chance.random() < 0.3)) if chance.random() < 0.9]
            for robot in robots
        }
        joint.settle(tick, 0.2, with_people(robots, tick, shown))
        told.append(len(tracks(joint)))
    assert told[-30:] == [2] * 30


def test_who_steps_out_from_behind_somebody_is_another_one_for_a_detector_that_shows_some_twice_too() -> None:
    joint, robots = a_team()
    chance = np.random.default_rng(1)
    for tick in range(60):
        place, aside = robots[0].place + [5.0, -2.0], np.array([0.0, 0.15 * max(0, tick - 40)])
        shown = {robot.name: [place] * (1 + (chance.random() < 0.3)) for robot in robots}
        if aside.any():
            shown = {name: [*its, place + aside] for name, its in shown.items()}
        joint.settle(tick, 0.2, with_people(robots, tick, shown))
        if tick == 40:
            assert len(tracks(joint)) == 1
    assert len(tracks(joint)) == 2
