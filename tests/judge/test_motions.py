"""Headings and velocities that were agreed on, against the truth: exact numbers."""

import math

import numpy as np
import pytest

from blackboard.judge.instant import Instant
from blackboard.judge.motions import Motions
from blackboard.opinion.gaussian.joint import Moments
from blackboard.wire.gaussians import pack_state, pack_velocity
from blackboard.wire.messages import Truth
from tests.judge.instants import TEAMS, at
from tests.wire import envelopes as messages


def heard(truth: Truth, said: dict[str, dict[str, object]]) -> Motions:
    instant, judge = Instant(truth, {name: list(robots) for name, robots in TEAMS.items()}), Motions()
    for subject, fields in said.items():
        where = {"board": "a", "sub_team": "a", "level": "agreed"}
        message = messages.consensus(at(2, 2), subject, tick=1, **where).model_copy(update=fields)
        instant.hear_message("a", message, b"")
        judge.judge_subject(instant, "a", subject)
    return judge


def test_a_heading_is_judged_around_the_circle_and_by_what_it_claims() -> None:
    truth = Truth(run="x", tick=1, time=0.2, positions={}, headings={"robot/r1": math.pi - 0.1, "robot/r2": 1.0})
    block = np.zeros(12)
    block[2] = -math.pi + 0.2  # 0.3 rad away
    state = pack_state(Moments(block, np.eye(12) * 0.04))  # 1.5 sigmas: outside of the 50 %, inside of the 90 %
    headings = heard(truth, {"robot/r1": {"state": state}, "robot/r2": {}}).summary()["headings"]["robots"]
    assert (headings["n"], headings["rmse"]) == (1, pytest.approx(0.3))
    assert headings["coverage"] == {"50": 0.0, "90": 1.0, "95": 1.0}
    assert headings["log_score"] == pytest.approx(-0.5 * 1.5**2 - math.log(0.2 * math.sqrt(2 * math.pi)))
    assert list(headings["by_name"]) == ["r1"]


def test_velocities_are_judged_of_robots_and_objects_where_the_truth_is_known() -> None:
    truth = Truth(
        run="x", tick=1, time=0.2, positions={}, velocities={"robot/r1": (1.0, 0.0), "object/ball": (0.0, 2.0)}
    )
    fields = {
        "robot/r1": {"velocity": pack_velocity(Moments(np.array([1.0, 0.0, 0.1]), np.eye(3)))},
        "object/ball": {"velocity": pack_velocity(Moments(np.array([3.0, 2.0]), np.eye(2)))},
        "object/can": {"velocity": pack_velocity(Moments(np.array([3.0, 2.0]), np.eye(2)))},
    }
    velocities = heard(truth, fields).summary()["velocities"]
    assert (velocities["robots"]["rmse"], velocities["objects"]["rmse"]) == (0.0, pytest.approx(3.0))
    assert (velocities["robots"]["coverage"]["50"], velocities["objects"]["coverage"]["95"]) == (1.0, 0.0)
    assert list(velocities["objects"]["by_name"]) == ["ball"]


def test_where_nothing_was_judged_there_is_nothing() -> None:
    assert Motions().summary() == {}
