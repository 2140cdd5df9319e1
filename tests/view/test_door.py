"""The commands of people, on a link that tells a recorded run: what they print, and their exit statuses."""

import json
import sys

import pytest

from blackboard.errors import RunFailed, UserError
from blackboard.wire.envelope import Kind
from tests.commands import call
from tests.view.links import put_in_place
from tests.view.recorded import team_of


@pytest.fixture(autouse=True)
def _on_a_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    put_in_place(monkeypatch)


def test_why_says_it_in_words_or_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("why", "robot/r1", "--team", "t") == 0
    assert capsys.readouterr().out.startswith("robot/r1 is believed to be at (")
    assert call("why", "robot/r1", "--at", "3", "--json") == 0  # without --team: the one that is there
    explained = json.loads(capsys.readouterr().out)
    assert (explained["subject"], explained["tick"]) == ("robot/r1", 3)


def test_whys_mistakes_are_one_line() -> None:
    with pytest.raises(UserError, match="no board has a belief about it"):
        call("why", "object/none", "--team", "t")
    with pytest.raises(RunFailed, match="team other has settled nothing within 3 s; there is t"):
        call("why", "robot/r1", "--team", "other")
    with pytest.raises(UserError, match=r"r1: no board has a belief about it.*; did you mean robot/r1\?"):
        call("why", "r1")
    with pytest.raises(UserError, match="run.mcap is a tape; say of whom, too: blackboard why robot/r1 run.mcap"):
        call("why", "run.mcap")
    with pytest.raises(RunFailed, match="did not settle tick 99"):
        call("why", "robot/r1", "--team", "t", "--at", "99")
    with pytest.raises(UserError, match="--team 'a/b'"):
        call("why", "robot/r1", "--team", "a/b")


def test_status_prints_all_teams_or_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("status", "--seconds", "5") == 0
    assert "team t: lockstep" in capsys.readouterr().out
    assert call("status", "--seconds", "1", "--team", "other") == 1
    assert capsys.readouterr().out == "this team is not heard of; there is t\n"
    assert call("status", "--seconds", "5", "--json") == 0
    teams = json.loads(capsys.readouterr().out)
    newest = team_of().moments.newest
    assert newest is not None
    assert teams["teams"][0]["tick"] == newest.tick
    with pytest.raises(UserError, match="give one of them"):
        call("status", "--watch", "--once")


def test_echo_prints_what_comes_until_it_has_enough(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("echo", "cop/**", "--count", "60") == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 60
    assert lines[0].endswith(f" {Kind.ALIVE.value}")


def test_hz_counts_for_its_seconds(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("hz", "--seconds", "2") == 0
    assert " Hz " in capsys.readouterr().out
    with pytest.raises(UserError, match="--seconds 0"):
        call("hz", "--seconds", "0")


def test_the_page_without_its_extra_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "blackboard.view.web.server", None)
    with pytest.raises(UserError, match="needs the extra `web`"):
        call("view")
    with pytest.raises(UserError, match="--port 70000"):
        call("view", "--port", "70000")
