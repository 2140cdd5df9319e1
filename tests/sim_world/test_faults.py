"""Sensors that creep or freeze, in the readings that the world sends."""

from typing import Any

import pytest

from blackboard.config import Scenario
from blackboard.opinion.gaussian.vehicle import wrap
from blackboard.wire.messages import Readings
from sim_world.faults import Faulted
from sim_world.sources import open_sensor_source

TABLES: dict[str, Any] = {
    "team": {"sub_teams": {"a": ["r1", "r2"]}},
    "time": {"tick": 0.5, "seconds": 10.0},
    "world": {"seed": 4, "objects": {"ball": {}}},
}


def readings(*faults: dict[str, Any], ticks: int = 21) -> dict[str, list[Readings]]:
    source = open_sensor_source(Scenario({**TABLES, "fault": list(faults)}))
    by_robot: dict[str, list[Readings]] = {"r1": [], "r2": []}
    for tick in range(ticks):
        for reading in source.advance("run", tick)[1]:
            by_robot[reading.robot].append(reading)
    return by_robot


def test_without_faults_of_sensors_the_source_is_the_world_itself() -> None:
    lie = {"kind": "lie", "robot": "r1", "offset": [1, 1]}
    assert not isinstance(open_sensor_source(Scenario({**TABLES, "fault": [lie]})), Faulted)


def test_a_fault_changes_nothing_about_other_robots_nor_before_its_start_and_after_its_end() -> None:
    calm, ill = readings(), readings({"kind": "drift", "robot": "r1", "rate": 0.1, "start": 2, "end": 6})
    assert ill["r2"] == calm["r2"]
    changed = [wrong.time for wrong, right in zip(ill["r1"], calm["r1"], strict=True) if wrong != right]
    assert changed == [2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5]  # at 2.0 s the error is 0


def test_odometry_creeps_by_a_share_of_the_distance_for_each_second() -> None:
    calm, ill = readings()["r1"], readings({"kind": "drift", "robot": "r1", "rate": 0.1, "start": 1})["r1"]
    at = 16  # 8 s
    right, wrong = calm[at].odometry, ill[at].odometry
    assert right is not None
    assert wrong is not None
    assert wrong.distance == pytest.approx(right.distance * 1.7)
    assert wrong.turn == right.turn


@pytest.mark.parametrize("sensor", ["compass", "range", "fix"])
def test_each_other_sensor_creeps_by_itself(sensor: str) -> None:
    ill = readings({"kind": "drift", "robot": "r1", "sensor": sensor, "rate": 0.2}, ticks=101)["r1"]
    calm, away = readings(ticks=101)["r1"], []
    for wrong, right in zip(ill, calm, strict=True):
        if sensor == "compass" and wrong.compass is not None and right.compass is not None:
            away.append(wrap(wrong.compass - right.compass - 0.2 * wrong.time))
        elif sensor == "fix" and wrong.fix is not None and right.fix is not None:
            away.append((wrong.fix.position[0] - right.fix.position[0]) - 0.2 * wrong.time)
        elif sensor == "range":
            away += [
                (a.range - b.range) - 0.2 * wrong.time for a, b in zip(wrong.sightings, right.sightings, strict=True)
            ]
    assert len(away) > 1
    assert away == pytest.approx([0.0] * len(away), abs=1e-9)


def test_frozen_sensors_repeat_what_they_measured_last_and_give_no_fix() -> None:
    calm, ill = readings()["r1"], readings({"kind": "freeze", "robot": "r1", "start": 3, "end": 8})["r1"]
    last = calm[5]
    for frozen in ill[6:16]:
        assert (frozen.odometry, frozen.compass, frozen.sightings, frozen.fix) == (
            last.odometry,
            last.compass,
            last.sightings,
            None,
        )
    assert [frozen.tick for frozen in ill] == list(range(21))
    assert ill[:6] == calm[:6]
    assert ill[16:] == calm[16:]
