"""Sightings of `robot/?` in a joint: taken for whom they clearly are of, left out where that is not clear, held against nobody."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.naming import Naming
from blackboard.opinion.gaussian.relation import Relative, measured
from blackboard.opinion.gaussian.sightings import projected
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import Motion
from tests.opinion.gaussian.driving import Own, team, told


def nameless(report: Evidence) -> Evidence:
    seen = (replace(it, subject="robot/?", mark=mark) for mark, it in enumerate(report.relatives))
    return replace(report, relatives=tuple(seen))


def began(robots: Sequence[Own]) -> TeamJoint:
    """A joint that has heard of all robots for a few ticks."""
    found = TeamJoint(naming=Naming(400.0))
    for tick in range(3):
        found.settle(tick, 1.0, told(robots, tick))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_where_it_is_clear_who_was_seen_names_change_nothing_much(seed: int) -> None:
    robots = team(4, seed)
    named, taken, wrong = began(robots), 0, 0
    unnamed = named.copy()
    for tick in range(3, 23):
        reports = told(robots, tick)
        named.settle(tick, 1.0, reports)
        unnamed.settle(tick, 1.0, [nameless(it) for it in reports])
        who = {(it.robot, mark): seen.subject for it in reports for mark, seen in enumerate(it.relatives)}
        mine = [it for it in unnamed.tally.unnamed if it.taken is not None]
        taken += len(mine)
        wrong += sum(it.taken != who[it.source, it.mark] for it in mine)
    assert taken > 0.9 * 20 * 12
    assert wrong == 0
    for robot in robots:
        both = named.marginal(robot.name), unnamed.marginal(robot.name)
        assert both[1].mean == pytest.approx(both[0].mean, abs=0.15)
        assert np.trace(both[1].covariance) < 1.2 * np.trace(both[0].covariance)


def beside(robots: list[Own], bearing: float) -> tuple[TeamJoint, Relative, list[Evidence]]:
    """Two robots 0.3 beside each other, what the first one sees at a bearing from one of them, and the evidence of that tick."""
    robots[2].place = robots[1].place + [0.0, 0.3]
    it = TeamJoint(naming=Naming(400.0))
    for tick in range(3):
        it.settle(tick, 1.0, [replace(one, relatives=()) for one in told(robots, tick)])
    away = robots[1].place - robots[0].place
    ahead = float(np.arctan2(*away[::-1]))
    seen = Relative(robots[0].name, "robot/?", float(np.hypot(*away)), ahead + bearing, 0.04, 0.01, mark=0)
    return it, seen, [replace(one, relatives=()) for one in told(robots, 3)]


def settled(before: TeamJoint, reports: list[Evidence], *seen: Relative) -> TeamJoint:
    after = before.copy()
    after.settle(3, 1.0, [replace(reports[0], relatives=seen), *reports[1:]])
    return after


def test_where_it_is_not_clear_the_belief_is_the_mean_over_all_that_were_seen_perhaps() -> None:
    before, seen, reports = beside(team(3, 1), 0.0)
    it = settled(before, reports, seen)
    (found,) = it.tally.unnamed
    assert found.taken is None
    assert not found.is_strange
    assert found.odds is not None
    assert set(found.odds) == {"robot/r1", "robot/r2"}
    parts = [
        (share, settled(before, reports, replace(seen, subject=one, mark=None))) for one, share in found.odds.items()
    ]
    parts.append((1.0 - sum(found.odds.values()), settled(before, reports)))
    for robot in it.subjects():
        means = [part.marginal(robot).mean for _, part in parts]
        mean = sum(share * its for (share, _), its in zip(parts, means, strict=True))
        spread = sum(
            share * (part.marginal(robot).covariance + np.outer(its - mean, its - mean))
            for (share, part), its in zip(parts, means, strict=True)
        )
        assert it.marginal(robot).mean == pytest.approx(mean, abs=1e-3)
        assert it.marginal(robot).covariance == pytest.approx(spread, abs=1e-3)


def test_what_a_track_may_have_of_it_is_kept_from_no_mate() -> None:
    """A blind robot's first sighting of a mate was left out for a faint track near it, and it took the next one for another mate."""
    before, seen, reports = beside(team(3, 1), 0.0)
    without = settled(before, reports, seen)
    place = replace(seen, observer="robot/r1", range=1.5, bearing=2.5, range_variance=1.0)
    before.tracks.begin("robot/r1", "robot/?")
    (track,) = before.tracks
    before.joint.add(track, projected(before.joint, place, Motion()))
    before.seen[track] = 0.0
    it = settled(before, reports, seen)
    (found,), (alone,) = it.tally.unnamed, without.tally.unnamed
    assert found.taken is None
    assert found.odds is not None
    assert alone.odds is not None
    assert sum(found.odds.values()) < sum(alone.odds.values()) - 0.001, "a little of it may be of the track"
    none = settled(before, reports)
    for robot in ("robot/r0", "robot/r1", "robot/r2"):
        assert it.marginal(robot).mean == pytest.approx(without.marginal(robot).mean, abs=0.01)
        assert np.hypot(*(it.marginal(robot).mean - none.marginal(robot).mean)) > 0.02


