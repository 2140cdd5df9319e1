"""What a detector tells of what is seen: who is unnamed, what is lost, what is not there, and whom a body hides."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.config import Scenario
from blackboard.config.world import DetectorSection, WorldVisionSection, check_world
from blackboard.errors import UserError
from blackboard.opinion.classes import could_be, is_class
from blackboard.wire.codec import decode, encode
from blackboard.wire.messages import Readings, Sighting, Truth
from sim_world.detector import Detected, is_between
from sim_world.sensors import FAR, NEAR
from sim_world.sources import open_sensor_source
from tests.mistakes import one_line
from tests.sim_world.datasets import write

CROWD: dict[str, Any] = {
    "team": {"sub_teams": {"a": ["r1", "r2", "r3"]}},
    "grid": {"shape": [30, 30]},
    "time": {"tick": 0.2, "seconds": 60.0},
    "world": {"seed": 3, "objects": {"ball1": {"drift": 0.3}, "ball2": {}}, "people": {"count": 3}},
}
Tick = tuple[Truth, list[Readings]]


def crowd(ticks: int = 150, people: int = 3, **detector: object) -> list[Tick]:
    world = {**CROWD["world"], "people": {"count": people}, "detector": detector}
    source = open_sensor_source(Scenario({**CROWD, "world": world}))
    return [source.advance("run", tick) for tick in range(ticks)]


def sightings(ticks: Sequence[Tick]) -> list[Sighting]:
    return [sighting for _, readings in ticks for reading in readings for sighting in reading.sightings]


@dataclass
class Still:
    """A source whose robot r1 sees in each tick the same."""

    positions: dict[str, tuple[float, float]]
    seen: list[Sighting] = field(default_factory=list)
    robots: tuple[str, ...] = ("r1",)

    def admit(self, robot: str) -> bool:
        return robot == "r1"

    def judged(self, tick: int) -> bool:
        return True

    def advance(self, run: str, tick: int) -> Tick:
        truth = Truth(run=run, tick=tick, time=float(tick), positions=self.positions)
        return truth, [Readings(run=run, robot="r1", tick=tick, time=float(tick), sightings=self.seen)]


def detected(source: Still, ticks: int = 1, **settings: object) -> list[Tick]:
    detector = DetectorSection.model_validate(settings)
    detector_source = Detected(
        source, detector, WorldVisionSection(), lambda name: np.random.default_rng([1, *name.encode()])
    )
    return [detector_source.advance("run", tick) for tick in range(ticks)]


def sighting(subject: str, distance: float = 5.0, bearing: float = 0.0) -> Sighting:
    return Sighting(subject=subject, range=distance, bearing=bearing)


def test_people_are_never_named_and_the_truth_says_who_they_are() -> None:
    met = set()
    for truth, readings in crowd():
        assert len([s for s in truth.positions if s.startswith("person/")]) == 3
        for reading in readings:
            classes = [s for s in reading.subjects if is_class(s)]
            who = truth.unnamed.get(reading.robot, [])
            assert len(classes) == len(who)
            assert all(could_be(a, b) for a, b in zip(classes, who, strict=True))
            assert not any(s.startswith("person/") and not is_class(s) for s in reading.subjects)
            met |= set(who)
    assert met == {"person/p1", "person/p2", "person/p3"}


def test_each_unnamed_sighting_is_near_to_whom_the_truth_says() -> None:
    """The order of the two lists is the same, also of those whom another one is nearer."""
    off = []
    for truth, readings in crowd(anonymous=["robot", "person", "object"]):
        for reading in readings:
            x, y = truth.positions[f"robot/{reading.robot}"]
            heading = truth.headings[f"robot/{reading.robot}"]
            unnamed = [s for s in reading.sightings if is_class(s.subject)]
            for anonymous, who in zip(unnamed, truth.unnamed.get(reading.robot, []), strict=True):
                angle = heading + anonymous.bearing
                place = x + anonymous.range * math.cos(angle), y + anonymous.range * math.sin(angle)
                off.append(math.dist(place, truth.positions[who]))
    assert np.quantile(off, 0.95) < 5.0, "cells; two bodies are 12 apart in the mean"


def test_what_is_unnamed_comes_in_no_order_that_tells_who_it_is() -> None:
    ticks = crowd(anonymous=["robot", "person", "object"])
    orders = [who for truth, _ in ticks for who in truth.unnamed.values() if len(set(who)) > 1]
    assert any(who != sorted(who) for who in orders)
    for reading in (reading for _, readings in ticks for reading in readings):
        bearings = [s.bearing for s in reading.sightings]
        assert bearings == sorted(bearings)


def test_an_object_keeps_what_is_no_number_in_its_name() -> None:
    assert {s.subject for s in sightings(crowd(people=0, anonymous=["object"]))} == {
        *("object/ball?", "robot/r1", "robot/r2", "robot/r3")
    }


def test_with_names_and_nobody_else_nothing_is_changed() -> None:
    plain = detected(Still({}, [sighting("robot/r2"), sighting("object/ball", 3.0)]))
    assert plain[0][1][0].subjects == ["robot/r2", "object/ball"]
    assert plain[0][0].unnamed == {}


def test_the_share_that_is_missed_is_the_one_asked() -> None:
    ticks = detected(Still({}, [sighting("robot/r2"), sighting("person/p1")]), 4000, missed=0.1)
    for subject in ("robot/r2", "person/?"):
        share = sum(s.subject == subject for s in sightings(ticks)) / 4000
        assert abs(share - 0.9) < 0.02, "four standard deviations"


def test_landmarks_are_not_missed() -> None:
    landmark = Sighting(subject="landmark/6", range=1.0, bearing=0.0, landmark=(1.0, 2.0))
    assert len(sightings(detected(Still({}, [landmark]), 100, missed=0.9))) == 100


def test_clutter_is_uniform_in_the_field_and_of_nobody() -> None:
    ticks = detected(Still({"person/p1": (1.0, 1.0)}), 4000, clutter=0.5)
    clutter = sightings(ticks)
    assert abs(len(clutter) / 4000 - 0.5) < 0.05
    assert {s.subject for s in clutter} == {"person/?"}
    assert {who for truth, _ in ticks for shown in truth.unnamed.values() for who in shown} == {""}
    ranges, bearings = np.array([s.range for s in clutter]), np.array([s.bearing for s in clutter])
    assert (ranges.min(), ranges.max()) >= (NEAR, FAR - 1)
    middle = math.sqrt((NEAR**2 + FAR**2) / 2)  # of the area
    assert abs(np.mean(ranges < middle) - 0.5) < 0.05
    assert abs(np.mean(bearings)) < 0.1
    assert abs(np.mean(np.abs(bearings) < math.pi / 4) - 0.5) < 0.05


def test_two_mates_have_each_others_names() -> None:
    source = Still({}, [sighting("robot/r2", 2.0), sighting("robot/r3", 3.0), sighting("object/ball", 4.0)])
    ticks = detected(source, 1000, exchanged=0.2)
    wrong = [own.sightings for _, (own,) in ticks if own.sightings[0].subject == "robot/r3"]
    assert abs(len(wrong) / 1000 - 0.2) < 0.05
    assert {tuple((s.subject, s.range) for s in frame) for frame in wrong} == {
        (("robot/r3", 2.0), ("robot/r2", 3.0), ("object/ball", 4.0))
    }


def test_a_body_hides_what_is_behind_it_and_nothing_else() -> None:
    places = {"robot/r1": (0.0, 0.0), "person/p1": (3.0, 0.2), "robot/r2": (6.0, 0.0), "object/ball": (0.0, 6.0)}
    source = Still(places, [sighting(s) for s in ("person/p1", "robot/r2", "object/ball")])
    assert {s.subject for s in sightings(detected(source, body=0.4))} == {"person/?", "object/ball"}
    assert len(sightings(detected(source, body=0.1))) == 3, "too thin"


@pytest.mark.parametrize(
    ("middle", "hidden"), [((5.0, 0.4), True), ((5.0, 0.6), False), ((-1.0, 0.0), False), ((11.0, 0.0), False)]
)
def test_only_what_stands_on_the_way_is_between(middle: tuple[float, float], hidden: bool) -> None:
    assert is_between((0.0, 0.0), (10.0, 0.0), middle, 0.5) == hidden


def test_the_same_seed_is_the_same_crowd_and_one_more_robot_changes_no_detection() -> None:
    settings: dict[str, object] = {"missed": 0.2, "clutter": 0.5, "body": 0.3}
    assert crowd(40, **settings) == crowd(40, **settings)
    visible = [sighting("robot/r2"), sighting("person/p1")]
    alone = detected(Still({}, visible), 50, missed=0.3, clutter=0.3)
    more = detected(Still({}, [*visible, sighting("robot/r3")]), 50, missed=0.3, clutter=0.3)
    for (_, (first,)), (_, (second,)) in zip(alone, more, strict=True):
        assert first.sightings == [s for s in second.sightings if s.subject != "robot/r3"]


def test_the_truth_of_a_crowd_is_read_back_as_it_was_sent() -> None:
    truth, _ = crowd(2, clutter=3.0)[1]
    assert truth.unnamed
    assert decode(Truth, encode(truth)) == truth


def test_people_walk_about_at_their_speed_and_turn_nobody_aside() -> None:
    world = {**CROWD["world"], "people": {"count": 2, "speed": 2.0}}
    alone = [truth for truth, _ in crowd(60, people=0)]
    source = open_sensor_source(Scenario({**CROWD, "world": world}))
    with_people = [source.advance("run", tick)[0] for tick in range(60)]
    for truth, with_others in zip(alone, with_people, strict=True):
        assert truth.positions.items() <= with_others.positions.items()
    ways = [a.positions["person/p1"] for a in with_people]
    assert math.dist(ways[0], ways[1]) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("world", "error"),
    [
        ({"detector": {"clutter": 1.0, "anonymous": []}}, "world.detector.clutter: what is nothing has no name"),
        ({"detector": {"missed": 1.0}}, "world.detector.missed"),
        ({"detector": {"anonymous": ["wall"]}}, "world.detector.anonymous"),
    ],
)
def test_a_mistake_is_one_line(world: dict[str, object], error: str) -> None:
    with one_line(error):
        check_world(Scenario({"world": world}))


def test_of_a_recording_the_barcodes_of_mates_are_stripped_or_all(tmp_path: Path) -> None:
    write(tmp_path)
    world = {"kind": "mrclam", "dir": str(tmp_path), "start": 1000.5, "detector": {"anonymous": ["robot"]}}
    tables = {"team": {"sub_teams": {"a": ["r1", "r2"]}}, "time": {"tick": 0.5, "seconds": 4.0}, "world": world}
    source = open_sensor_source(Scenario(tables))
    source.advance("run", 0)
    truth, (readings, _) = source.advance("run", 1)
    assert readings.subjects == ["landmark/6", "robot/?"]
    assert truth.unnamed == {"r1": ["robot/r2"]}
    tables["world"] = {**world, "detector": {"anonymous": ["robot", "landmark"]}}
    source = open_sensor_source(Scenario(tables))
    source.advance("run", 0)
    truth, (readings, _) = source.advance("run", 1)
    assert (readings.subjects, readings.landmarks) == (["landmark/?", "robot/?"], [None, None])
    assert truth.unnamed == {"r1": ["landmark/6", "robot/r2"]}


def test_a_recording_has_clutter_and_bodies_of_its_own(tmp_path: Path) -> None:
    for key in ("clutter", "body"):
        scenario = Scenario({"world": {"kind": "mrclam", "dir": str(tmp_path), "detector": {key: 1.0}}})
        with pytest.raises(UserError, match=f"world.detector.{key}: a recording has its own"):
            check_world(scenario)
