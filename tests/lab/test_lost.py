"""Teams one robot of which is led astray: what `blackboard lab --lost` counts, and how it shows it."""

import pytest

from blackboard.config import load
from blackboard.faults import LieFault, faults_of
from blackboard.judge.forecasts import Forecasts
from blackboard.lab.lost import LEADS, jobs, judge, report, text


def test_each_lead_is_run_on_each_seed_and_its_lengths_fit_the_grid() -> None:
    team = load("demo")
    planned = jobs([team], 2)
    assert len(planned) == 2 * len(LEADS)
    assert len({repr(scenario.tables) for _, scenario in planned}) == len(planned)
    for lead, scenario in planned:
        assert [fault.names for fault in faults_of(scenario)] == [("r1",)] * len(LEADS[lead])
    small = team.changed("grid", cell=0.1)
    (lie,) = (fault for lead, scenario in jobs([small], 1) if lead == "it lies" for fault in faults_of(scenario))
    assert isinstance(lie, LieFault)
    assert lie.offset == pytest.approx((0.6, 0.4))


def test_every_robot_is_judged_in_every_tick_but_the_first() -> None:
    lead, scenario = jobs([load("demo").changed("time", seconds=2.0)], 1)[0]
    summary = judge(lead, scenario).summary()
    assert summary["n"] == 6 * 10
    assert 0 < summary["told"] < 0.3


def test_the_table_has_a_line_for_each_lead_and_the_calibration() -> None:
    calm, lying = Forecasts(), Forecasts()
    calm.add(0.01, False)
    lying.add(0.9, True)
    table = report(["nothing", "it lies"], [calm, lying])
    assert table["all"]["auroc"] == 1.0
    lines = text(table).splitlines()
    assert [line.split("  ")[0] for line in lines[1:4]] == ["nothing", "it lies", "all"]
    assert lines[-1].split() == ["0.8", "1", "1", "0.900", "1.000"]
