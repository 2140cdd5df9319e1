"""Recorded teams: as processes, scored, and what the pages say of them."""

import json
from pathlib import Path

import pytest

from blackboard.judge.samples import read_series, rms_error
from blackboard.lab.bench import SOLO
from blackboard.lab.ideal import ideal_samples
from blackboard.run.flags import RecordingFlags
from tests.commands import blackboard
from tests.files import DATASET7, needs_dataset7
from tests.lab.scored import scored
from tests.robot_agent.spoilt import Spoil, recorded
from tests.snippets import block


@needs_dataset7
def test_the_recorded_team_is_scored(tmp_path: Path) -> None:
    """Ten seconds of each fusion, as processes: the numbers of the table are the scorecards' own."""
    arguments = "--start 1248446200 --seconds 10 --protocol C_blind12 --json"
    run = blackboard("score", "--mrclam", str(DATASET7), *arguments.split(), "--runs", str(tmp_path))
    assert run.returncode == 0, run.stderr
    scores = json.loads(run.stdout)["protocols"]["C_blind12"]["scores"]
    assert list(scores) == ["team", "r1", "r2", "r3", "r4", "r5"]
    assert {scores["team"][way]["n"] for way in scores["team"]} == {50}
    assert len(read_series(tmp_path / "C_blind12-ideal.csv")) == 50
    for fusion in ("opinions", "joint"):
        card = json.loads((tmp_path / f"C_blind12-{fusion}.json").read_text())["card"]
        assert card["fusion"] == fusion
        for level, way in (("solo", SOLO[fusion]), ("agreed", fusion)):
            live, taped = card["scores"]["robots"][level], scores["team"][way]
            for name in ("n", "rmse", "mean", "p95", "max", "log_score"):
                assert taped[name] == pytest.approx(live[name])
            assert {k: c["value"] for k, c in taped["coverage"].items()} == pytest.approx(live["coverage"])


@needs_dataset7
@pytest.mark.parametrize("protocol", ["A_all", "E_south", "F_nolm", "H_lost12"])
def test_the_joint_and_the_ideal_that_the_page_shows_are_those_of_today(protocol: str) -> None:
    """Robots' filters and joint without processes, which agree with processes to 1 mm: the page is made anew where this is off."""
    recording = RecordingFlags(mrclam=str(DATASET7), start=1248446200, protocol=protocol)
    scenario = recording.scenario().changed("time", seconds=600.0)
    today = recorded(scenario, Spoil(), after=0.0)
    assert today.rmse == pytest.approx(float(scored()[protocol, "joint"]["rmse"]), rel=0.05)
    assert rms_error(ideal_samples(scenario)) == pytest.approx(float(scored()[protocol, "ideal"]["rmse"]), rel=0.01)


@pytest.mark.skipif(
    not DATASET7.with_name("dataset9").is_dir(), reason="needs the MRCLAM recording in ../shared/mrclam/dataset9"
)
def test_what_calibrate_finds_is_what_its_page_shows() -> None:
    (command,) = block("calibrate.md", "blackboard calibrate").commands
    words = command.replace("DIR", str(DATASET7.with_name("dataset9"))).partition(" --plot ")[0].split()[1:]
    run = blackboard(*words, timeout=300)
    assert run.returncode == 0, run.stderr
    shown = block("calibrate.md", " " * 22 + "r1 ").text
    assert {line.rstrip() for line in shown.splitlines()} <= {line.rstrip() for line in run.stdout.splitlines()}
