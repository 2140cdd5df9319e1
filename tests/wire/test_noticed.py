"""The tables that are also programs."""

from __future__ import annotations

import runpy

import pytest

from blackboard.process import rounds
from blackboard.wire import keys


@pytest.mark.parametrize("module", [keys, rounds], ids=lambda module: module.__name__)
@pytest.mark.parametrize("name", ["__main__", "imported"])
def test_a_table_is_printed_where_it_is_run_and_not_where_it_is_imported(
    capsys: pytest.CaptureFixture[str], module: object, name: str
) -> None:
    runpy.run_path(str(module.__file__), run_name=name)  # type: ignore[attr-defined]
    assert bool(capsys.readouterr().out) == (name == "__main__")
