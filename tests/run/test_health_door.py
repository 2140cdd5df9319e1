"""`blackboard health` asks about the team that the scenario names."""

from pathlib import Path
from typing import Any, ClassVar

import msgpack
import pytest

from blackboard.errors import UserError
from blackboard.run import health
from blackboard.wire.envelope import Envelope
from blackboard.wire.raw import MAX_BYTES
from tests.commands import call


class Nobody:
    """A link on which nobody answers, and that remembers what was asked."""

    asked: ClassVar[list[str]] = []

    def __init__(self, *_: Any, **__: Any) -> None:
        self.asked.clear()

    def __enter__(self) -> "Nobody":
        return self

    def __exit__(self, *_: object) -> None: ...

    def denials(self) -> None: ...

    def get(self, key_expr: str) -> list[object]:
        self.asked.append(key_expr)
        return []


def test_the_team_is_the_scenario_s_unless_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(health, "Link", Nobody)
    scenario = tmp_path / "mine.toml"
    scenario.write_text('[team]\nname = "mine"\nsub_teams = { a = ["r1"] }\n')
    for arguments, team in (
        ((), "demo"),
        (("--scenario", str(scenario)), "mine"),
        (("--scenario", str(scenario), "--team", "other"), "other"),
    ):
        assert call("health", "board", "--id", "b1", *arguments) == 1
        assert {f"cop/{team}/*/status/b1", f"cop/{team}/b1/status/*"} <= set(Nobody.asked)
        assert "does not answer" in capsys.readouterr().out
    with pytest.raises(UserError, match="--team 'a/b'"):
        call("health", "board", "--team", "a/b")


@pytest.mark.parametrize("text", ["[1]", "5", "null", '"demo"'])
@pytest.mark.parametrize("command", [("health", "board"), ("up",)])
def test_a_scenario_without_sections_is_one_line(command: tuple[str, ...], text: str, tmp_path: Path) -> None:
    scenario = tmp_path / "odd.json"
    scenario.write_text(text)
    with pytest.raises(UserError, match="odd.json: holds no sections"):
        call(*command, "--scenario", str(scenario))


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xff" * 9,
        msgpack.packb({"version": 1}),
        msgpack.packb({"version": 2, "time": 1.0}),
        msgpack.packb({"version": 1, "time": "now"}),
        msgpack.packb({"version": 1, "time": float("nan")}),
        msgpack.packb({"version": 1, "time": float("inf"), "tick": "x"}),
        bytes(MAX_BYTES + 1),
    ],
)
def test_an_answer_that_is_no_message_is_no_answer(payload: bytes) -> None:
    class Odd:
        def get(self, key_expr: str) -> list[Envelope]:
            return [Envelope("cop/t/a/status/b1", payload)]

    for kind in ("world", "board", "robot"):
        assert "answer" in (health.diagnose(Odd(), kind, "b1", 1.0, team="t", max_age=5.0) or "")
        health.part(Odd(), kind, "b1", team="t")
