"""The bench: slow versions of its numbers, and the tables by hand."""

import json
import math
from collections.abc import Sequence
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from blackboard.judge.intervals import wilson
from blackboard.judge.samples import Sample
from blackboard.lab import bench
from tests.lab.runs import at, ideal_run, run
from tests.present import present


def test_a_block_is_the_half_minute_that_led_to_it() -> None:
    assert [bench.block_of(time) for time in (1.0, 30.0, 30.5, 60.0, 61.0)] == [0, 0, 1, 1, 2]


def test_a_robot_that_errs_for_half_a_minute_on_end_misses_once() -> None:
    samples = [at(float(t), region=0.99 if t > 570 else 0.5) for t in range(1, 601)]
    coverage = bench.coverage(samples, 95)
    assert astuple(coverage) == pytest.approx(astuple(wilson(0.95, 19)))  # as of 20 blocks, and not of 600 samples


# --- the time to localise --------------------------------------------------------------------------------------------


def slow_localised_at(samples: Sequence[Sample]) -> float | None:
    for i, first in enumerate(samples):
        stretch = [first]
        for sample in samples[i + 1 :]:
            if stretch[-1].time - first.time >= bench.HOLD or sample.time - stretch[-1].time > bench.GAP:
                break
            stretch.append(sample)
        held = stretch[-1].time - first.time >= bench.HOLD
        if held and all(sample.error < bench.FOUND for sample in stretch):
            return first.time
    return None


@given(st.lists(st.tuples(st.sampled_from((1.0, 1.0, 1.0, 2.0, 5.0)), st.integers(0, 12)), max_size=60))
def test_localised_is_the_first_time_from_which_it_holds(steps: list[tuple[float, int]]) -> None:
    samples, time = [], 0.0
    for step, bad in steps:
        time += step
        samples.append(at(time, error=0.2 if bad else 0.5))
    assert bench.localised_at(samples) == slow_localised_at(samples)


def test_localised_by_hand() -> None:
    late = [at(float(t), error=3.0 if t < 7 else 0.4) for t in range(1, 30)]
    assert bench.localised_at(late) == 7.0
    assert bench.localised_at(late[:16]) is None  # until 16 s: for 9 s only
    assert bench.localised_at(late[:17]) == 7.0
    gap = [sample for sample in late if not 10 <= sample.time <= 12]
    assert bench.localised_at(gap) == 13.0


def test_a_team_is_localised_with_its_last_robot() -> None:
    first = [at(float(t)) for t in range(1, 20)]
    last = [at(float(t), error=1.0 if t < 5 else 0.0, robot="r2") for t in range(1, 20)]
    assert bench.measure([*first, *last])["localised_s"] == 5.0
    assert bench.measure([*first, *last[:8]])["localised_s"] is None


# --- a report --------------------------------------------------------------------------------------------------------


def test_numbers_of_robots_and_team_by_hand() -> None:
    report = bench.report([run("A_all", "opinions", 1.0), run("A_all", "joint", 0.1)])
    scores = report["protocols"]["A_all"]["scores"]
    assert list(scores) == ["team", "r1", "r2", "objects"]
    assert list(scores["team"]) == ["solo", "opinions", "solo (joint)", "joint"]
    assert scores["team"]["solo"]["n"] == 4
    team = scores["team"]["opinions"]
    assert team["rmse"] == pytest.approx(math.sqrt(5))
    assert (team["mean"], team["max"]) == (2.0, 3.0)
    assert (team["log_score"], team["area"], team["localised_s"]) == (-1.0, 2.0, None)
    assert team["coverage"]["50"]["value"] == 1.0
    assert team["without_landmark"] == {"n": 3, "rmse": pytest.approx(math.sqrt((1 + 1 + 9) / 3))}
    assert scores["r2"]["joint"]["rmse"] == pytest.approx(0.3)
    assert (report["recording"], report["start"]) == ("folder", 5.0)
    json.dumps(report, allow_nan=False)


