"""Pictures: the same numbers give the same bytes, and a missing extra or a wrong name is one clear line."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from blackboard.errors import UserError
from blackboard.lab import comparison, drawing
from tests.commands import call
from tests.lab.figures import numbers
from tests.lab.trials import judged


@pytest.fixture(scope="module")
def compared() -> dict[str, Any]:
    """The report of a comparison, of a few rules, because what takes long is to draw them all."""
    trials = {"one liar": judged("one liar", 6, ["linear", "cooperative", comparison.DEFAULT_NAME, "chernoff"])}
    return comparison.report(trials, np.random.default_rng(1))


def figures(compared: dict[str, Any]) -> list[Any]:
    return [drawing.comparison(compared), drawing.paper(numbers())["fig4"]]


def test_the_same_numbers_give_the_same_bytes(tmp_path: Path, compared: dict[str, Any]) -> None:
    for n, pair in enumerate(zip(figures(compared), figures(compared), strict=True)):
        for ending in (".svg", ".png"):
            files = [tmp_path / f"{n}{which}{ending}" for which in "ab"]
            for figure, file in zip(pair, files, strict=True):
                drawing.save(figure, file)
            assert files[0].read_bytes() == files[1].read_bytes()
            assert files[0].stat().st_size > 5000


def test_all_seven_figures_are_drawn() -> None:
    assert list(drawing.paper(numbers())) == [f"fig{n}" for n in range(1, 8)]


def test_a_gallery_has_every_picture_of_its_folder_with_its_title(tmp_path: Path, compared: dict[str, Any]) -> None:
    drawing.save_all({"rules": drawing.comparison(compared)}, tmp_path)
    page = drawing.gallery(tmp_path).read_text(encoding="utf-8")
    assert page.count("<img") == 1
    assert "rules: all rules on the same opinions; thick: the default" in page


def test_a_gallery_names_the_number_of_a_figure_of_the_paper_once(tmp_path: Path) -> None:
    drawing.save(drawing.paper(numbers())["fig2"], tmp_path / "fig2.svg")
    assert "<figcaption>Fig. 2: five sensors that agree" in drawing.gallery(tmp_path).read_text(encoding="utf-8")


def test_other_endings_and_places_are_refused(tmp_path: Path, compared: dict[str, Any]) -> None:
    figure = drawing.comparison(compared)
    with pytest.raises(UserError, match=r"\.svg or \.png"):
        drawing.save(figure, tmp_path / "lab.jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="choose another place"):
        drawing.save(figure, tmp_path / "file" / "lab.svg")


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "blackboard.lab.drawing", raising=False)
    monkeypatch.delattr("blackboard.lab.drawing", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UserError, match=r"--picture needs the extra `plot`: .*\[plot\]"):
        call("lab", "--runs", 1, "--picture", "lab.svg")
