"""docs/scenario.md is what the command prints now, and says of every key what it means and in which unit."""

import re

import pytest

from blackboard.config import load
from blackboard.run.reference import meaning_of
from tests.commands import blackboard
from tests.files import page

PAGE = page("scenario.md")


def rows() -> list[list[str]]:
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in PAGE.splitlines() if "| `" in line
    ]


def test_the_page_is_current() -> None:
    """`blackboard scenario > docs/scenario.md` makes it so."""
    assert blackboard("scenario").stdout == PAGE


def test_one_section_is_a_part_of_the_page() -> None:
    board = blackboard("scenario", "board").stdout
    assert board.startswith("## board\n")
    assert board in PAGE


def test_every_key_has_a_meaning_and_every_number_a_unit() -> None:
    assert len(rows()) > 100
    for *_, unit, what, meaning in rows():
        assert meaning.endswith((".", "no parameters")), meaning
        assert unit != "-" or "whole" in what or not ("number" in what or "finite" in what), meaning


def test_every_key_of_the_shipped_scenarios_is_there() -> None:
    known = {row[0].strip("`") for row in rows()} | {row[1].strip("`") for row in rows()}
    for name in ("demo", "mrclam", "pyfg", "paper", "liar"):
        tables = load(name).tables
        for section in ("team", "grid", "time", "board", "robot", "world"):
            assert set(tables.get(section, {})) <= known


def test_the_meaning_is_found_in_the_class_that_a_field_comes_from() -> None:
    class WithWords:
        a: float = 1.0
        "[m] How far."
        b: float = 1.0
        "Brackets [m] later are none."
        c: float = 1.0

    class Inherits(WithWords):
        pass

    assert meaning_of(Inherits, "a") == ("m", "How far.")
    assert meaning_of(Inherits, "b") == ("", "Brackets [m] later are none.")
    assert meaning_of(Inherits, "c") == meaning_of(int, "a") == ("", "")


@pytest.mark.parametrize("title", ["fault: lie", "world.check", "grid.anchor", "Rules"])
def test_what_other_pages_link_to_is_there(title: str) -> None:
    assert re.search(rf"^#+ {re.escape(title)}$", PAGE, re.MULTILINE)
