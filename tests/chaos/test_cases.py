"""The table's rows, and a scenario prepared for one."""

import json

import pytest

from blackboard.chaos.cases import CASES, chosen, members
from blackboard.chaos.table import REST, WARM_UP, judged, prepared, text
from blackboard.config import load
from blackboard.errors import UserError
from blackboard.faults import faults_of
from blackboard.judge.samples import Sample

DEMO = load("demo")


def test_all_cases_or_those_that_are_named() -> None:
    assert chosen(None, CASES, "case") == list(CASES.values())
    assert [case.name for case in chosen("sites, calm", CASES, "case")] == ["sites", "calm"]
    with pytest.raises(UserError, match="--only storm: no such case; choose from calm, "):
        chosen("storm", CASES, "case")


def test_each_case_troubles_somebody_in_one_way() -> None:
    for case in CASES.values():
        ways = [case.trouble is not None, case.cut, case.signal is not None, case.lose > 0]
        assert sum(ways) == (case.name != "calm"), case.name
        assert bool(members(case.who, DEMO)) == (case.name != "calm"), case.name


def test_who_is_troubled() -> None:
    assert members("robots", DEMO) == ["r1", "r2", "r3", "r4", "r5", "r6"]
    assert members("robot", DEMO) == ["r1"]
    assert members("board", DEMO) == ["board-b"]
    assert members("sub-team", DEMO) == ["r4", "r5", "r6", "board-b"]


def test_a_run_is_in_real_time_and_long_enough() -> None:
    scenario = prepared(DEMO, CASES["cut-robot"], 7)
    assert (scenario.time.mode, scenario.time.seconds) == ("realtime", WARM_UP + 3 + REST)
    assert json.loads(scenario.to_json())["world"]["seed"] == 7


def test_reports_are_lost_by_all_but_one_robot_of_each_sub_team() -> None:
    (fault,) = faults_of(prepared(DEMO, CASES["reports-20"], 1))
    assert fault.names == ("r2", "r3", "r5", "r6")


def sample(level: str, subject: str, mean_x: float, region: float = 0.5) -> Sample:
    return Sample(1, 0.2, "r1", "a", subject, level, 0.0, 0.0, mean_x, 0.0, -1.0, region, 0.0, 1.0, 0.0)


def test_errors_and_regions_of_samples() -> None:
    samples = [
        sample("solo", "robot/r1", 4.0),
        sample("agreed", "robot/r1", 3.0),
        sample("agreed", "robot/r2", 4.0),
        sample("agreed", "object/ball", 1.0, region=0.97),
        sample("consensus", "robot/r1", 99.0),
    ]
    verdict = judged(samples)
    assert (verdict["solo"], verdict["robots"], verdict["objects"]) == (4.0, pytest.approx(12.5**0.5), 1.0)
    assert (verdict["coverage"], verdict["samples"]) == (pytest.approx(2 / 3), 3)
    assert judged([])["robots"] is None


def test_the_table_of_a_case_that_never_recovered() -> None:
    row = {"case": "x", "what": "y", "recovery": None, "settled": 0.5, "missing": 0.25, **judged([])}
    lines = text({"rows": [row], "network": "a proxy"}).splitlines()
    assert lines[2] == "| x | y | never | 50 % | - | - | - | - | 25 % |"