def test_two_of_a_frame_that_are_not_clear_are_left_out() -> None:
    """Somebody who lies about all its mates at once would take them all along in one tick, before it is doubted."""
    before, seen, reports = beside(team(3, 1), 0.0)
    none, both = settled(before, reports), settled(before, reports, seen, replace(seen, range=seen.range + 0.1, mark=1))
    assert [it.taken for it in both.tally.unnamed] == [None, None]
    for robot in both.subjects():
        assert (both.marginal(robot).mean == none.marginal(robot).mean).all()
        assert (both.marginal(robot).covariance == none.marginal(robot).covariance).all()


def test_an_older_frame_of_what_is_not_clear_counts_no_second_time() -> None:
    before, seen, reports = beside(team(3, 1), 0.0)
    once = settled(before, reports, seen)
    twice = settled(before, reports, seen, replace(seen, age=0.3, mark=1))
    assert (once.joint.covariance == twice.joint.covariance).all()
    assert len(twice.tally.unnamed) == 2


def test_what_is_far_from_everybody_is_nobody_known() -> None:
    before, seen, reports = beside(team(3, 1), 2.5)
    it = settled(before, reports, seen)
    (found,) = it.tally.unnamed
    assert found.is_strange
    assert found.taken is None
    assert it.subjects() == ["robot/r0", "robot/r1", "robot/r2"]


def test_an_observer_that_names_one_robot_did_not_see_it_once_more_in_the_same_frame() -> None:
    robots = team(3, 2)
    it, reports = began(robots), told(robots, 3)
    first = next(seen for seen in reports[0].relatives if seen.subject == "robot/r1")
    again = replace(first, subject="robot/?", mark=0)
    it.settle(3, 1.0, [replace(reports[0], relatives=(first, again)), *(replace(r, relatives=()) for r in reports[1:])])
    (found,) = it.tally.unnamed
    assert "robot/r1" not in (found.odds or {})


def test_a_named_object_is_found_again_by_sightings_of_its_class() -> None:
    robots = team(2, 3)
    it, reports = began(robots), told(robots, 3)
    ball = measured("position", "robot/r0", "object/ball1", (4.0, -2.0), (0.04, 0.0, 0.04))
    it.settle(3, 1.0, [replace(reports[0], relatives=(ball,)), replace(reports[1], relatives=())])
    reports = told(robots, 4)
    seen = tuple(replace(ball, subject=name, mark=mark) for mark, name in enumerate(("object/ball?", "person/?")))
    it.settle(4, 1.0, [replace(reports[0], relatives=seen), replace(reports[1], relatives=())])
    balls, people = it.tally.unnamed
    assert set(balls.odds or {}) <= {"object/ball1"}
    assert people.odds == {}


def test_by_sightings_without_names_nobody_is_judged() -> None:
    """A wrong name would be held against an honest observer, or a right one be to the credit of a liar."""
    it, robots = TeamJoint(naming=Naming(400.0)), team(4, 4)
    for tick in range(10):
        it.settle(tick, 1.0, [nameless(report) for report in told(robots, tick)])
    assert any(found.taken for found in it.tally.unnamed)
    assert it.trust.by_subject() == {}
    named = TeamJoint()
    named.settle(0, 1.0, told(team(4, 4), 0))
    assert set(named.trust.by_subject()) == {robot.name for robot in robots}


def test_the_order_of_arrival_changes_nothing() -> None:
    robots = team(4, 5)
    one = began(robots)
    other = one.copy()
    for tick in range(3, 9):
        reports = [nameless(it) for it in told(robots, tick)]
        one.settle(tick, 1.0, reports)
        turned = [replace(it, relatives=it.relatives[::-1]) for it in reports[::-1]]
        other.settle(tick, 1.0, turned)
        assert one.tally.unnamed == other.tally.unnamed
    assert (one.joint.mean == other.joint.mean).all()
    assert (one.joint.covariance == other.joint.covariance).all()
