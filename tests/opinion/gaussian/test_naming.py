"""Sightings of `robot/?` in a joint: taken for whom they clearly are of, left out where that is not clear, held against nobody."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from blackboard.opinion.gaussian.assignment import Rate
from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.naming import Naming
from blackboard.opinion.gaussian.relation import Relative, measured
from blackboard.opinion.gaussian.sightings import projected
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import Motion
from tests.opinion.gaussian.driving import Own, reports_of, team


def nameless(report: Evidence) -> Evidence:
    relatives = (replace(relative, subject="robot/?", mark=mark) for mark, relative in enumerate(report.relatives))
    return replace(report, relatives=tuple(relatives))


def began(robots: Sequence[Own]) -> TeamJoint:
    """A joint that has heard of all robots for a few ticks."""
    joint = TeamJoint(naming=Naming(400.0))
    for tick in range(3):
        joint.settle(tick, 1.0, reports_of(robots, tick))
    return joint


@pytest.mark.parametrize("seed", range(3))
def test_where_it_is_clear_who_was_seen_names_change_nothing_much(seed: int) -> None:
    robots = team(4, seed)
    named, taken, wrong = began(robots), 0, 0
    unnamed = named.copy()
    for tick in range(3, 23):
        reports = reports_of(robots, tick)
        named.settle(tick, 1.0, reports)
        unnamed.settle(tick, 1.0, [nameless(report) for report in reports])
        who = {
            (report.robot, mark): relative.subject
            for report in reports
            for mark, relative in enumerate(report.relatives)
        }
        mine = [sighting for sighting in unnamed.tally.unnamed if sighting.taken is not None]
        taken += len(mine)
        wrong += sum(sighting.taken != who[sighting.source, sighting.mark] for sighting in mine)
    assert taken > 0.9 * 20 * 12
    assert wrong == 0
    for robot in robots:
        both = named.marginal(robot.name), unnamed.marginal(robot.name)
        assert both[1].mean == pytest.approx(both[0].mean, abs=0.15)
        assert np.trace(both[1].covariance) < 1.2 * np.trace(both[0].covariance)


def beside(robots: list[Own], bearing: float) -> tuple[TeamJoint, Relative, list[Evidence]]:
    """Two robots 0.3 beside each other, what the first one sees at a bearing from one of them, and the evidence of that tick."""
    robots[2].place = robots[1].place + [0.0, 0.3]
    joint = TeamJoint(naming=Naming(400.0))
    for tick in range(3):
        joint.settle(tick, 1.0, [replace(report, relatives=()) for report in reports_of(robots, tick)])
    away = robots[1].place - robots[0].place
    ahead = float(np.arctan2(*away[::-1]))
    relative = Relative(robots[0].name, "robot/?", float(np.hypot(*away)), ahead + bearing, 0.04, 0.01, mark=0)
    return joint, relative, [replace(report, relatives=()) for report in reports_of(robots, 3)]


def settled(before: TeamJoint, reports: list[Evidence], *relatives: Relative) -> TeamJoint:
    after = before.copy()
    after.settle(3, 1.0, [replace(reports[0], relatives=relatives), *reports[1:]])
    return after


def test_where_it_is_not_clear_the_belief_is_the_mean_over_all_that_were_seen_perhaps() -> None:
    before, relative, reports = beside(team(3, 1), 0.0)
    after = settled(before, reports, relative)
    (unnamed,) = after.tally.unnamed
    assert unnamed.taken is None
    assert not unnamed.is_strange
    assert unnamed.odds is not None
    assert set(unnamed.odds) == {"robot/r1", "robot/r2"}
    parts = [
        (share, settled(before, reports, replace(relative, subject=name, mark=None)))
        for name, share in unnamed.odds.items()
    ]
    parts.append((1.0 - sum(unnamed.odds.values()), settled(before, reports)))
    for robot in after.subjects():
        means = [part.marginal(robot).mean for _, part in parts]
        mean = sum(share * its for (share, _), its in zip(parts, means, strict=True))
        spread = sum(
            share * (part.marginal(robot).covariance + np.outer(its - mean, its - mean))
            for (share, part), its in zip(parts, means, strict=True)
        )
        assert after.marginal(robot).mean == pytest.approx(mean, abs=1e-3)
        assert after.marginal(robot).covariance == pytest.approx(spread, abs=1e-3)


def test_what_a_track_may_have_of_it_is_kept_from_no_mate() -> None:
    """A blind robot's first sighting of a mate was left out for a faint track near it, and it took the next one for another mate."""
    before, relative, reports = beside(team(3, 1), 0.0)
    without = settled(before, reports, relative)
    place = replace(relative, observer="robot/r1", range=1.5, bearing=2.5, range_variance=1.0)
    before.tracks.begin("robot/r1", "robot/?")
    (track,) = before.tracks
    before.joint.add(track, projected(before.joint, place, Motion()))
    before.seen[track] = 0.0
    after = settled(before, reports, relative)
    (unnamed,), (alone,) = after.tally.unnamed, without.tally.unnamed
    assert unnamed.taken is None
    assert unnamed.odds is not None
    assert alone.odds is not None
    assert sum(unnamed.odds.values()) < sum(alone.odds.values()) - 0.001, "a little of it may be of the track"
    none = settled(before, reports)
    for robot in ("robot/r0", "robot/r1", "robot/r2"):
        assert after.marginal(robot).mean == pytest.approx(without.marginal(robot).mean, abs=0.01)
        assert np.hypot(*(after.marginal(robot).mean - none.marginal(robot).mean)) > 0.02


