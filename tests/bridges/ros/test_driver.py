"""Odometry as readings: every way is told once, however often it comes and however it turns."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="no rosbags: pip install '.[ros]'")
from blackboard.bridges.ros.convert import ANY_HEADING, Detection, PlanarPose
from blackboard.bridges.ros.driver import FASTEST, GAP, PERIOD, Driver
from blackboard.errors import Refused
from blackboard.opinion.gaussian.vehicle import kinds
from blackboard.wire.messages import Readings
from tests.present import present


def at(stamp: float, x: float, y: float, yaw: float = 0.0, covariance: np.ndarray | None = None) -> PlanarPose:
    return PlanarPose(stamp, "odom", x, y, yaw, np.eye(3) if covariance is None else covariance)


def test_the_first_pose_is_where_it_begins_and_no_motion() -> None:
    driver = Driver("r1")
    assert driver.readings(100.0) is None
    driver.move(at(5.0, 30.0, 40.0), 100.0)
    assert driver.readings(100.0) is None
    assert driver.due() is None


def test_odometry_is_summed_up_and_told_once_per_period() -> None:
    driver = Driver("r1")
    for n in range(5):
        driver.move(at(5.0 + n / 10, n * 0.3, 0.0), 99.6 + n / 10)
    assert driver.due() == -math.inf
    first = present(driver.readings(100.0))
    assert first.odometry is not None
    assert (first.robot, first.run, first.tick, first.time) == ("r1", "ros since 100", 0, 100.0)
    assert [first.odometry.distance, first.odometry.turn, first.odometry.dt] == pytest.approx([1.2, 0.0, 0.4])
    driver.move(at(5.5, 1.5, 0.0), 100.1)
    assert driver.readings(100.0 + PERIOD / 2) is None
    assert driver.due() == 100.0 + PERIOD
    second = present(driver.readings(100.0 + PERIOD))
    assert (second.run, second.tick) == (first.run, 1)
    assert present(second.odometry).distance == pytest.approx(0.3)


@given(st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4)), min_size=1, max_size=40), st.floats(-3, 3))
def test_the_way_comes_out_whichever_way_the_robot_looked_at_the_start(
    steps: list[tuple[float, float]], yaw: float
) -> None:
    """Arcs of a forward distance and a turn, by the chord of each; before, a turn and then a straight way were taken for a curve."""
    driver, x, y = Driver("r1"), 2.0, -1.0
    driver.move(at(0.0, x, y, yaw), 0.0)
    halfway = yaw + sum(turn for _, turn in steps) / 2
    for n, (distance, turn) in enumerate(steps):
        x, y = x + distance * math.cos(yaw + turn / 2), y + distance * math.sin(yaw + turn / 2)
        yaw = math.remainder(yaw + turn, math.tau)
        driver.move(at((n + 1) / 10, x, y, yaw), 0.0)
    readings = present(driver.readings(0.0))
    moved, c, s = present(readings.odometry), math.cos(halfway), math.sin(halfway)
    assert moved.turn == pytest.approx(sum(turn for _, turn in steps), abs=1e-9)
    assert 2.0 + moved.distance * c - moved.aside * s == pytest.approx(x, abs=1e-9)
    assert -1.0 + moved.distance * s + moved.aside * c == pytest.approx(y, abs=1e-9)
    assert len(steps) == 1 or moved.driven == pytest.approx(
        sum(turn * float(kinds(distance, turn)[1]) for distance, turn in steps), abs=1e-9
    )


@pytest.mark.parametrize("subject", ["object/ball", "robot/r2"])
@pytest.mark.parametrize("bad", [np.diag([1.0, 0.0, 0.1]), np.ones((3, 3)), np.diag([1.0, -1.0, 0.1])])
def test_a_sighting_without_a_covariance_is_refused_and_not_told(subject: str, bad: np.ndarray) -> None:
    driver = Driver("r1")
    with pytest.raises(Refused, match="must be positive definite"):
        driver.see(subject, at(0.0, 3.0, 4.0, covariance=bad), 100.0)
    assert driver.readings(100.0) is None
    assert driver.due() is None


def test_a_sighting_waits_for_the_next_readings_and_says_its_age() -> None:
    driver = Driver("r1")
    driver.see("robot/r2", at(0.0, 3.0, 4.0, 0.5, np.diag([0.1, 0.2, ANY_HEADING])), 100.0)
    assert driver.due() is not None
    driver.move(at(0.1, 1.0, 1.0), 100.1)
    readings = present(driver.readings(100.1))
    (sighting,) = readings.seen
    assert (sighting.kind, sighting.values) == ("position", (3.0, 4.0))  # nothing is known of the heading
    assert sighting.age == pytest.approx(0.1)
    assert driver.readings(101.0) is None


def test_what_comes_twice_or_late_is_refused_and_moves_nobody() -> None:
    driver = Driver("r1")
    driver.move(at(5.0, 0.0, 0.0), 0.0)
    driver.move(at(5.1, 1.0, 0.0), 0.0)
    for stamp in (5.1, 5.0):
        with pytest.raises(Refused, match="^past:"):
            driver.move(at(stamp, 0.5, 0.0), 0.0)
    driver.move(at(5.2, 2.0, 0.0), 0.0)
    assert odometer(driver.readings(0.0)) == pytest.approx((2.0, 0.0))


@pytest.mark.parametrize(
    "again", [at(5.1 + GAP + 1, 9.0, 0.0), at(5.0 - GAP - 1, 9.0, 0.0), at(5.2, 1.0 + 1.1 * 0.1 * FASTEST, 0.0)]
)
def test_after_a_gap_or_where_its_stamps_or_places_begin_anew_no_motion_is_made_up(again: PlanarPose) -> None:
    driver = Driver("r1")
    driver.move(at(5.0, 0.0, 0.0), 0.0)
    driver.move(at(5.1, 1.0, 0.0), 0.0)
    driver.move(again, 0.0)
    driver.move(at(again.stamp + 0.1, again.x + 0.5, 0.0), 0.0)
    assert odometer(driver.readings(0.0)) == pytest.approx((1.5, 0.0))


def test_a_fix_goes_with_the_next_readings_once_as_wide_as_its_widest_axis() -> None:
    driver, covariance = Driver("r1"), np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.09]])
    driver.fix(at(1.0, 3.0, 4.0, 0.5, covariance))
    readings = present(driver.readings(10.0))
    assert readings.odometry is None
    assert readings.fix is not None
    assert readings.fix.position == (3.0, 4.0)
    assert [readings.fix.sigma, readings.fix.heading, readings.fix.heading_sigma] == pytest.approx([2.0, 0.5, 0.3])
    assert driver.readings(20.0) is None
    covariance[2, 2] = ANY_HEADING
    driver.fix(at(1.0, 3.0, 4.0, 0.5, covariance))
    again = present(driver.readings(20.0))
    assert present(again.fix).heading is None


@pytest.mark.parametrize("clock", [50.0, 1.8e9], ids=["of a simulation", "unix"])
def test_readings_are_of_the_time_at_which_they_were_measured_however_late_they_come(clock: float) -> None:
    """Odometry 5 ms after it was measured, but for a stall; a camera that needs 150 ms; another without stamps."""
    driver, zero = Driver("r1"), 1.8e9
    for n in range(20):
        driver.move(at(clock + n / 10, n * 0.1, 0.0), zero + n / 10 + 0.005)
    assert driver.readings(zero + 1.905) is not None
    late = zero + 2.6  # what was measured at 2.0 to 2.2 comes at once
    driver.see("object/ball", at(clock + 2.05, 3.0, 4.0), late)
    driver.see("object/can", at(0.0, 3.0, 4.0), late)  # a stamp that nobody set
    for n in (20, 21, 22):
        driver.move(at(clock + n / 10, n * 0.1, 0.0), late)
    readings = present(driver.readings(late))
    assert present(readings.odometry).dt == pytest.approx(0.3)
    by_subject = {sighting.subject: sighting.age for sighting in readings.seen}
    assert by_subject["object/can"] == 0.0
    assert readings.time == pytest.approx(zero + 2.205, abs=1e-6)
    assert by_subject["object/ball"] == pytest.approx(0.15)


def odometer(readings: Readings | None) -> tuple[float, float]:
    assert readings is not None
    assert readings.odometry is not None
    return readings.odometry.distance, readings.odometry.turn


def test_what_a_detector_saw_goes_once_by_its_covariance_or_by_the_model_of_the_camera() -> None:
    driver = Driver("r1")
    driver.detect([Detection("person/?", at(5.0, 1.0, 1.0, 0.0), 0.6)], 100.0)
    unsure = Detection("object/ball?", at(5.1, 3.0, 4.0, 0.0, np.zeros((3, 3))), 0.9)
    driver.detect([Detection("person/?", at(5.1, 1.0, 2.0), 0.7), unsure], 100.1)  # the newest message counts
    readings = present(driver.readings(100.1))
    (placed,), (sighting,) = readings.seen, readings.sightings
    assert (placed.subject, placed.kind, placed.values, placed.confidence) == ("person/?", "position", (1.0, 2.0), 0.7)
    assert placed.covariance == (1.0, 0.0, 1.0)
    assert (sighting.subject, sighting.range, sighting.confidence) == ("object/ball?", 5.0, 0.9)
    assert sighting.bearing == pytest.approx(math.atan2(4.0, 3.0))
    assert (sighting.range_sigma, sighting.bearing_sigma) == (None, None)
    assert driver.readings(101.0) is None


def test_detections_that_readings_cannot_hold_are_refused_and_the_others_stay() -> None:
    driver = Driver("r1")
    detection = Detection("person/?", at(5.0, 1.0, 1.0), 0.6)
    driver.detect([detection], 100.0)
    flat = Detection("person/?", at(5.0, 1.0, 1.0, 0.0, np.diag([1.0, 0.0, 0.0])), 0.6)
    itself = Detection("robot/r1", at(5.0, 1.0, 1.0), 0.6)
    for things in ([detection] * 129, [flat], [detection, itself]):
        with pytest.raises(Refused):
            driver.detect(things, 100.1)
    readings = present(driver.readings(100.1))
    assert len(readings.seen) == 1
