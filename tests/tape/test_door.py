"""`blackboard replay` and `blackboard tape` as a person meets them, on the golden tape.

The golden tape is a run of three robots and two boards, 3 s of team time, as this command records it (the hash is the one that it prints):

    blackboard demo --robots 3 --seconds 3 --record tests/tape/golden.mcap

A change of what boards compute shows here first: then record it again, and put the new hash below. Another processor may round the
last bit of a belief in another way, so here the scores are compared; tests that record a tape themselves compare the bits.
"""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from blackboard.errors import UserError
from blackboard.judge.samples import GROUPS, read_series
from blackboard.tape.__main__ import Changes
from blackboard.tape.content import Tape
from blackboard.tape.file import TapeAbout, read
from tests.commands import call
from tests.files import GOLDEN
from tests.tape.teams import SMALL

HASH = "98b7145456ef14aa48fe1efb01311ea7a1cc244ac544ac2b95eff6a51b043ce6"


def as_json(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert call(*arguments, "--json") == 0
    printed: dict[str, Any] = json.loads(capsys.readouterr().out)
    return printed


def rmse(card: dict[str, Any]) -> dict[tuple[str, str], float]:
    """The RMSE of each group at each level."""
    groups = card["scores"].items()
    return {(group, level): by[level]["rmse"] for group, by in groups for level in ("solo", "consensus", "agreed")}


def test_the_golden_tape_is_small_and_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    assert GOLDEN.stat().st_size <= 200_000
    status = call("replay", GOLDEN, "--json")
    card = json.loads(capsys.readouterr().out)
    assert status == (0 if card["hash"] == HASH else 1)  # 1 on a processor that rounds in another way
    compared = as_json(capsys, "replay", GOLDEN, "--loss", "0.1")
    assert compared["recorded"]["hash"] == HASH
    assert rmse(card) == pytest.approx(rmse(compared["recorded"]), abs=1e-4)
    assert (card["ticks"], card["mode"], card["fusion"], card["verdict"]) == (15, "lockstep", "joint", "PASS")


def test_what_if_shows_what_was_recorded_beside_it(capsys: pytest.CaptureFixture[str]) -> None:
    changes = "--set board.gamma=0.3 --without r3 --rule cooperative --loss 0.1"
    report = as_json(capsys, "replay", GOLDEN, *changes.split())
    assert report["changes"] == {"without": ["r3"], "rule": "cooperative", "set": ["board.gamma=0.3"], "loss": 0.1}
    assert report["recorded"]["hash"] == HASH
    assert rmse(report["unchanged"]) == pytest.approx(rmse(report["recorded"]), abs=1e-4)
    assert report["what_if"]["hash"] != HASH
    assert "r3" not in report["recorded"]["scores"]["robots"]["by_name"]
    assert "do not hear the changed boards" in report["note"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--without", "r9"], "--without r9: no such robot; on the tape are r1, r2, r3"),
        (["--loss", "2"], "--loss 2: give a share"),
        (["--lie", "r9=2"], "--lie r9=2: no such robot"),
        (["--set", "board.gait=1"], "board.gait"),
        (["--set", "world.seed=1"], "only boards are run again"),
        (["--only", "world"], "are for --speed"),
        (["-e", "tcp/127.0.0.1:1"], "are for --speed"),
        (["--speed", "0"], "--speed 0"),
        (["--rule", "loudest"], "loudest"),
    ],
)
def test_a_mistake_is_one_line(arguments: list[str], says: str) -> None:
    with pytest.raises(UserError, match=says):
        call("replay", GOLDEN, *arguments)


def test_settings_of_boards_and_of_nobody_else() -> None:
    tape = Tape(SMALL, [], TapeAbout())
    board = Changes(set=["board.gate=8", "board.feedback=off", "board.max_age = 3"]).apply(tape).board
    assert (board.feedback, board.max_age, board.in_force()["gate"]) == ("off", 3.0, 8)
    for wrong, says in {
        "robot.speed=1": "only boards are run again",
        "board.gate=1,2": "only boards are run again",
        "gate=1": "no key of a section",
        "board.gate": "say KEY=VALUE",
        "board.gait=1": r"board\.gait",
    }.items():
        with pytest.raises(UserError, match=says):
            Changes(set=[wrong]).apply(tape)


def test_a_lie_is_a_change_with_intervals(capsys: pytest.CaptureFixture[str]) -> None:
    report = as_json(capsys, "replay", GOLDEN, "--lie", "r2=6")
    assert report["changes"] == {"lie": ["r2=6"]}
    assert report["paired"]["robots"]["consensus"]["error"]["value"] > 0
    assert report["what_if"]["hash"] != report["unchanged"]["hash"]


