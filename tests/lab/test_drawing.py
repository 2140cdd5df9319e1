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
    figures = [drawing.contest(told()), *(drawing.paper(numbers())[name] for name in ("fig2", "fig7"))]
    again = [drawing.contest(told()), *(drawing.paper(numbers())[name] for name in ("fig2", "fig7"))]
    for n, pair in enumerate(zip(figures, again, strict=True)):
        files = [tmp_path / f"{n}{which}{ending}" for which in "ab"]
        for figure, file in zip(pair, files, strict=True):
            drawing.save(figure, file)
        assert files[0].read_bytes() == files[1].read_bytes()
        assert files[0].stat().st_size > 5000


def test_all_seven_figures_are_drawn() -> None:
    assert list(drawing.paper(numbers())) == [f"fig{n}" for n in range(1, 8)]


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