def test_the_tables_have_every_robot_and_way() -> None:
    report = bench.report(
        [run("A_all", "opinions", 1.0), run("B_turns", "joint", 0.1, verdict="FAIL", reasons=["too far"])]
    )
    rows = bench.rows(report)
    assert [row[:3] for row in rows[:4]] == [
        ("A_all", "team", "solo"), ("A_all", "team", "opinions"), ("A_all", "r1", "solo"), ("A_all", "r1", "opinions"),
    ]  # fmt: skip
    assert {len(row) for row in rows} == {len(bench.HEADER)}
    assert rows[1][3:8] == ("4", "2.236", "2.000", "3.000", "3.000")
    assert rows[1][-2:] == ("never", "1.915 (75 %)")
    text = bench.text(report)
    assert text.startswith("folder from 5.0 on\n\n")
    assert "A_all  (opinions: PASS, 2 ticks in 3 s)" in text
    assert "  joint: too far" in text
    assert "opinions: x" not in text  # the checks of a PASS
    table = bench.markdown(report).splitlines()
    assert len([line for line in table if line.startswith("|")]) == 2 + len(rows)
    assert all(definition in text for definition in bench.DEFINITIONS)
    records = bench.records(report)
    assert len(records) == len(rows)
    assert (
        records[1]["coverage_95_low"]
        == report["protocols"]["A_all"]["scores"]["team"]["opinions"]["coverage"]["95"]["low"]
    )


def test_the_ideal_is_a_way_and_no_run_of_a_team() -> None:
    runs = [run("O2_mate1", "joint", 1.0), ideal_run("O2_mate1", 0.1), ideal_run("O2_mate2", 0.3)]
    report = bench.report([*runs, bench.together("O2_mate", runs[1:])])
    protocols = report["protocols"]
    assert list(protocols["O2_mate1"]["scores"]["team"]) == ["solo (joint)", "joint", "ideal"]
    assert list(protocols["O2_mate1"]["runs"]) == ["joint"]
    assert (protocols["O2_mate"]["runs"], protocols["O2_mate"]["scores"]["team"]["ideal"]["n"]) == ({}, 8)
    assert runs[1].complete


def test_a_run_that_ended_early_is_not_complete() -> None:
    assert run("A_all", "joint", 1.0).complete
    assert not run("A_all", "joint", 1.0, ticks=1).complete


def test_a_landmark_sighting_of_five_seconds_ago_is_no_access() -> None:
    samples = [at(1.0, 1.0, landmark_age=4.0), at(2.0, 2.0, landmark_age=5.0)]
    assert bench.measure(samples)["without_landmark"] == {"n": 1, "rmse": 2.0}
    assert bench.measure(samples[:1])["without_landmark"] == {"n": 0, "rmse": None}


def test_what_a_sub_team_agreed_on_about_an_object_counts_once() -> None:
    mates = [at(1, 0.5, subject="object/robot3", robot=robot) for robot in ("r1", "r2")]
    alone = [at(1, 2.0, subject="object/robot3", robot=robot, level="solo") for robot in ("r1", "r2")]
    objects = replace(run("O2_mate3", "joint", 0.1), samples=[*mates, *alone])
    scores = bench.report([objects])["protocols"]["O2_mate3"]["scores"]
    assert {way: (s["n"], s["rmse"]) for way, s in scores["objects"].items()} == {
        "solo (joint)": (2, 2.0),
        "joint": (1, 0.5),
    }


def test_the_runs_of_a_family_are_judged_together() -> None:
    runs = [
        replace(run(name, "joint", 0.1, verdict=verdict), samples=[at(1, error, subject=f"object/robot{n}")])
        for n, (name, verdict, error) in enumerate([("O2_mate1", "PASS", 3.0), ("O2_mate2", "FAIL", 4.0)])
    ]
    both = bench.together("O2_mate", runs)
    assert (both.protocol, present(both.card)["verdict"], both.asked_ticks) == (
        "O2_mate",
        "FAIL",
        sum(r.asked_ticks for r in runs),
    )
    scores = bench.report([both])["protocols"]["O2_mate"]["scores"]["objects"]["joint"]
    assert (scores["n"], scores["rmse"]) == (2, pytest.approx(math.sqrt(12.5)))
