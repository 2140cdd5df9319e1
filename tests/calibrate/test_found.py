"""What a simulated team's sensors are is found without its truth, within the intervals that are claimed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from blackboard.calibrate import report
from blackboard.calibrate.drives import drives_of
from blackboard.calibrate.found import FoundTeam, calibrated
from blackboard.calibrate.model import Noise
from blackboard.errors import UserError
from tests.calibrate.teams import PLACES, Robot, team

ODD = Robot(way=0.7, arc_way=0.8, spin=1.1, arc_turn=0.6, lag=0.3, range=1.15, bias=0.1, bearing=0.05)
NOISY = Robot(along=0.06, turn=0.06, range_sigma=0.15, bearing_sigma=0.03, misread=0.05)
USUAL = Noise.alike(2, (0.03, 0.004, 0.03), 0.1, 0.04, 0.08, 0.02)


@cache
def found_team() -> FoundTeam:
    return calibrated(drives_of(team([ODD, NOISY], 180.0, 1)), 0.26, {"usual": USUAL})


TRUE = [
    ("way, straight", 0.7, 1.0, 0.03),
    ("way, arc", 0.8, 1.0, 0.04),
    ("turn, spin", 1.1, 1.0, 0.03),
    ("turn, arc", 0.6, 1.0, 0.03),
    ("lag", 0.3, 0.0, 0.04),
    ("range scale", 1 / 1.15, 1.0, 0.02),
    ("range bias", 0.1, 0.0, 0.08),
    ("bearing bias", 0.05, 0.0, 0.01),
    ("moving, along", 0.02, 0.06, 0.02),
    ("moving, turn", 0.02, 0.06, 0.02),
    ("noise, bearing", 0.01, 0.03, 0.003),
]


@pytest.mark.parametrize(("name", "odd", "noisy", "within"), TRUE)
def test_a_number_is_found_for_each_robot(name: str, odd: float, noisy: float, within: float) -> None:
    for robot, true, times in (("r1", odd, 1), ("r2", noisy, 3)):  # the noisy robot three times as far
        number = found_team().robots[robot].numbers[name]
        assert number.value is not None
        assert number.value == pytest.approx(true, abs=times * within)
        assert abs(number.value - true) < 2 * number.within, "twice half of an interval of 95 %"


def test_noise_of_ranges_and_misreads_are_found() -> None:
    for robot, sigma in (("r1", 0.05), ("r2", 0.15)):
        table = found_team().robots[robot].ranges
        squared = sum(count * rms**2 for *_, count, rms in table) / sum(count for *_, count, _ in table)
        assert squared**0.5 == pytest.approx(sigma, rel=0.2)
    assert found_team().robots["r1"].misread < 0.01
    assert found_team().robots["r2"].misread == pytest.approx(0.05, abs=0.03)
    assert found_team().landmarks == []


def test_errors_that_are_fresh_do_not_last() -> None:
    assert all(robot.lasting == {"range": 0.0, "bearing": 0.0} for robot in found_team().robots.values())


def test_what_was_found_predicts_the_half_that_was_not_fitted_better() -> None:
    assert found_team().nats["found"] > found_team().nats["usual"] + 0.1


def test_landmarks_that_carry_each_others_names_are_named_and_do_no_harm() -> None:
    names = [1, 0, *range(2, len(PLACES))]
    swapped = calibrated(drives_of(team([Robot(), Robot()], 120.0, 3, names)), 0.26, {})
    assert {(landmark.landmark, landmark.exchanged) for landmark in swapped.landmarks} == {
        ("landmark/0", "landmark/1"),
        ("landmark/1", "landmark/0"),
    }
    assert swapped.robots["r1"].numbers["range scale"].value == pytest.approx(1.0, abs=0.03)
    assert "carry each other's names" in report.text(report.report(swapped, {}), "m")


def test_a_landmark_that_was_moved_is_named_with_where_it_is() -> None:
    readings = team([Robot(), Robot()], 120.0, 3)
    moved = (PLACES[6][0] + 0.8, PLACES[6][1])
    displaced = [
        reading.model_copy(
            update={
                "sightings": [
                    replace_place(sighting, moved) if sighting.subject == "landmark/6" else sighting
                    for sighting in reading.sightings
                ]
            }
        )
        for reading in readings
    ]
    (landmark,) = calibrated(drives_of(displaced), 0.26, {}).landmarks
    assert (landmark.landmark, landmark.exchanged) == ("landmark/6", "")
    assert landmark.seen == pytest.approx(PLACES[6], abs=0.1)
    assert landmark.off == pytest.approx(0.8, abs=0.1)


def replace_place(sighting: object, place: tuple[float, float]) -> object:
    return sighting.model_copy(update={"landmark": place})  # type: ignore[attr-defined]


def test_what_a_drive_does_not_show_is_left_open() -> None:
    """A robot that never drives a curve says nothing of curves, and one that never stands nothing of standing."""
    readings = team([Robot(), Robot()], 60.0, 4)
    straight = [
        reading.model_copy(update={"odometry": reading.odometry and reading.odometry.model_copy(update={"turn": 0.0})})
        for reading in readings
    ]
    team_found = calibrated(drives_of(straight), 0.26, {})
    assert team_found.robots["r1"].numbers["turn, arc"].value is None
    tables = report.report(team_found, {})["scenario"]["robots"]["r1"]["odometry"]
    assert "curve_turn_scale" not in tables
    assert "distance_scale" in tables


@pytest.mark.parametrize(
    ("seconds", "landmarks", "complaint"),
    [(6.0, True, "too little to calibrate"), (60.0, False, "nothing says where the robots are")],
)
def test_too_little_is_said_in_a_line(seconds: float, landmarks: bool, complaint: str) -> None:
    readings = team([Robot(), Robot()], seconds, 5)
    if not landmarks:
        readings = [
            reading.model_copy(
                update={"sightings": [sighting for sighting in reading.sightings if sighting.landmark is None]}
            )
            for reading in readings
        ]
    with pytest.raises(UserError, match=complaint):
        calibrated(drives_of(readings), 0.26, {})


def test_the_bar_moves_and_never_past_its_end() -> None:
    shown: list[tuple[int, int]] = []
    calibrated(drives_of(team([Robot(), Robot()], 60.0, 6)), 0.26, {}, lambda done, total: shown.append((done, total)))
    assert [done for done, _ in shown] == list(range(1, len(shown) + 1))
    assert all(done <= total for done, total in shown)


def test_halves_are_apart() -> None:
    """What is scored was not fitted: a robot whose camera is spoilt in the second half is predicted worse there."""
    readings = team([Robot(), Robot()], 90.0, 7)
    spoilt = [reading if reading.time < 45 else _shrunk(reading) for reading in readings]
    sound = calibrated(drives_of(readings), 0.26, {}).nats["found"]
    assert calibrated(drives_of(spoilt), 0.26, {}).nats["found"] < sound - 0.2


def _shrunk(reading: object) -> object:
    sightings = [sighting.model_copy(update={"range": 0.8 * sighting.range}) for sighting in reading.sightings]  # type: ignore[attr-defined]
    return reading.model_copy(update={"sightings": sightings})  # type: ignore[attr-defined]


def test_a_part_keeps_what_was_measured_in_it() -> None:
    drives = drives_of(team([Robot(), Robot()], 20.0, 8))
    first, second = drives.split()
    assert len(first.times) + len(second.times) == len(drives.times)
    counts = [len(part.sightings.tick) for part in (first, second, drives)]
    assert counts[0] + counts[1] in (counts[2], counts[2] - int((drives.sightings.tick == len(first.times)).sum()))
    assert np.array_equal(replace(second, robots=()).times, drives.times[len(first.times) :])
