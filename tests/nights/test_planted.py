"""The planted bugs can be planted, and one of them is noticed at once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.files import ROOT
from tests.nights.planted import BUGS, Bug, notice


@pytest.mark.parametrize("bug", BUGS.values(), ids=BUGS)
def test_every_bug_has_its_place(bug: Bug, tmp_path: Path) -> None:
    (tmp_path / bug.file).parent.mkdir(parents=True)
    shutil.copy(ROOT / bug.file, tmp_path / bug.file)
    bug.plant(tmp_path)
    compile((tmp_path / bug.file).read_text(encoding="utf-8"), bug.file, "exec")
    with pytest.raises(ValueError, match="does not have"):
        bug.plant(tmp_path)


def test_a_planted_bug_is_noticed() -> None:
    found = notice(BUGS["ancestors"], 10, 1)
    assert found is not None
    assert "ProvenanceIsWhole" in found
