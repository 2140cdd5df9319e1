"""What only ranges or bearings are known of: a place once they close, both of two mirror images until then."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.limits import Limits
from blackboard.opinion.gaussian.relation import Kind, measured
from blackboard.opinion.gaussian.rings import SURE, Line, Ring
from blackboard.opinion.gaussian.sightings import MAX_RINGS
from blackboard.opinion.gaussian.state import Objects
from blackboard.opinion.gaussian.team import TeamJoint
from blackboard.opinion.gaussian.vehicle import STATES, Motion, Nuisance
from blackboard.opinion.grid import Array
from tests.present import present

THERE = np.array([2.0, 3.0])


def line(place: Array, there: Array, kind: Kind, off: float = 0.0, variance: float = 1e-4, time: float = 0.0) -> Line:
    away = there - place
    value = float(np.hypot(*away)) if kind == "range" else math.atan2(away[1], away[0])
    return Line(place, value + off, variance, 1e-6, kind == "range", time)


@pytest.mark.parametrize("kind", ["range", "bearing"])
@given(seed=st.integers(0, 10_000))
def test_it_is_where_the_sightings_of_observers_around_it_meet(kind: Kind, seed: int) -> None:
    chance, ring = np.random.default_rng(seed), Ring()
    for angle in (0.0, 2.0, 4.0, 5.0):
        place = THERE + 3.0 * np.array([math.cos(angle), math.sin(angle)]) + chance.normal(size=2) * 0.3
        ring.add(line(place, THERE, kind, chance.normal() * 0.01))
    (crossing,) = ring.places()
    off = crossing.moments.mean - THERE
    assert off @ np.linalg.solve(crossing.moments.covariance, off) < 23.0  # 99.999 %
    assert math.sqrt(np.trace(crossing.moments.covariance)) < 0.1


@given(seed=st.integers(0, 10_000))
def test_observers_on_one_line_leave_two_mirror_images_of_one_weight(seed: int) -> None:
    chance, ring = np.random.default_rng(seed), Ring()
    for x in (0.0, 1.5, 4.0, 5.0):
        ring.add(line(np.array([x, 0.0]), THERE, "range", chance.normal() * 0.01))
    places = ring.places()
    assert [place.weight for place in places] == pytest.approx([0.5, 0.5], abs=0.01)
    assert sorted(float(place.moments.mean[1]) for place in places) == pytest.approx([-3.0, 3.0], abs=0.1)
    ring.add(line(np.array([2.0, 1.0]), THERE, "range"))
    assert ring.places()[0].weight > SURE
    assert ring.places()[0].moments.mean == pytest.approx(THERE, abs=0.1)


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_from_one_place_it_is_nowhere(kind: Kind) -> None:
    ring = Ring()
    for _ in range(10):
        ring.add(line(np.zeros(2), THERE, kind))
        assert ring.places() == ()


@pytest.mark.parametrize("kind", ["range", "bearing"])
@pytest.mark.parametrize("hertz", [1.0, 5.0, 20.0, 50.0])
def test_a_robot_that_drives_past_finds_it_however_often_it_looks(hertz: float, kind: Kind) -> None:
    """Of many sightings the newest alone were kept, of so short a way that they never met."""
    chance, ring = np.random.default_rng(3), Ring()
    for look in range(int(14 * hertz)):
        place = np.array([0.5 * look / hertz - 2.0, 0.0])
        ring.add(line(place, THERE, kind, 0.05 * chance.normal(), 0.05**2, look / hertz))
    likeliest = ring.places()[0]
    assert likeliest.weight == pytest.approx(1.0 if kind == "bearing" else 0.5, abs=0.01)
    off = np.abs(likeliest.moments.mean) - THERE  # a straight way leaves a mirror image of ranges
    assert off @ np.linalg.solve(likeliest.moments.covariance, off) < 18.4  # 99.99 %


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_what_it_has_walked_since_two_sightings_is_partly_the_same(kind: Kind) -> None:
    """Thirty sightings of the last ten seconds do not average how far it went in them; once they did, and it was taken for known."""
    squared, missing = [], 0
    for seed in range(60):
        chance, ring, there = np.random.default_rng(seed), Ring(walk=0.3), THERE.copy()
        for look in range(30):
            place = THERE + 4.0 * np.array([math.cos(2.1 * look), math.sin(2.1 * look)])
            ring.add(line(place, there, kind, 0.05 * chance.normal(), 0.05**2, look / 3))
            there = there + 0.3 * chance.normal(size=2) / math.sqrt(3)
        places = ring.places()
        missing += not places
        for found in places[:1]:
            off = found.moments.mean - there
            squared.append(off @ np.linalg.solve(found.moments.covariance + np.eye(2) * 0.03, off))
    assert missing < 6
    assert np.mean(np.array(squared) < 5.991) > 0.85


def test_who_passed_by_it_long_ago_is_no_reason_not_to_know_it() -> None:
    chance, ring = np.random.default_rng(1), Ring(walk=0.3)
    ring.add(line(THERE + [0.05, 0.0], THERE, "bearing", time=0.0))
    for look in range(12):
        place = THERE + 4.0 * np.array([math.cos(2.1 * look), math.sin(2.1 * look)])
        ring.add(line(place, THERE, "bearing", 0.02 * chance.normal(), 0.02**2, 10.0 + look / 6))
    assert ring.places()[0].moments.mean == pytest.approx(THERE, abs=0.4)


@given(seed=st.integers(0, 10_000))
def test_numbers_of_any_size_are_a_place_or_none(seed: int) -> None:
    chance, ring = np.random.default_rng(seed), Ring()
    for _ in range(6):
        size = 10.0 ** chance.uniform(-12, 12, 5)
        ring.add(Line(size[:2], size[2], size[3], size[4], bool(chance.integers(2)), 0.0))
        assert all(np.isfinite(place.moments.covariance).all() for place in ring.places())


def test_what_is_known_of_the_observers_is_the_least_error_of_the_place() -> None:
    ring = Ring()
    for angle in np.arange(20) * 0.3:
        constraint = line(THERE + 3.0 * np.array([math.cos(angle), math.sin(angle)]), THERE, "range")
        ring.add(Line(constraint.place, constraint.value, constraint.variance, 0.04, True, 0.0))
    (place,) = ring.places()
    assert np.linalg.eigvalsh(place.moments.covariance)[0] >= 0.04


@given(seed=st.integers(0, 10_000), claimed=st.floats(1e-12, 1e-3))
def test_no_sighting_places_it_better_than_the_sharpest_sensor_could(seed: int, claimed: float) -> None:
    chance, ring, robots = np.random.default_rng(seed), Ring(sharpest=0.2), 4
    for angle in np.arange(robots) * 2 * math.pi / robots:
        kind: Kind = "range" if chance.integers(2) else "bearing"
        place = THERE + 3.0 * np.array([math.cos(angle), math.sin(angle)])
        ring.add(line(place, THERE, kind, variance=claimed))
    for there in ring.places():
        assert np.linalg.det(np.linalg.inv(there.moments.covariance)) <= (robots / 2 / 0.2**2) ** 2 * 1.01


def standing(
    robot: str, place: Array, tick: int, kind: Kind, chance: np.random.Generator, there: Array = THERE
) -> Evidence:
    away = there - place
    value = float(np.hypot(*away)) if kind == "range" else math.atan2(away[1], away[0])
    mean = np.zeros(STATES)
    mean[:5] = [*place, 0.0, 1.0, 1.0]
    belief = Moments(mean, np.diag([1e-4] * STATES))
    relative = measured(kind, robot, "object/ball", [value + chance.normal() * 0.02], [4e-4])
    return Evidence(robot, 0, tick, Motion(), Nuisance(), belief, relatives=(relative,))


@pytest.mark.parametrize("kind", ["range", "bearing"])
@pytest.mark.parametrize("sharpest", [0.0, 0.1])
def test_an_object_that_is_measured_by_ranges_or_bearings_alone_enters_once_they_close(
    sharpest: float, kind: Kind
) -> None:
    """With a bound of what sensors can know, bearings of what nobody had placed counted with a sigma of a radian."""
    chance, team = np.random.default_rng(2), TeamJoint(Objects(drift=0.05), limits=Limits(sharpest))
    robots = {"robot/r0": np.array([0.0, 0.0]), "robot/r1": np.array([4.0, 0.0]), "robot/r2": np.array([1.0, 5.0])}
    for tick in range(3):
        team.settle(tick, 0.2, [standing("robot/r0", robots["robot/r0"], tick, kind, chance)])
        assert not team.knows("object/ball")
        assert team.doubtful() == {}
    for tick in range(3, 12):
        team.settle(tick, 0.2, [standing(robot, place, tick, kind, chance) for robot, place in robots.items()])
    assert team.knows("object/ball")
    marginal = team.marginal("object/ball")
    assert marginal.mean == pytest.approx(THERE, abs=0.15)
    assert math.sqrt(np.trace(marginal.covariance)) < 0.2


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_an_object_that_rolls_is_followed_by_ranges_or_bearings_alone(kind: Kind) -> None:
    """They told nothing of how it moves: it was two units off, in a region that held the truth in a tenth of the ticks."""
    chance, team, squared = np.random.default_rng(2), TeamJoint(Objects(drift=0.1)), []
    robots = {"robot/r0": np.array([0.0, 0.0]), "robot/r1": np.array([10.0, 0.0]), "robot/r2": np.array([4.0, 9.0])}
    for tick in range(120):
        there = THERE + 0.5 * np.array([1.0, 0.3]) * 0.2 * max(0, tick - 30)
        team.settle(tick, 0.2, [standing(robot, place, tick, kind, chance, there) for robot, place in robots.items()])
        if tick >= 60:
            velocity, now = team.velocity("object/ball"), team.marginal("object/ball")
            assert present(velocity).mean == pytest.approx([0.5, 0.15], abs=0.2)
            squared.append((now.mean - there) @ np.linalg.solve(now.covariance, now.mean - there))
    assert np.mean(np.array(squared) < 5.991) >= 0.85


@pytest.mark.parametrize("kind", ["range", "bearing"])
def test_an_object_that_may_be_anywhere_by_now_is_found_again_by_ranges_or_bearings_alone(kind: Kind) -> None:
    """A range or bearing of it was ignored until the object was forgotten, after `Objects.kept` seconds."""
    chance, team, lost = np.random.default_rng(5), TeamJoint(Objects(drift=6.0)), []
    robots = {"robot/r0": np.array([0.0, 0.0]), "robot/r1": np.array([10.0, 0.0]), "robot/r2": np.array([4.0, 9.0])}
    for tick in range(21):
        there = THERE + 3.0 * (tick == 20)
        told = [standing(robot, place, tick, kind, chance, there) for robot, place in robots.items()]
        team.settle(tick, 1.0, told if tick in (0, 20) else [replace(evidence, relatives=()) for evidence in told])
        lost.append(team.anywhere() == ["object/ball"])
    assert (lost[0], lost[19], lost[20]) == (False, True, False)
    assert team.marginal("object/ball").mean == pytest.approx(THERE + 3.0, abs=0.5)


def test_who_invents_things_leaves_room_for_those_that_others_measure_by_bearings() -> None:
    chance, team = np.random.default_rng(2), TeamJoint(Objects(drift=0.05))
    robots = {"robot/r0": np.array([0.0, 0.0]), "robot/r1": np.array([4.0, 0.0]), "robot/r2": np.array([1.0, 5.0])}
    for tick in range(20):
        liar = standing("robot/r9", np.array([9.0, 9.0]), tick, "bearing", chance)
        invented = tuple(replace(liar.relatives[0], subject=f"object/x{number}") for number in range(40))
        honest = [standing(robot, place, tick, "bearing", chance) for robot, place in robots.items()]
        team.settle(tick, 0.2, [replace(liar, relatives=invented), *(honest if tick >= 3 else [])])
        assert len(team.rings) <= MAX_RINGS
    assert team.marginal("object/ball").mean == pytest.approx(THERE, abs=0.15)


def test_an_object_in_one_of_two_places_is_in_doubt_and_no_part_of_the_joint() -> None:
    chance, team = np.random.default_rng(2), TeamJoint(Objects(drift=0.05))
    for tick in range(6):
        places = {"robot/r0": np.array([0.0, 0.0]), "robot/r1": np.array([4.0, 0.0])}
        team.settle(tick, 0.2, [standing(robot, place, tick, "range", chance) for robot, place in places.items()])
    assert "object/ball" not in team.joint
    assert len(team.doubtful()["object/ball"]) == 2
    again = team.copy()
    again.settle(6, 100.0, [])
    assert again.doubtful() == {}
    assert len(team.doubtful()["object/ball"]) == 2
