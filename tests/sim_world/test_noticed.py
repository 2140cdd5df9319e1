"""How robots start, what a world logs, and which sightings of a recording are dropped, against exact expectations."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pytest

from blackboard.wire import keys
from blackboard.wire.codec import encode
from blackboard.wire.envelope import Envelope, Kind
from blackboard.wire.messages import Status
from sim_world.mrclam.files import read_recording
from tests.sim_world.datasets import write
from tests.sim_world.desk import Desk
from tests.sim_world.test_world import world


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_starts_on_its_way_to_its_waypoint(seed: int) -> None:
    for body in world(seed=seed).bodies.values():
        there = math.dist(body.place, body.waypoint)
        x, y = body.x + there * math.cos(body.heading), body.y + there * math.sin(body.heading)
        assert (x, y) == pytest.approx(body.waypoint)


@pytest.mark.parametrize(
    ("seconds", "logged"), [(2.0, [0, 1, 2, 3, 4]), (12.0, [0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24])]
)
def test_about_ten_ticks_of_a_run_are_logged(
    caplog: pytest.LogCaptureFixture, seconds: float, logged: list[int]
) -> None:
    caplog.set_level(logging.INFO, "sim_world.service")
    desk = Desk(time={"seconds": seconds})
    desk.wait(0.1)
    desk.tokens(Kind.ALIVE)
    desk.wait(1.0)
    assert desk.world.why == ""
    found = [r.message for r in caplog.records if r.message.startswith("tick ")]
    assert found == [f"tick {tick} of {round(seconds / 0.5)}" for tick in logged]


def test_an_unknown_barcode_is_dropped_whoever_saw_it(tmp_path: Path) -> None:
    write(tmp_path)
    for robot in (1, 2):
        with (tmp_path / f"Robot{robot}_Measurement.dat").open("a") as text:
            text.write("1003.0 98 1.0 0.0\n")
    it = read_recording(tmp_path)
    assert it.dropped == 4
    assert [len(it.tracks[robot].sightings) for robot in (1, 2)] == [3, 3]
    assert it.tracks[2].sightings[:, 1].tolist() == [1, 6, 6]


@pytest.mark.parametrize(("kind", "ticks"), [("robot", [0]), ("board", [0, 1])])
def test_only_a_board_ends_a_tick_by_its_statuses(kind: str, ticks: list[int]) -> None:
    desk = Desk()
    desk.silent = {"a"}
    desk.tokens(Kind.ALIVE)
    desk.wait(0.1)
    assert desk.ticks == [0]
    for level in ("consensus", "agreed"):
        subjects = ["robot/r1", "robot/r2"]
        desk.tell(*(desk.consensus("a", level, subject, 0) for subject in subjects))
        said = Status(process="a", kind=kind, tick=0, time=0, phase=level, subjects=subjects)  # type: ignore[arg-type]
        desk.tell(Envelope(keys.STATUS.key(team="demo", sub_team="a", process="a"), encode(said)))
    desk.wait(0.1)
    assert desk.ticks == ticks
    assert not desk.world.refused
