"""Rows as a file: each ending gives back what was written, and a mistake is one line before anything runs."""

import csv
import json
import math
import sys
from pathlib import Path
from typing import Any

import pytest

from blackboard.errors import UserError
from blackboard.judge import files as table
from blackboard.judge.files import check_table, table_file

COLUMNS = {"name": "str", "count": "int", "size": "float", "known": "float"}
ROWS: list[dict[str, Any]] = [
    dict(zip(COLUMNS, row, strict=True))
    for row in (("a,b", 1, 0.1 + 0.2, None), ('"', -2, math.inf, 1e-300), ("é", 3, -0.0, 7.0))
]


def written(file: Path) -> Path:
    with table_file(file, COLUMNS, "--table") as write:
        for row in ROWS:
            write({**row, "more": "that is no column"})
    return file


def test_csv_gives_the_rows_back(tmp_path: Path) -> None:
    with written(tmp_path / "x.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["name"], int(r["count"]), float(r["size"])) for r in rows] == [
        (r["name"], r["count"], r["size"]) for r in ROWS
    ]
    assert rows[0]["known"] == ""


def test_json_lines_are_json_also_where_a_number_is_not_finite(tmp_path: Path) -> None:
    lines = written(tmp_path / "x.jsonl").read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line, parse_constant=pytest.fail) for line in lines]
    assert rows == [ROWS[0], {**ROWS[1], "size": None}, ROWS[2]]


def test_parquet_gives_the_rows_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra `table`")
    monkeypatch.setattr(table, "GROUP", 2)
    assert parquet.read_table(written(tmp_path / "x.parquet")).to_pylist() == ROWS


def test_without_its_extra_parquet_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UserError, match=r"--table .*x\.parquet: Parquet needs the extra `table`: .* -m pip install"):
        check_table(tmp_path / "x.parquet", "--table")


def test_another_ending_or_place_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^--out x\.txt: tables are written as \.csv, \.jsonl, \.parquet; choose"):
        check_table(Path("x.txt"), "--out")
    with (
        pytest.raises(UserError, match="there is no folder .*; make it, or choose another place"),
        table_file(tmp_path / "no" / "x.csv", COLUMNS, "--table"),
    ):
        pass
