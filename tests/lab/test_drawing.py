"""Pictures: the same numbers give the same bytes, and a missing extra or a wrong name is one clear line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.errors import Mistake
from blackboard.lab import contest, drawing
from blackboard.lab.__main__ import _drawing
from tests.lab.test_contest import judged
from tests.lab.test_paper import numbers


def told() -> dict[str, Any]:
    trials = {"one liar": judged("one liar", 6, list(contest.CONTENDERS))}
    return contest.report(trials, np.random.default_rng(1))


@pytest.mark.parametrize("ending", [".svg", ".png"])
def test_the_same_numbers_give_the_same_bytes(tmp_path: Path, ending: str) -> None:
    found = told()
    for name in ("first", "second"):
        drawing.save(drawing.contest(found), tmp_path / f"{name}{ending}")
        for figure, drawn in drawing.paper(numbers()).items():
            drawing.save(drawn, tmp_path / name / f"{figure}{ending}")
    pairs = [(tmp_path / f"first{ending}", tmp_path / f"second{ending}")]
    pairs += [(path, tmp_path / "second" / path.name) for path in sorted((tmp_path / "first").iterdir())]
    assert [path.stem for path, _ in pairs[1:]] == [f"fig{n}" for n in range(1, 8)]
    for one, other in pairs:
        assert one.read_bytes() == other.read_bytes(), one.name
        assert one.stat().st_size > 5000


def test_other_endings_and_places_are_refused(tmp_path: Path) -> None:
    figure = drawing.contest(told())
    with pytest.raises(Mistake, match=r"\.svg or \.png"):
        drawing.save(figure, tmp_path / "lab.jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(Mistake, match="choose another place"):
        drawing.save(figure, tmp_path / "file" / "lab.svg")


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "blackboard.lab.drawing", raising=False)
    monkeypatch.delattr("blackboard.lab.drawing", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(Mistake, match=r"matplotlib is missing: .*\[plot\]"):
        _drawing()
