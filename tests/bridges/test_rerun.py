"""The bridge into Rerun: a tape as a recording, read back. Skipped where the extra is missing, which is large (`make bridges`)."""

import sys
from pathlib import Path
from typing import Any

import pytest

from blackboard.bridges.__main__ import app
from blackboard.errors import UserError
from tests.files import GOLDEN


def call(*arguments: object) -> object:
    return app([str(each) for each in arguments], exit_on_error=False, print_error=False, result_action="return_value")


def test_a_tape_becomes_a_recording_with_every_tick(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="no rerun-sdk: make bridges")
    from rerun.chunk import RrdReader

    out = tmp_path / "x.rrd"
    assert call(GOLDEN, "--save", out) == 0
    rows: dict[str, int] = {}
    ticks = set[int]()
    for chunk in RrdReader(out).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
        if chunk.entity_path == "/map/beliefs":
            batch: Any = chunk.to_record_batch()
            ticks |= set(batch.column("tick").to_pylist())
    assert set(range(16)) <= ticks
    assert rows["/map/agreed"] == rows["/map/beliefs"] == rows["/map/truth"]
    assert rows["/entropy/robot/r1"] >= 15
    assert rows["/error/robot/r1"] >= 15
    assert rows["/log"] > 5
    with pytest.raises(UserError, match="is there already"):
        call(GOLDEN, "--save", out)


def test_a_mistake_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(UserError, match="needs the extra `rerun`"):
        call(GOLDEN, "--save", tmp_path / "x.rrd")
    with pytest.raises(UserError, match="give one of them"):
        call(GOLDEN, "--save", tmp_path / "x.rrd", "--viewer", "rerun+http://127.0.0.1:1/proxy")
    with pytest.raises(UserError, match="cannot be read"):
        call(tmp_path / "none.mcap", "--save", tmp_path / "x.rrd")