@pytest.mark.parametrize("change", [(), ("--without", "r3")])
def test_a_replay_says_how_far_it_is_on_standard_error(
    capsys: pytest.CaptureFixture[str], change: tuple[str, ...]
) -> None:
    call("replay", GOLDEN, "--json", *change)
    printed = capsys.readouterr()
    assert json.loads(printed.out)
    lines = [line.split() for line in printed.err.splitlines() if line.startswith("replay: ")]
    assert len(lines) == 11  # the first, and each tenth
    assert [line[1] for line in lines] == sorted((line[1] for line in lines), key=int)
    assert lines[-1][1] == lines[-1][3]


def test_help_says_what_a_replay_is(capsys: pytest.CaptureFixture[str]) -> None:
    call("replay", "--help")
    said = " ".join(capsys.readouterr().out.split())
    assert "its consensuses are the recorded ones to the bit" in said


def test_info_recover_and_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert as_json(capsys, "tape", "info", GOLDEN)["runs"]
    broken, saved, part = (tmp_path / name for name in ("broken.mcap", "saved.mcap", "part.mcap"))
    broken.write_bytes(GOLDEN.read_bytes()[:-60_000])
    assert call("tape", "recover", broken, saved) == 0
    assert call("tape", "recover", broken) == 0
    assert broken.with_name(f"{broken.stem}-whole.mcap").read_bytes() == saved.read_bytes()
    assert call("tape", "cut", GOLDEN, part, "--key", "cop/*/world/**") == 0
    assert call("tape", "info", saved) == 0
    whole = list(read(GOLDEN))
    rescued = list(read(saved))
    assert rescued == whole[: len(rescued)]
    assert len(rescued) > len(whole) / 4
    assert list(read(part)) == [each for each in whole if each[1].key.startswith("cop/demo/world/")]
    with pytest.raises(UserError, match="never overwritten"):
        call("tape", "cut", GOLDEN, part)


def test_a_table_is_csv_or_json_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = tmp_path / "part.mcap"
    call("tape", "cut", GOLDEN, part, "--key", "cop/demo/**/robot/**")
    lines = tmp_path / "x.jsonl"
    assert call("tape", "table", part, "--out", lines) == 0
    capsys.readouterr()
    assert call("tape", "table", part) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    records = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [(r["tick"], r["subject"], r["mean_x"]) for r in rows] == [
        (str(r["tick"]), r["subject"], repr(r["mean_x"])) for r in records
    ]
    with pytest.raises(UserError, match=r"written as .csv, .jsonl, .parquet"):
        call("tape", "table", part, "--out", tmp_path / "x.xlsx")


@pytest.mark.parametrize("change", [(), ("--without", "r3")])
def test_a_replay_keeps_its_samples_as_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, ...]
) -> None:
    file = tmp_path / "samples.csv"
    call("replay", GOLDEN, "--table", file, "--json", *change)
    card = json.loads(capsys.readouterr().out)
    scores = card.get("what_if", card)["scores"]
    samples = read_series(file)
    for group, prefix in GROUPS.items():
        for level in ("solo", "consensus", "agreed"):
            mine = [s for s in samples if s.level == level and s.subject.startswith(prefix)]
            assert len(mine) == scores[group][level]["n"] > 0
            assert sum(s.entropy for s in mine) / len(mine) == pytest.approx(scores[group][level]["entropy"])
            assert sum(s.error for s in mine) / len(mine) == pytest.approx(scores[group][level]["mean"])
    assert {s.sources for s in samples if s.level == "solo"} == {1}
    assert max(s.sources for s in samples if s.level == "agreed") > 1


def test_a_table_is_parquet_with_the_same_rows(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="no pyarrow: pip install '.[table]'")
    lines, columns = tmp_path / "x.jsonl", tmp_path / "x.parquet"
    assert call("tape", "table", GOLDEN, "--out", lines) == 0
    assert call("tape", "table", GOLDEN, "--out", columns) == 0
    table = parquet.read_table(columns)
    assert table.to_pylist() == [json.loads(line) for line in lines.read_text().splitlines()]
    assert str(table.schema.field("error").type) == "double"


def test_parquet_without_its_extra_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UserError, match="needs the extra `table`"):
        call("tape", "table", GOLDEN, "--out", tmp_path / "x.parquet")


def test_a_tape_that_is_there_stops_a_run_before_it_starts() -> None:
    for command in (["demo"], ["up", "demo"]):
        with pytest.raises(UserError, match="never overwritten"):
            call(*command, "--record", GOLDEN)
    with pytest.raises(UserError, match="there is no folder"):
        call("demo", "--record", "nowhere/x.mcap")
