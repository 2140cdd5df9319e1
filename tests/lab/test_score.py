"""The door of the bench: which runs it makes, what it keeps, and its mistakes in one line; no process is started here."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from blackboard.config import Scenario
from blackboard.config.protocols import PROTOCOLS
from blackboard.errors import UserError
from blackboard.judge.samples import read_series, series_file
from blackboard.lab import bench, score
from blackboard.run.flags import OutputFlags, RecordingFlags
from tests.lab.runs import CARD, ideal_run, run

RECORDING = RecordingFlags("folder", 5.0, "C_blind12")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Scenario]:
    """The scenarios that teams ran, instead of processes that run them; there is no recording for the ideal either."""
    scenarios: list[Scenario] = []

    def fake(
        scenario: Scenario, show: Callable[[int, int], None] | None = None, *, series: Path
    ) -> tuple[int, dict[str, Any]]:
        scenarios.append(scenario)
        fusion = scenario.board.fusion
        with series_file(series) as record:
            assert record is not None
            for sample in run("x", fusion, 1.0 if fusion == "opinions" else 0.1).samples:
                record(sample)
        return 0, dict(CARD)

    monkeypatch.setattr(score, "run_scenario", fake)
    monkeypatch.setattr(score, "ideal_samples", lambda scenario: iter(ideal_run("x", 0.05).samples))
    return scenarios


def test_all_is_every_protocol_with_both_fusions_and_the_ideal() -> None:
    todo = score.scenarios(RecordingFlags("folder", 5.0, "all"), 60.0)
    assert [(protocol, fusion) for protocol, fusion, _ in todo] == [(p, f) for p in PROTOCOLS for f in bench.RUNS]
    for protocol, fusion, scenario in todo:
        world = scenario.tables["world"]
        assert (world["protocol"], world["dir"], world["start"]) == (protocol, "folder", 5.0)
        assert (scenario.time.seconds, scenario.time.mode) == (60.0, "lockstep")
        assert fusion in (scenario.board.fusion, "ideal")


def test_without_a_protocol_it_is_the_scenarios() -> None:
    assert [name for name, _, _ in score.scenarios(RecordingFlags("folder"), None)] == ["A_all"] * 3


def test_no_such_protocol_is_one_line_before_anything_starts(started: list[Scenario]) -> None:
    with pytest.raises(UserError, match=r"world.protocol: .*no protocol of this name"):
        score.score(recording=RecordingFlags("folder", None, "Z"))
    assert started == []


def test_runs_are_kept_and_judged_again(
    started: list[Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, kept = OutputFlags(as_json=True), tmp_path / "runs"
    assert score.score(recording=RECORDING, seconds=2.0, runs=kept, output=output) == 0
    first = capsys.readouterr().out
    assert [scenario.board.fusion for scenario in started] == ["opinions", "joint"]
    team = json.loads(first)["protocols"]["C_blind12"]["scores"]["team"]
    assert [(team[way]["n"], team[way]["max"]) for way in ("joint", "ideal")] == [
        (4, pytest.approx(0.3)),
        (4, pytest.approx(0.15)),
    ]
    assert score.score(runs=kept, output=output) == 0
    assert capsys.readouterr().out == first
    assert len(started) == 2


def test_a_run_that_was_stopped_is_a_failure(started: list[Scenario], capsys: pytest.CaptureFixture[str]) -> None:
    assert score.score(recording=RECORDING, seconds=9.0) == 1  # the scorecards say 2 ticks
    assert "2 ticks" in capsys.readouterr().out


def test_the_summary_is_written_as_its_ending_says(started: list[Scenario], tmp_path: Path) -> None:
    for name in ("t.md", "t.csv"):
        score.score(recording=RECORDING, seconds=2.0, summary=tmp_path / name)
    assert (tmp_path / "t.md").read_text().startswith("| protocol | who | way |")
    with (tmp_path / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[1]["rmse"]) == pytest.approx(5**0.5)
    assert rows[1]["localised_s"] == ""


def test_the_table_has_a_row_for_each_sample_of_each_run(started: list[Scenario], tmp_path: Path) -> None:
    score.score(recording=RECORDING, seconds=2.0, runs=tmp_path, table=tmp_path / "t.csv")
    with (tmp_path / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    names = ("protocol", "way", "tick", "subject", "level", "robot")
    assert len({tuple(row[name] for name in names) for row in rows}) == len(rows)
    kept = {fusion: read_series(tmp_path / f"C_blind12-{fusion}.csv") for fusion in bench.RUNS}
    assert len(rows) == sum(len(samples) for samples in kept.values())
    assert {row["way"] for row in rows if row["level"] == "solo"} == {"solo", "solo (joint)"}
    for way in bench.RUNS:
        scores = [float(row["log_score"]) for row in rows if row["way"] == way]
        assert scores == [sample.log_score for sample in kept[way] if sample.level != "solo"]
    score.score(runs=tmp_path, table=tmp_path / "t.jsonl")
    again = [json.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()]
    assert [float(row["error"]) for row in again if row["error"] is not None] == [
        float(row["error"]) for row in rows if row["error"] != "nan"
    ]


def test_pictures_of_each_protocol(started: list[Scenario], tmp_path: Path) -> None:
    score.score(recording=RECORDING, seconds=2.0, pictures=tmp_path / "p")
    names = sorted(file.name for file in (tmp_path / "p").iterdir())
    assert names == [f"C_blind12-{what}.png" for what in ("areas", "errors", "trajectories")]


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ({}, "--mrclam: which recording"),
        ({"recording": RECORDING, "summary": Path("t.txt")}, r"--summary t.txt: .*\.md or \.csv"),
        ({"recording": RECORDING, "table": Path("t.txt")}, r"--table t.txt: .*\.csv, \.jsonl, \.parquet"),
        ({"recording": RECORDING, "table": Path("t.md")}, r"--table t.md: .*what is shown is --summary"),
        ({"runs": Path("/no/such/folder")}, "no runs are kept there"),
        ({"recording": RECORDING, "runs": Path("/dev/null/x")}, "cannot be made"),
    ],
)
def test_a_mistake_is_one_line(arguments: dict[str, Any], fault: str, started: list[Scenario]) -> None:
    with pytest.raises(UserError, match=fault):
        score.score(**arguments)


def test_a_broken_run_is_named(started: list[Scenario], tmp_path: Path) -> None:
    score.score(recording=RECORDING, seconds=2.0, runs=tmp_path)
    (tmp_path / "C_blind12-joint.json").write_text("{}")
    with pytest.raises(UserError, match=r"C_blind12-joint.json: not what a run left"):
        score.score(runs=tmp_path)


def test_a_run_that_was_interrupted_is_not_judged(
    started: list[Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score.score(recording=RECORDING, seconds=2.0, runs=tmp_path)
    (tmp_path / "C_blind12-joint.json").unlink()
    capsys.readouterr()
    score.score(runs=tmp_path, output=OutputFlags(as_json=True))
    assert list(json.loads(capsys.readouterr().out)["protocols"]["C_blind12"]["runs"]) == ["opinions"]


def test_a_folder_of_before_the_ideal_is_judged_without_it(
    started: list[Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    score.score(recording=RECORDING, seconds=2.0, runs=tmp_path)
    for ending in ("csv", "json"):
        (tmp_path / f"C_blind12-ideal.{ending}").unlink()
    capsys.readouterr()
    assert score.score(runs=tmp_path, output=OutputFlags(as_json=True)) == 0
    team = json.loads(capsys.readouterr().out)["protocols"]["C_blind12"]["scores"]["team"]
    assert list(team) == ["solo", "opinions", "solo (joint)", "joint"]


def test_runs_of_different_starts_are_not_judged_together(started: list[Scenario], tmp_path: Path) -> None:
    for start, protocol in ((5.0, "A_all"), (6.0, "B_turns")):
        score.score(recording=RecordingFlags("folder", start, protocol), seconds=2.0, runs=tmp_path)
    with pytest.raises(UserError, match="several recordings or starts"):
        score.score(runs=tmp_path)


def test_a_family_is_a_run_for_each_object() -> None:
    todo = score.scenarios(RecordingFlags("x", None, "O2_mate"), 10.0)
    assert [(protocol, fusion) for protocol, fusion, _ in todo] == [
        (f"O2_mate{n}", fusion) for n in range(1, 6) for fusion in bench.RUNS
    ]
