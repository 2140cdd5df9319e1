"""[[fault]] of a scenario: what may stand there, what is wrong with it in one line, and whom it concerns when."""

import re
from typing import Any

import pytest

from blackboard.config import Scenario, load
from blackboard.faults import KINDS, faults_of, faulty_robots, is_of_sensors, without_faults
from tests.mistakes import one_line

LIE = {"kind": "lie", "robot": "r2", "offset": [8, 0]}


def new_scenario(*faults: dict[str, Any]) -> Scenario:
    return Scenario({"fault": list(faults)}, "team.toml")


def test_a_scenario_without_faults_has_none() -> None:
    assert faults_of(Scenario({})) == []
    assert faulty_robots(Scenario({})) == frozenset()


def test_a_fault_lasts_from_its_start_until_its_end() -> None:
    (fault,) = faults_of(new_scenario({**LIE, "start": 5, "end": 9}))
    assert [time for time in (0.0, 4.9, 5.0, 8.9, 9.0) if fault.concerns("r2", time)] == [5.0, 8.9]
    assert not fault.concerns("r1", 6.0)


def test_without_faults_nothing_is_wrong_and_the_same_robots_are_scored_apart() -> None:
    calm = without_faults(new_scenario(LIE))
    assert not any(fault.concerns("r2", 1.0) for fault in faults_of(calm))
    assert faulty_robots(calm) == {"r2"}
    assert without_faults(Scenario({})).tables == {}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"kind": "lies"},
            "team.toml: fault.0.kind: no fault of this kind; did you mean lie?; use one of lie, collude, overconfident, skew, lose",
        ),
        ({"robot": "r1"}, "team.toml: fault.0.kind: no fault of this kind"),
        ({"kind": "lie", "robot": "r1"}, "team.toml: fault.0.lie.offset: is missing; give a list of 2, each"),
        ({**LIE, "robot": "r9"}, "team.toml: fault.0.lie: no robot of the team has the name r9; use one of r1, r2, r3"),
        ({**LIE, "robots": ["r1"]}, "team.toml: fault.0.lie: give either robot or robots"),
        (
            {**LIE, "start": 5, "end": 5},
            "team.toml: fault.0.lie: it ends at 5 s, before its start at 5 s; give a later end",
        ),
        ({**LIE, "offest": 5}, "team.toml: fault.0.lie.offest: no such key; did you mean offset?; known are"),
        ({"kind": "collude", "robot": "r1", "offset": [1, 1]}, "team.toml: fault.0.collude: give at least two robots"),
        (
            {"kind": "overconfident", "robot": "r1", "factor": 0.5},
            "team.toml: fault.0.overconfident.factor: give a number above 1 and at most 100 (got 0.5)",
        ),
        (
            {"kind": "drift", "robot": "r1", "sensor": "gps", "rate": 1},
            'team.toml: fault.0.drift.sensor: give "odometry", "compass", "range" or "fix" (got \'gps\')',
        ),
    ],
)
def test_a_mistake_is_one_line_that_says_where(table: dict[str, Any], message: str) -> None:
    with one_line(f"^{re.escape(message)}"):
        faults_of(new_scenario(table))


def test_every_kind_is_known_by_its_name() -> None:
    parameters: dict[str, dict[str, Any]] = {
        "lie": {"offset": [1, 2]},
        "collude": {"offset": [1, 2]},
        "overconfident": {"factor": 2},
        "skew": {"seconds": -3},
        "lose": {"share": 0.2},
        "drift": {"rate": 0.1},
        "freeze": {"what": "process"},
    }
    assert tuple(parameters) == KINDS
    faults = faults_of(new_scenario(*({"kind": kind, "robots": ["r1", "r3"], **parameters[kind]} for kind in KINDS)))
    assert [fault.kind for fault in faults if is_of_sensors(fault)] == ["drift"]
    assert {fault.names for fault in faults} == {("r1", "r3")}


def test_the_liar_of_five_comes_with_the_package() -> None:
    shipped = load("liar")
    assert len(shipped.team.robots) == 5
    assert faulty_robots(shipped) == {"r3"}
    demo = load("demo").tables
    assert {name: shipped.tables[name] for name in ("grid", "time", "board", "robot")} == {
        name: demo[name] for name in ("grid", "time", "board", "robot")
    }
