"""What a sighting adds to a joint: less if one was sent just now, more with time, nothing of an error that lasts."""

import math

import numpy as np
import pytest

from blackboard.opinion.gaussian.evidence import Evidence
from blackboard.opinion.gaussian.joint import Moments
from blackboard.opinion.gaussian.relation import Bias, Relative
from blackboard.opinion.gaussian.vehicle import STATES, Motion, Nuisance
from blackboard.opinion.grid import Grid
from blackboard.wire.evidence import PackedEvidence
from blackboard.wire.gaussians import pack_evidence
from robot_agent.sightings import MOST, Sightings

GRID = Grid((100, 100), 0.1)
PLACE = Moments(np.zeros(STATES), np.diag([0.04, 0.04, 0.01, *(0.0,) * (STATES - 3)]))
ENTROPY = math.log(2 * math.pi * math.e * 0.04 / GRID.cell**2)  # of a place with variances 0.04


def evidence(*subjects: str, bias: float = 0.0, profile: tuple[tuple[float, float], ...] = ()) -> PackedEvidence:
    biases = (Bias(bias, 100.0),) if bias else ()
    relatives = (Relative("robot/r1", s, 2.0, 0.1, 0.01, 0.0001, biases=biases, profile=profile) for s in subjects)
    travelled = Motion(10.0, 0.0, 10.0, 10.0, 0.01, 0.001, 0.01)
    return pack_evidence(Evidence("robot/r1", 0, 0, travelled, Nuisance(), PLACE, None, tuple(relatives)))


def news(sightings: Sightings, packed: PackedEvidence, time: float, mine: Moments | None = PLACE) -> dict[str, float]:
    return sightings.news(packed, time, mine, {"robot/r2": ENTROPY, "robot/r3": ENTROPY}, GRID)


def test_the_first_sighting_adds_what_both_places_leave_open() -> None:
    along, across = 0.08 / 0.01, (0.08 + 0.01 * 4) / (0.0001 * 4)
    gains = news(Sightings(), evidence("robot/r2"), 0.0)
    assert gains["robot/r2"] == pytest.approx(0.5 * (math.log1p(along) + math.log1p(across)))


def test_what_was_just_sent_adds_little_and_the_more_the_longer_ago() -> None:
    sightings, packed = Sightings(), evidence("robot/r2", "robot/r3")
    first = news(sightings, packed, 0.0)
    sightings.said(evidence("robot/r2"))  # the other one was left out
    later = [news(sightings, packed, time) for time in (0.0, 1.0, 5.0, 1e4)]
    gains = [gained["robot/r2"] for gained in later]
    assert gains == sorted(gains)
    assert gains[0] < 0.25 * first["robot/r2"]
    assert gains[-1] == pytest.approx(first["robot/r2"])
    assert all(gained["robot/r3"] == first["robot/r3"] for gained in later)


def test_an_error_that_lasts_is_not_averaged_away() -> None:
    sightings, packed = Sightings(), evidence("robot/r2", bias=0.2)
    for time in np.linspace(0.0, 0.1, 40):
        news(sightings, packed, float(time))
        sightings.said(packed)
    assert sightings.sent["robot/r2"].along >= 0.2**2 - 1e-9


def test_of_whom_no_board_knows_anything_a_sighting_adds_most() -> None:
    sightings = Sightings()
    known = news(sightings, evidence("robot/r2"), 0.0)["robot/r2"]
    assert news(sightings, evidence("robot/r2"), 0.0, None)["robot/r2"] > known
    assert news(sightings, evidence("object/new"), 0.0)["object/new"] > known


def test_a_camera_by_its_profile() -> None:
    sightings = Sightings()
    sharp, dull = (news(sightings, evidence("robot/r2", profile=((1.0, v), (3.0, v))), 0.0) for v in (0.01, 1.0))
    assert sharp["robot/r2"] > dull["robot/r2"] > 0


def test_so_many_subjects_are_remembered() -> None:
    sightings = Sightings()
    for i in range(MOST + 5):
        packed = evidence(f"object/o{i}")
        news(sightings, packed, 0.0)
        sightings.said(packed)
    assert len(sightings.sent) == MOST
    assert f"object/o{MOST + 4}" in sightings.sent