def test_two_of_a_frame_that_are_not_clear_are_left_out() -> None:
    """Somebody who lies about all its mates at once would take them all along in one tick, before it is doubted."""
    before, relative, reports = beside(team(3, 1), 0.0)
    none, both = (
        settled(before, reports),
        settled(before, reports, relative, replace(relative, range=relative.range + 0.1, mark=1)),
    )
    assert [unnamed.taken for unnamed in both.tally.unnamed] == [None, None]
    for robot in both.subjects():
        assert (both.marginal(robot).mean == none.marginal(robot).mean).all()
        assert (both.marginal(robot).covariance == none.marginal(robot).covariance).all()


def test_an_older_frame_of_what_is_not_clear_counts_no_second_time() -> None:
    before, relative, reports = beside(team(3, 1), 0.0)
    once = settled(before, reports, relative)
    twice = settled(before, reports, relative, replace(relative, age=0.3, mark=1))
    assert (once.joint.covariance == twice.joint.covariance).all()
    assert len(twice.tally.unnamed) == 2


def test_what_is_far_from_everybody_is_nobody_known() -> None:
    before, relative, reports = beside(team(3, 1), 2.5)
    after = settled(before, reports, relative)
    (unnamed,) = after.tally.unnamed
    assert unnamed.is_strange
    assert unnamed.taken is None
    assert after.subjects() == ["robot/r0", "robot/r1", "robot/r2"]


def test_an_observer_that_names_one_robot_did_not_see_it_once_more_in_the_same_frame() -> None:
    robots = team(3, 2)
    joint, reports = began(robots), reports_of(robots, 3)
    first = next(relative for relative in reports[0].relatives if relative.subject == "robot/r1")
    again = replace(first, subject="robot/?", mark=0)
    joint.settle(
        3, 1.0, [replace(reports[0], relatives=(first, again)), *(replace(r, relatives=()) for r in reports[1:])]
    )
    (unnamed,) = joint.tally.unnamed
    assert "robot/r1" not in (unnamed.odds or {})


def test_a_named_object_is_found_again_by_sightings_of_its_class() -> None:
    robots = team(2, 3)
    joint, reports = began(robots), reports_of(robots, 3)
    ball = measured("position", "robot/r0", "object/ball1", (4.0, -2.0), (0.04, 0.0, 0.04))
    joint.settle(3, 1.0, [replace(reports[0], relatives=(ball,)), replace(reports[1], relatives=())])
    reports = reports_of(robots, 4)
    relatives = tuple(replace(ball, subject=name, mark=mark) for mark, name in enumerate(("object/ball?", "person/?")))
    joint.settle(4, 1.0, [replace(reports[0], relatives=relatives), replace(reports[1], relatives=())])
    balls, people = joint.tally.unnamed
    assert set(balls.odds or {}) <= {"object/ball1"}
    assert people.odds == {}


def test_by_sightings_without_names_nobody_is_judged() -> None:
    """A wrong name would be held against an honest observer, or a right one be to the credit of a liar."""
    joint, robots = TeamJoint(naming=Naming(400.0)), team(4, 4)
    for tick in range(10):
        joint.settle(tick, 1.0, [nameless(report) for report in reports_of(robots, tick)])
    assert any(unnamed.taken for unnamed in joint.tally.unnamed)
    assert joint.trust.by_subject() == {}
    named = TeamJoint()
    named.settle(0, 1.0, reports_of(team(4, 4), 0))
    assert set(named.trust.by_subject()) == {robot.name for robot in robots}


def test_the_order_of_arrival_changes_nothing() -> None:
    robots = team(4, 5)
    in_order = began(robots)
    shuffled = in_order.copy()
    for tick in range(3, 9):
        reports = [nameless(report) for report in reports_of(robots, tick)]
        in_order.settle(tick, 1.0, reports)
        turned = [replace(report, relatives=report.relatives[::-1]) for report in reports[::-1]]
        shuffled.settle(tick, 1.0, turned)
        assert in_order.tally.unnamed == shuffled.tally.unnamed
    assert (in_order.joint.mean == shuffled.joint.mean).all()
    assert (in_order.joint.covariance == shuffled.joint.covariance).all()


def test_a_stranger_after_hours_without_one_is_a_stranger() -> None:
    sure = Rate()
    for _ in range(80_000):
        sure = sure.plus(0.0)
    naming = Naming(400.0, {("robot/r1", "robot/?"): sure})
    seen = Relative("robot/r1", "robot/?", 4.0, 0.0, 0.04, 0.01, mark=0)
    (odds,) = naming.weigh([seen], {(0, "robot/r2"): 0.0}, {"robot/r2": 1.0})
    assert odds.is_new
    (odds,) = naming.weigh([seen], {(0, "robot/r2"): 1e3}, {"robot/r2": 1.0})
    assert odds.subjects["robot/r2"] > 0.999
