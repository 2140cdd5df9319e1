"""The list of changes that no test notices (docs/mutants.md) is about the sources as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LIST = (ROOT / "docs" / "mutants.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^- `([^`]+\.py)`: `([^`]+)` → `([^`]+)`", LIST, re.MULTILINE)


def test_every_entry_of_the_list_is_read() -> None:
    assert len(ENTRIES) == len(re.findall(r"^- ", LIST, re.MULTILINE)) > 0


@pytest.mark.parametrize(("path", "before", "after"), ENTRIES)
def test_a_survivor_changes_a_line_that_there_is(path: str, before: str, after: str) -> None:
    lines = [line.strip() for line in (ROOT / path).read_text(encoding="utf-8").splitlines()]
    assert before in lines
    assert before != after
