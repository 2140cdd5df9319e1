"""The commands of people, on a link that tells a recorded run: what they print, and their exit statuses."""

import json
import sys

import pytest

from blackboard.errors import RunFailed, UserError
from blackboard.run import door
from blackboard.wire.envelope import Envelope, Kind
from tests.commands import call
from tests.view.links import Recording, put_in_place
from tests.view.recorded import Deaf, recorded, team_of


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


def test_echo_of_what_nobody_sends_says_once_who_is_there(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    end = Recording.clock.now() + 10.0
    monkeypatch.setattr(door, "Stop", lambda: lambda: Recording.clock.now() > end)
    assert call("echo", "cop/nope/**") == 0
    assert caplog.messages == ["nothing has come on cop/nope/** yet; there is t"]


@pytest.mark.parametrize(("team", "says"), [("nope", ["team nope is not heard of yet; there is t"]), ("t", [])])
def test_the_page_of_a_team_that_is_not_there_says_who_is(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, team: str, says: list[str]
) -> None:
    pytest.importorskip("uvicorn", reason="needs the extra `web`")
    monkeypatch.setattr("blackboard.view.web.server.serve", lambda *_: None)
    monkeypatch.setattr("os.nice", lambda by: by)
    told = [envelope for envelope, _ in recorded() if envelope.key.split("/")[1] == team]
    monkeypatch.setattr(
        Recording, "get", lambda self, key: told if key == f"cop/{team}/**" else Deaf.get(self, key) or statuses()
    )
    assert call("view", "--team", team) == 0
    assert [message for message in caplog.messages if "heard of" in message] == says


def statuses() -> list[Envelope]:
    return [envelope for envelope, _ in recorded() if "/status/" in envelope.key]


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
