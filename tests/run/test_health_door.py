"""`blackboard health` asks about the team that the scenario names."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import pytest

import blackboard.__main__
from blackboard.errors import UserError
from blackboard.net import link


class Nobody:
    """A link on which nobody answers, and that remembers what was asked."""

    asked: ClassVar[list[str]] = []

    def __init__(self, *_: Any, **__: Any) -> None:
        self.asked.clear()

    def __enter__(self) -> Nobody:
        return self

    def __exit__(self, *_: object) -> None: ...

    def denials(self) -> None: ...

    def get(self, key_expr: str) -> list[object]:
        self.asked.append(key_expr)
        return []


def call(*arguments: str) -> Any:
    return blackboard.__main__.app([*arguments], exit_on_error=False, print_error=False, result_action="return_value")


def test_the_team_is_the_scenario_s_unless_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(link, "Link", Nobody)
    scenario = tmp_path / "mine.toml"
    scenario.write_text('[team]\nname = "mine"\nsub_teams = { a = ["r1"] }\n')
    for arguments, team in (
        ((), "demo"),
        (("--scenario", str(scenario)), "mine"),
        (("--scenario", str(scenario), "--team", "other"), "other"),
    ):
        assert call("health", "board", "--id", "b1", *arguments) == 1
        assert f"cop/{team}/*/status/b1" in Nobody.asked
        assert "does not answer" in capsys.readouterr().out
    with pytest.raises(UserError, match="--team 'a/b'"):
        call("health", "board", "--team", "a/b")
