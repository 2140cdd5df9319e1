"""The recorded team as processes, scored."""

import json
from pathlib import Path

import pytest

from blackboard.lab.bench import SOLO
from tests.commands import blackboard
from tests.files import DATASET7, needs_dataset7


@needs_dataset7
def test_the_recorded_team_is_scored(tmp_path: Path) -> None:
    """Ten seconds of each fusion, as processes: the numbers of the table are the scorecards' own."""
    arguments = (
        "--start",
        "1248446200",
        "--seconds",
        "10",
        "--protocol",
        "C_blind12",
        "--json",
        "--runs",
        str(tmp_path),
    )
    run = blackboard("score", "--mrclam", str(DATASET7), *arguments)
    assert run.returncode == 0, run.stderr
    scores = json.loads(run.stdout)["protocols"]["C_blind12"]["scores"]
    assert list(scores) == ["team", "r1", "r2", "r3", "r4", "r5"]
    for fusion in ("opinions", "joint"):
        card = json.loads((tmp_path / f"C_blind12-{fusion}.json").read_text())["card"]
        assert card["fusion"] == fusion
        for level, way in (("solo", SOLO[fusion]), ("agreed", fusion)):
            live, taped = card["scores"]["robots"][level], scores["team"][way]
            for name in ("n", "rmse", "mean", "p95", "max", "log_score"):
                assert taped[name] == pytest.approx(live[name])
            assert {k: c["value"] for k, c in taped["coverage"].items()} == pytest.approx(live["coverage"])
